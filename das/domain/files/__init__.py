"""Reading and writing files. `load` finds a file by its name or path and selects the module that reads its format."""
