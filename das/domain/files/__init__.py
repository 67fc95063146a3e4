"""Reading and writing files: `load` finds the file of a name or path and picks the module that reads its format."""
