"""Recorded trips: readers, matching to the line, and the evenly sampled run that inverse dynamics needs."""
