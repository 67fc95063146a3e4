"""A working set of own files: what `das-sim example` writes."""
