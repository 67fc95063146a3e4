"""Many runs in closed loop: what to run, the workers, what is finished, and the table of results."""
