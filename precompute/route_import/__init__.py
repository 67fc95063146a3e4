"""Own lines: routes made from OpenStreetMap, from tables and from altitudes, their file, their picture and checks."""
