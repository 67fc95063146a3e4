"""The presentations of the advice, one module each, named as in `sim.drivers.kinds.Presentation`."""
