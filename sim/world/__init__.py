"""The closed loop: a scenario, the simulated world in steps of time, and the connection to the advice."""
