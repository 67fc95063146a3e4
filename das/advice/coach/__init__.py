"""The coach: a reference that stands, and instructions that lead a driver along it."""
