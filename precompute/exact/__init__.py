"""The exact time–energy front of a section: slow, but an independent check of the fast solver."""
