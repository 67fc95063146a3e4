"""Offline work: solving sections, showing whole trade-offs, and building the tables of a network."""
