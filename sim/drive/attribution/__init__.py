"""Where the energy of a recorded drive went, by place and by cause, against the optimum for the same times."""
