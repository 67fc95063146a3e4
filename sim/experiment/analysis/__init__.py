"""What the trials of an experiment say: paired differences, intervals, a mixed model, checks, power, and a report."""
