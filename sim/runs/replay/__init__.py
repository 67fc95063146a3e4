"""Replay of a recorded trip against a live node."""
