"""Start of das-record: `python -m das.recorder`."""

from das.command_line.process import start


def main() -> None:
    """Entry point of das-record."""
    start("das.recorder.command")


if __name__ == "__main__":
    main()
