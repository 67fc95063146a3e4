"""The process that records a bus: wiring between the bus and a recording's file."""
