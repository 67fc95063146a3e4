"""The command das-record; the code that records is imported only when it runs."""

from __future__ import annotations

from collections.abc import Sequence

from das.command_line.application import run_command, single_command
from das.recorder.options import RecorderOptions

EXAMPLES = (
    "das-record --train IC1 -o ic1.mcap --connect tcp/127.0.0.1:7447 --connect tcp/127.0.0.1:7448",
    "das-record --train IC1 -o ic1.mcap --bus bus-tls/recorder.json5",
)


def record(options: RecorderOptions) -> None:
    """Record every message on the bus about a train in an MCAP file, until stopped.

    It receives messages from the processes to which it connects, by default the node. Each message is on the disk
    within a second.
    """
    from das.recorder.process import record as run

    run(options)


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of das-record; `arguments` replace those of the command line."""
    command = single_command("das-record", record, EXAMPLES)
    run_command(lambda: command(args=arguments, standalone_mode=False, prog_name="das-record"))
