"""Shared parts of all command lines of the project."""
