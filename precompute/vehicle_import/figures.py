"""The figures of a train that a table of efforts does not hold: the options of `das-precompute vehicle import`."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated

import typer


@dataclass(frozen=True, kw_only=True)
class Figures:
    """The figures of a train beside its efforts, as text with their units; None: not given.

    `davis` holds the three coefficients, separated by commas. `units` are those of speed and force, for a table whose
    header states none.
    """

    name: Annotated[str | None, typer.Option(help="Name of the train [default: that of the file].")] = None
    mass: Annotated[str | None, typer.Option(metavar="T", help="Mass, like '440 t'.")] = None
    length: Annotated[str | None, typer.Option(metavar="M", help="Length, like '200 m'.")] = None
    max_speed: Annotated[str | None, typer.Option(metavar="KMH", help="Top speed, like '160 km/h'.")] = None
    rotating_mass: Annotated[
        str | None, typer.Option(metavar="%", help="Rotating mass on top of the mass, like '6 %'.")
    ] = None
    deceleration: Annotated[
        str | None, typer.Option(metavar="MPS2", help="Deceleration in service, like '0.5 m/s^2'.")
    ] = None
    davis: Annotated[
        str | None,
        typer.Option(metavar="A,B,C", help="Running resistance, like '20 N/t, 0.1 N/t/(km/h), 0.003 N/t/(km/h)^2'."),
    ] = None
    units: Annotated[
        str | None, typer.Option(metavar="SPEED,FORCE", help="Units of a CSV table whose header has none: km/h,kN.")
    ] = None

    def given(self) -> dict[str, str]:
        """The figures that are given, by name."""
        return {one.name: getattr(self, one.name) for one in fields(self) if getattr(self, one.name) is not None}
