"""The command line das-sim: its commands and shared options."""
