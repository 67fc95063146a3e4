"""Recordings: opening one, with the files it was made from, the course of its drive, its health, and its recovery."""
