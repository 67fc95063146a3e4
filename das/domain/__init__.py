"""The world as frozen data in SI units: vehicles, routes, loss models, trajectories."""
