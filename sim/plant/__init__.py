"""The simulated train, with its own physics."""
