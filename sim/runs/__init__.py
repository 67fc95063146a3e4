"""A drive from a drive: replay, reproduce, what-if."""
