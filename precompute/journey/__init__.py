"""The command that plans a whole journey, and its reports."""
