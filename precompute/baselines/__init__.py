"""Baseline strategies: what trains drive without the optimum."""
