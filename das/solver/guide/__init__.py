"""Plans that consist of instructions to a driver: policies over instructions, runs that follow them, schedules."""
