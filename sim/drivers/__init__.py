"""Simulated drivers: they see a cab and move its controller, and know nothing else of the run."""
