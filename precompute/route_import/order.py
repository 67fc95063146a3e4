"""What is wanted of an import, and what the user states of a line: groups of options of `das-precompute route`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import typer

from das.domain.errors import DasError, is_seen

FASTEST_KMH: Final = 600.0


@dataclass(frozen=True, kw_only=True)
class ImportOrder:
    """Which line of the files is wanted, where its altitudes come from, and what stands for what the files lack.

    What only a map has (`OF_MAPS`) may not be given with tables, and a length not with a map. `joined_m`: None is 0 in
    OpenStreetMap, whose tracks share their vertices. The cross section of tunnels is an assumption: 40 to 90 m² for a
    double track.
    """

    start: Annotated[
        str | None,
        typer.Option(
            "--from", metavar="STATION", help="First stop: name, LATITUDE,LONGITUDE or NAME=LATITUDE,LONGITUDE."
        ),
    ] = None
    end: Annotated[str | None, typer.Option("--to", metavar="STATION", help="Last stop, as for --from.")] = None
    via: Annotated[
        list[str] | None,
        typer.Option(metavar="STATION", help="Station that the way leads over; may be given several times."),
    ] = None
    only_named_stops: Annotated[
        bool, typer.Option("--only-named-stops", help="Leave out the stations that are not named by these options.")
    ] = False
    joined_m: Annotated[
        float | None,
        typer.Option(
            "--join-m",
            metavar="M",
            min=0.0,
            max=100.0,
            help="Join a loose end of a track this near to another one [default: 3; of OpenStreetMap 0].",
        ),
    ] = None
    flat: Annotated[bool, typer.Option("--flat", help="Take the line as flat, for want of altitudes.")] = False
    altitudes: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Altitudes (CSV): altitude_m with position_km, with latitude_deg and longitude_deg, or with name.",
        ),
    ] = None
    smooth_m: Annotated[
        float, typer.Option(min=0.0, max=50_000.0, help="Length over which altitudes are averaged; 0: none.")
    ] = 2000.0
    cap_permille: Annotated[
        float, typer.Option(min=1.0, max=200.0, help="Steepest gradient that altitudes may give.")
    ] = 40.0
    limit_kmh: Annotated[
        float | None,
        typer.Option(
            "--limit",
            metavar="KMH",
            min=1.0,
            max=FASTEST_KMH,
            help="Limit where a map has none [default: the lower one of the neighbours].",
        ),
    ] = None
    tunnel_area_m2: Annotated[
        float,
        typer.Option(
            "--tunnel-area", metavar="M2", min=10.0, max=500.0, help="Free cross section of tunnels of a map."
        ),
    ] = 50.0
    length_km: Annotated[
        float | None,
        typer.Option(min=0.001, max=20_000.0, help="Length of a line from tables [default: last stop or row]."),
    ] = None


OF_MAPS: Final = ("via", "only_named_stops", "limit_kmh", "tunnel_area_m2", "joined_m")
"""The fields of an order that belong to maps."""


@dataclass(frozen=True, kw_only=True)
class Words:
    """What the user states of a line; it goes into its file, its pictures and its reports. None: nothing is stated."""

    source: Annotated[
        str | None, typer.Option(metavar="TEXT", help="Origin of the data [default of OpenStreetMap: its attribution].")
    ] = None
    licence: Annotated[str | None, typer.Option(metavar="TEXT", help="Licence of the data.")] = None
    id: Annotated[str | None, typer.Option(metavar="WORD", help="Id of the route [default: from its name].")] = None
    name: Annotated[
        str | None, typer.Option(metavar="TEXT", help="Name of the route [default: its first and last stop].")
    ] = None
    time_zone: Annotated[
        str | None, typer.Option(metavar="ZONE", help='Time zone of the line, like "Europe/Rome" [default: UTC].')
    ] = None

    def check(self) -> None:
        """Raise DasError for a text that a file cannot hold, and for an unknown time zone."""
        from zoneinfo import ZoneInfo

        from das.domain.files.reading import MOST_OF_A_NAME
        from das.domain.files.routes import MOST_OF_A_SOURCE

        for option, text in (("--source", self.source), ("--licence", self.licence)):
            if text is not None and not (is_seen(text) and len(text) <= MOST_OF_A_SOURCE):
                raise DasError(f"{option}: expected at most {MOST_OF_A_SOURCE} characters, without control characters")
        for option, text in (("--id", self.id), ("--name", self.name)):
            if text is not None and not (text.strip() and is_seen(text) and len(text) <= MOST_OF_A_NAME):
                raise DasError(f"{option}: expected 1 to {MOST_OF_A_NAME} characters, without control characters")
        try:
            ZoneInfo("UTC" if self.time_zone is None else self.time_zone)
        except (KeyError, ValueError, OSError):
            raise DasError(f'--time-zone {self.time_zone}: expected a zone like "Europe/Zurich" (IANA)') from None
