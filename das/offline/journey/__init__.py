"""Time–energy optimisation of a journey of several sections."""
