"""Tight bounds are above the quick ones, and below every run."""
