"""A report about a recorded drive: one page for an instructor, then figures, pictures and events."""
