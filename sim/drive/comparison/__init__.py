"""Recorded drives of one line beside each other, aligned on track position."""
