"""Where das-sim starts."""

from das.entry import start


def main() -> None:
    """Entry point of das-sim."""
    start("sim.cli")
