"""Proven lower bounds of the energy of a run (`docs/explanation/bounds.md`)."""
