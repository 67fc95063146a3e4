"""A recording is sent to today's cab again, to see whether the cab still says what was recorded."""
