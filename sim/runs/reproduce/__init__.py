"""A recording heard again by today's cab: whether it still says what was recorded."""
