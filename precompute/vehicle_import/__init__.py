"""Trains from files of other programs and from tables, as vehicle files of this project."""
