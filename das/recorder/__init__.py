"""The process das-record: it connects the bus with the file of a recording."""
