"""The commands das-node and das-node tls-init; the code behind them is imported only when they run."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from das.command_line.application import run_app, single_command
from das.node.options import FASTEST_HZ, SLOWEST_HZ, AdviceGiven, LineServed, NodeOptions, NodePlace, TrainServed

EXAMPLES = (
    "das-node --route zurich-luzern --vehicle re460-ic --from 'Zürich HB' --to Zug --train IC1",
    "das-node --route route.toml --vehicle vehicle.toml --train IC1 --tables tables --calibrate",
    "das-node tls-init -h",
)


def advise(line: LineServed, driven: TrainServed, place: NodePlace, advice: AdviceGiven) -> None:
    """Advise a train: hear journey, position and delay on the bus, publish speed and force advice.

    The node advises only after it has heard a list of the temporary restrictions in force, possibly an empty one.
    """
    from das.domain.errors import DasError

    if not SLOWEST_HZ <= advice.rate <= FASTEST_HZ:
        raise DasError(f"--rate {advice.rate:g}: expected {SLOWEST_HZ:g} to {FASTEST_HZ:g} Hz")
    from das.node.process import serve

    serve(NodeOptions(line=line, driven=driven, place=place, advice=advice))


tls_app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
LAST_PORT = 65535


@tls_app.callback()
def _several() -> None:
    """Keep `tls-init` a word of the command line: typer drops the name of a command that is the only one."""


@tls_app.command("tls-init", epilog="Example: das-node tls-init bus-tls --train IC1")
def tls_init(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder to create; must not exist yet.")],
    train: Annotated[str, typer.Option(help="Train name, the second part of every key.")] = "train-1",
    port: Annotated[int, typer.Option(help="The node's port; simulator and recorder take the next two.", min=1)] = 7447,
    days: Annotated[float, typer.Option(help="How long the certificates are valid.", max=3650)] = 90.0,
) -> None:
    """Make a test authority, certificates and bus files for every role (node, recorder, cab, sensors, operator …).

    For tests and trials on one machine, not a public-key infrastructure.
    """
    from das.bus.topics import check_train_name
    from das.command_line.printing import typed
    from das.domain.errors import DasError

    try:
        from das.bus.access import LISTENERS, write_bus_folder
    except ImportError as error:
        raise DasError("tls-init needs the package trustme: pip install '.[tls]' in the checkout") from error
    if not days > 0:
        raise DasError(f"--days {days:g}: expected more than 0")
    if port > LAST_PORT + 1 - len(LISTENERS):
        raise DasError(f"--port {port}: expected at most {LAST_PORT + 1 - len(LISTENERS)}")
    ports = {role: port + i for i, role in enumerate(LISTENERS)}
    until = write_bus_folder(folder, check_train_name(train), ports, days)
    print(f"written: {folder}, valid until {until:%Y-%m-%d %H:%M} UTC")
    print("for tests and trials, not a public-key infrastructure; the authority's key is discarded")
    print(f"use it with: {typed('das-sim')} run clear-day --bus {folder} --train {train}")
    print(f"or one by one: {typed('das-node')} … --bus {folder / 'node.json5'} --train {train}")


def main() -> None:
    """Entry point of das-node: run `tls-init` if that is the first word, else advise."""
    if sys.argv[1:2] == ["tls-init"]:
        run_app(tls_app, "das-node")
    else:
        run_app(single_command("das-node", advise, EXAMPLES), "das-node")
