"""Human-factors experiments: a design file, its trials with simulated drivers, and the data that comes of them."""
