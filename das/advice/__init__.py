"""Advice to the driver on one section (stop to stop): from the train's state to a plan, from the plan to a display."""
