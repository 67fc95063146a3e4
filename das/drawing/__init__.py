"""Pictures of runs and fronts, and the colours that all pictures on white share."""
