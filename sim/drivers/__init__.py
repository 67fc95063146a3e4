"""Simulated drivers: they see only a cab and move its controller."""
