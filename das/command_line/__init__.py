"""What all command lines of the project share."""
