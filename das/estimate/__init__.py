"""What follows from measurements: where the train is and how fast it runs, what it weighs, and what resists it."""
