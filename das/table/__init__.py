"""A front on disk: its format, reading it, and the hashes of what it was made for."""
