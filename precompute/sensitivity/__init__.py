"""How robust a plan is against a world that differs from it."""
