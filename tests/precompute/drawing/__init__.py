"""Pictures of lines, trains and timetables."""
