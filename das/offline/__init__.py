"""What is computed offline and never rides in the cab: proven bounds, refined trajectories, journeys."""
