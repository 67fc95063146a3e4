"""Pictures of lines, trains and timetables, for the commands of das-precompute."""
