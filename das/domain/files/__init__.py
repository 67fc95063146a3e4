"""Reading and writing of files, a module for each format; `load` picks the module for a name or path."""
