"""Plans in the space of what is shown to a driver: policies over instructions, runs that follow them, schedules."""
