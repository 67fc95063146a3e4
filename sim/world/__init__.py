"""The closed loop: a scenario, its world in steps of time, and its connection to the advice."""
