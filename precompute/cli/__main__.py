"""The entry point of das-precompute: `python -m precompute.cli`."""

from das.command_line.process import start


def main() -> None:
    """Entry point of das-precompute."""
    start("precompute.cli.program")


if __name__ == "__main__":
    main()
