"""How fast the project is on this machine, against baselines and rooflines measured in the same run."""
