"""Lower bounds of the energy of a run that are proven (`docs/explanation/bounds.md`)."""
