"""The analysis of an experiment's trials: planned differences with intervals, and a report."""
