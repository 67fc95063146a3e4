"""Few-switch trajectories of a section: few things to do with the controller, each of them for a while."""
