"""Offline: solves sections, whole trade-offs and (later) tables for a network."""
