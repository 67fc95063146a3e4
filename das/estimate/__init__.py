"""Estimates from measurements: position and speed of the train, its mass and its running resistance."""
