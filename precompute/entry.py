"""Where das-precompute starts."""

from das.entry import start


def main() -> None:
    """Entry point of das-precompute."""
    start("precompute.cli")
