"""A recorded run with changes: other advice for the drive as it was, or the run simulated again."""
