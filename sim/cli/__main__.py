"""The entry point of das-sim: `python -m sim.cli`."""

from das.command_line.process import start


def main() -> None:
    """Entry point of das-sim."""
    start("sim.cli.program")


if __name__ == "__main__":
    main()
