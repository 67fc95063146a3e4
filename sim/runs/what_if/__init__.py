"""A recorded day with something otherwise: other advice for the drive as it was, or the day driven anew."""
