"""The command das-node: its options; what it does is imported only when it runs."""

from __future__ import annotations

import sys

from das.command_line.application import single_command
from das.command_line.running import run_app
from das.node.options import FASTEST_HZ, SLOWEST_HZ, AdviceGiven, BusPlace, LineServed, NodeOptions, TrainServed

EXAMPLES = (
    "das-node --route zurich-luzern --vehicle re460-ic --from 'Zürich HB' --to Zug --train IC1",
    "das-node --route route.toml --vehicle vehicle.toml --train IC1 --tables tables --calibrate",
    "das-node tls-init -h",
)


def advise(line: LineServed, driven: TrainServed, place: BusPlace, advice: AdviceGiven) -> None:
    """Advise a train: hear journey, position and delay on the bus, publish speed and force advice.

    The node advises only after it has heard a list of the temporary restrictions in force, possibly an empty one.
    """
    from das.domain.errors import DasError

    if not SLOWEST_HZ <= advice.rate <= FASTEST_HZ:
        raise DasError(f"--rate {advice.rate:g}: expected {SLOWEST_HZ:g} to {FASTEST_HZ:g} Hz")
    from das.node.process import serve

    serve(NodeOptions(line=line, driven=driven, place=place, advice=advice))


def main() -> None:
    """Entry point of das-node; `tls-init` is the one word that is not about advising."""
    if sys.argv[1:2] == ["tls-init"]:
        from das.node.tls_command import tls_app

        run_app(tls_app, "das-node")
    else:
        run_app(single_command("das-node", advise, EXAMPLES), "das-node")
