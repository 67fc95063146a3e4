"""A recorded day with changes: other advice for the drive as it was, or the day simulated again."""
