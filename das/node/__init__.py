"""The process on board: wiring between the bus, the clock and the cab."""
