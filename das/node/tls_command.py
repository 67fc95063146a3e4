"""The command das-node tls-init: certificates and bus files for a trial."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from das.bus.topics import check_train_name
from das.command_line.printing import typed
from das.domain.errors import DasError

tls_app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
LAST_PORT = 65535


@tls_app.callback()
def _several() -> None:
    """Keep `tls-init` a word of its own: typer would swallow the name of an only command."""


@tls_app.command("tls-init", epilog="Example: das-node tls-init bus-tls --train IC1")
def tls_init(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder to make; must not be there yet.")],
    train: Annotated[str, typer.Option(help="Train name, the second part of every key.")] = "train-1",
    port: Annotated[int, typer.Option(help="The node's port; simulator and recorder take the next two.", min=1)] = 7447,
    days: Annotated[float, typer.Option(help="How long the certificates are valid.", max=3650)] = 90.0,
) -> None:
    """Make a test authority, certificates and bus files for every role (node, recorder, cab, sensors, operator …).

    For tests and trials on one machine, not a public-key infrastructure.
    """
    try:
        from das.bus.tls import LISTENERS, write_bus_folder
    except ImportError as error:
        raise DasError("tls-init needs the package trustme: pip install driver-advisory-system[tls]") from error
    if not days > 0:
        raise DasError(f"--days {days:g}: expected more than 0")
    if port > LAST_PORT + 1 - len(LISTENERS):
        raise DasError(f"--port {port}: expected at most {LAST_PORT + 1 - len(LISTENERS)}")
    ports = {role: port + i for i, role in enumerate(LISTENERS)}
    until = write_bus_folder(folder, check_train_name(train), ports, days)
    print(f"written: {folder}, valid until {until:%Y-%m-%d %H:%M} UTC")
    print("for tests and trials, not a public-key infrastructure; the authority's key is thrown away")
    print(f"use it with: {typed('das-sim')} run clear-day --bus {folder} --train {train}")
    print(f"or one by one: {typed('das-node')} … --bus {folder / 'node.json5'} --train {train}")
