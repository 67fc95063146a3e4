"""A recorded drive and every figure of it: calls, events, energy by cause and place, comparison, export."""
