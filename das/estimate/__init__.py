"""What the measurements say: where the train is, what it weighs, how hard it runs."""
