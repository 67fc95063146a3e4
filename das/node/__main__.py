"""Start of das-node: `python -m das.node`."""

from das.command_line.process import start


def main() -> None:
    """Entry point of das-node."""
    start("das.node.command")


if __name__ == "__main__":
    main()
