"""One module per file format; `load` picks the right one for a name or path."""
