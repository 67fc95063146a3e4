"""What happened on a recorded drive, when and why: stops, advice, restrictions, the driver; and people's notes."""
