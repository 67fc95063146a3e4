"""A presentation from outside the program, in a single file."""
