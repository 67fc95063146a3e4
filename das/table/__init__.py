"""A front on disk: its format, reading it, and the hashes that say what it was made for."""
