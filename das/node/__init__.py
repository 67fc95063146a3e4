"""The process on board, das-node: it connects the bus, the clock and the cab."""
