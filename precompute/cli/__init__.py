"""The command line das-precompute: its commands, shared options and reports."""
