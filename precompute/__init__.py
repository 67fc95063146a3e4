"""Offline work: solves sections, shows whole trade-offs, and builds the tables of a network."""
