"""The exact time–energy front of a section: slow, and the witness of the fast solver."""
