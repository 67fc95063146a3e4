"""The node and the recorder as processes, in lockstep with a simulation."""
