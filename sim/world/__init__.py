"""The closed loop: a scenario, its world in steps of time, and what connects it to the advice."""
