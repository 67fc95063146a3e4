"""Start of the desk's server, which `das-sim desk` runs as a child process: `python -m sim.desk`."""

from das.command_line.process import start

if __name__ == "__main__":
    start("sim.desk.server")
