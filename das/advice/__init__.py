"""Advice on one section: from a state to a plan, from a plan to what is displayed."""
