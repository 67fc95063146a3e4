"""The cab desk: a person drives a simulated train in the browser, or looks at a recorded drive as its driver saw it."""
