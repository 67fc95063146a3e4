"""Experiments with people at the desk: questionnaires, the experimenter's page, and tasks beside driving."""
