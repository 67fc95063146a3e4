"""The simulated train, with physics of its own."""
