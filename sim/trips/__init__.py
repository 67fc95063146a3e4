"""Recorded trips: readers, matching to the line, and the even run that inverse dynamics works on."""
