"""Drivers outside of the simulator: a process of its own that is shown the cab over the bus and sets the controller."""
