"""Computations that are only done offline, never on board: proven bounds, refined trajectories, journeys."""
