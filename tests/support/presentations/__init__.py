"""A presentation that the program does not have, in the one file that it takes."""
