"""Human-factors experiments: a design file, its trials with simulated drivers, and their data."""
