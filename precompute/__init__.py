"""Offline: solves sections, whole trade-offs and tables for a network."""
