"""The worth of advice to a fleet: energy, money and CO₂ a year in five steps, from a study's trials and from inputs."""
