"""Time–energy optimisation of one section (stop to stop)."""
