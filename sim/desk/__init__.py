"""The cab desk: a person drives a simulated train in the browser, or watches a recorded drive as its driver saw it."""
