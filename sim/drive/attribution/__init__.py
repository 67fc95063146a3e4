"""Energy of a recorded drive above the optimum for the same times, by place and by cause."""
