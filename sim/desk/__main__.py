"""Start of the desk's server, which `das-sim desk` runs as a child process: `python -m sim.desk`."""

from das.command_line.process import start


def main() -> None:
    """Entry point of the server."""
    start("sim.desk.server")


if __name__ == "__main__":
    main()
