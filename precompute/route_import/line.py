"""A line under import: the options that select it, the route so far, remarks for the user, and its file."""

from __future__ import annotations

import re
import textwrap
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar
from zoneinfo import ZoneInfo

import numpy as np
import typer
from numpy.typing import ArrayLike

from das.domain.errors import DasError, is_seen
from das.domain.files.reading import MOST_OF_A_NAME
from das.domain.files.routes import MOST_OF_A_SOURCE, SCHEMA_VERSION
from das.domain.files.writing import toml_string
from das.domain.route import Altitudes, Floats, Route, Stop, Stretches, Zone
from das.domain.units import KM, PERMILLE, kmh


@dataclass(frozen=True, kw_only=True)
class ImportOrder:
    """The choice of a line in the files, the source of its altitudes, and substitutes for missing data.

    The stations on the way, `only_named_stops` and a limit may not be given with tables, nor a length with a map.
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
        typer.Option(metavar="STATION", help="Station on the way; may be given several times."),
    ] = None
    only_named_stops: Annotated[
        bool, typer.Option("--only-named-stops", help="Leave out the stations that are not named by these options.")
    ] = False
    flat: Annotated[bool, typer.Option("--flat", help="Treat the line as flat, because there are no altitudes.")] = (
        False
    )
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
            max=600.0,
            help="Limit where a map has none [default: the lower one of the neighbours].",
        ),
    ] = None
    length_km: Annotated[
        float | None,
        typer.Option(min=0.001, max=20_000.0, help="Length of a line from tables [default: last stop or row]."),
    ] = None


@dataclass(frozen=True, kw_only=True)
class Words:
    """The user's statements on a line, for its file, pictures and reports. None: nothing is stated."""

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


DECIMALS: Final = 3
"""Number of decimals to which positions (m) are rounded."""
RESOLUTION_M: Final = 10.0**-DECIMALS
"""Least length (m) that is considered."""
_Zone = TypeVar("_Zone", bound=Zone)


@dataclass(frozen=True, kw_only=True)
class ImportedLine:
    """A route made from a map or from tables; it is flat as long as its `altitudes` are `Altitudes.NONE`.

    `structures` are its tunnels and bridges, where the track is not at the altitude of the ground. `remarks` are the
    assumptions, each in a sentence; they are written into the file as well.
    """

    route: Route
    structures: tuple[Zone, ...] = ()
    remarks: tuple[str, ...] = ()

    def with_remarks(self, *remarks: str) -> ImportedLine:
        """The line with more remarks; an empty one is left out."""
        return replace(self, remarks=(*self.remarks, *(remark for remark in remarks if remark)))


def stretches(start_m: ArrayLike, value: ArrayLike, length_m: float) -> Stretches:
    """A quantity from the beginnings of its stretches, neighbours of the same value joined.

    A stretch that begins at the end of the line has no length and is left out.
    """
    start, values = np.round(np.asarray(start_m, dtype=float), DECIMALS), np.asarray(value, dtype=float)
    inside = start < length_m - RESOLUTION_M / 2
    start, values = start[inside], values[inside]
    first = np.concatenate(([True], np.diff(start) > RESOLUTION_M / 2))
    start, values = start[first], values[first]
    new = np.concatenate(([True], values[1:] != values[:-1]))
    return Stretches(start_m=start[new].copy(), value=values[new].copy())


def zones_where(flags: Sequence[bool], edge_m: Floats) -> tuple[Zone, ...]:
    """The stretches of a line on which a flag is set; `edge_m` holds the ends of the n pieces, shape (n + 1,)."""
    flagged = np.concatenate(([0], np.asarray(flags, dtype=int), [0]))
    begins, ends = np.flatnonzero(np.diff(flagged) == 1), np.flatnonzero(np.diff(flagged) == -1)
    found = zip(edge_m[begins].tolist(), edge_m[ends].tolist(), strict=True)
    return tuple(
        Zone(start_m=round(a, DECIMALS), length_m=round(b - a, DECIMALS)) for a, b in found if b - a >= RESOLUTION_M
    )


def identity(name: str) -> str:
    """A short name of letters, digits and hyphens, made from a name: "St. Pölten – Melk" becomes "st-polten-melk"."""
    plain = unicodedata.normalize("NFKD", name.casefold()).encode("ascii", "ignore").decode()
    return re.sub(r"[^a-z0-9]+", "-", plain).strip("-")[:MOST_OF_A_NAME] or "line"


def made_route(words: Words, stops: Sequence[Stop], length_m: float, source: str, *, one_way: bool) -> Route:
    """A flat route without altitudes, limits and geometry, for an import to fill in."""
    route_id, name = _titles(words, stops)
    return Route(
        id=route_id,
        name=name,
        source=source,
        illustrative=False,
        length_m=length_m,
        stops=tuple(stops),
        limits_mps=Stretches.constant(1.0),
        gradients_ratio=Stretches.constant(0.0),
        time_zone="UTC" if words.time_zone is None else words.time_zone,
        data_source=words.source or "",
        licence=words.licence or "",
        one_way=one_way,
        altitudes=Altitudes.NONE,
    )


def _titles(words: Words, stops: Sequence[Stop]) -> tuple[str, str]:
    """Id and name of a line: as stated by the user, or else made from its first and last stop."""
    name = words.name or f"{stops[0].name} – {stops[-1].name}"[:MOST_OF_A_NAME]
    return words.id or identity(name), name


def cut(line: ImportedLine, start: Stop, end: Stop, words: Words) -> ImportedLine:
    """The part of a line between two of its stops; DasError if they are not in the order of the line."""
    route, a, b = line.route, start.position_m, end.position_m
    if b <= a:
        raise DasError(f"{route.source}: {end.name} does not come after {start.name}: import the other direction")
    if a <= 0 and b >= route.length_m:
        return line
    stops = tuple(replace(stop, position_m=stop.position_m - a) for stop in route.stops if a <= stop.position_m <= b)
    cut_out: dict[str, Any] = {
        name: _cut_stretches(getattr(route, name), a, b)
        for name in ("limits_mps", "gradients_ratio", "curvature_per_m", "receptivity_ratio")
    }
    for name in ("tunnels", "neutral_sections", "no_regeneration"):
        cut_out[name] = _cut_zones(getattr(route, name), a, b)
    at_m = route.geometry_position_m
    inside = at_m[(at_m > a) & (at_m < b)]
    kept_m = np.union1d(inside, (max(a, at_m[0]), min(b, at_m[-1]))) if len(inside) else inside
    latitude_deg, longitude_deg = route.location_deg(kept_m) or (np.empty(0), np.empty(0))
    route_id, name = _titles(words, stops)
    shorter = replace(
        route,
        id=route_id,
        name=name,
        length_m=round(b - a, DECIMALS),
        stops=stops,
        altitude_at_start_m=float(route.altitude_m(a)),
        restrictions=(),
        geometry_position_m=kept_m - a,
        geometry_latitude_deg=latitude_deg,
        geometry_longitude_deg=longitude_deg,
        **cut_out,
    )
    return replace(line, route=shorter, structures=_cut_zones(line.structures, a, b)).with_remarks(
        f"Cut from km {a / KM:.3f} to km {b / KM:.3f} of the tables."
    )


def _cut_stretches(given: Stretches, start_m: float, end_m: float) -> Stretches:
    inside = given.start_m[(given.start_m > start_m) & (given.start_m < end_m)]
    starts = np.concatenate(([start_m], inside))
    return Stretches(start_m=starts - start_m, value=given.at(starts))


def _cut_zones(zones: Sequence[_Zone], start_m: float, end_m: float) -> tuple[_Zone, ...]:
    kept = []
    for zone in zones:
        a, b = max(zone.start_m, start_m), min(zone.start_m + zone.length_m, end_m)
        if b - a >= RESOLUTION_M:
            kept.append(replace(zone, start_m=a - start_m, length_m=b - a))
    return tuple(kept)


WIDTH = 118
"""Longest line of a file (characters)."""


def route_toml(route: Route, remarks: Sequence[str] = ()) -> str:
    """A route as the text of its file; positions to 1 mm. `remarks` are sentences that begin the file as comments."""
    lines = [f"# {route.name}"]
    for remark in remarks:
        lines += textwrap.wrap(remark, WIDTH - 2, initial_indent="# ", subsequent_indent="# ", break_on_hyphens=False)
    lines += ["# Each list gives the beginnings of stretches: a value holds until the next row."]
    lines += [f"schema_version = {SCHEMA_VERSION}", "", *_head(route)]
    for stop in route.stops:
        lines += ["", *_stop(stop)]
    limits, gradients, curves = route.limits_mps, route.gradients_ratio, route.curvature_per_m
    lines += _table("speed_limits", ("position_km", "limit_kmh"), (limits.start_m / KM, kmh(limits.value)))
    slopes = gradients.start_m / KM, gradients.value / PERMILLE
    lines += _table("gradients", ("position_km", "gradient_permille"), slopes)
    if curves.value.any():
        with np.errstate(divide="ignore"):
            radius_m = 1.0 / curves.value
        ends = curves.start_m / KM, radius_m, radius_m
        lines += _table("curves", ("position_km", "radius_start_m", "radius_end_m"), ends)
    if route.tunnels:
        columns = [(x.start_m / KM, x.length_m / KM, x.area_m2) for x in route.tunnels]
        names = ("position_km", "length_km", "cross_section_m2")
        lines += _table("tunnels", names, tuple(np.array(columns).T))
    if len(route.receptivity_ratio.value) > 1 or route.receptivity_ratio.value[0] != 1:
        taken = route.receptivity_ratio
        lines += _table("receptivity", ("position_km", "receptivity_ratio"), (taken.start_m / KM, taken.value))
    for key, zones in (("neutral_sections", route.neutral_sections), ("no_regeneration", route.no_regeneration)):
        if zones:
            places = [(zone.start_m / KM, zone.length_m) for zone in zones]
            lines += _table(key, ("position_km", "length_m"), tuple(np.array(places).T))
    if len(route.geometry_position_m):
        place = route.geometry_position_m / KM, route.geometry_latitude_deg, route.geometry_longitude_deg
        lines += _table("geometry", ("position_km", "latitude_deg", "longitude_deg"), place)
    return "\n".join(lines) + "\n"


def _head(route: Route) -> Iterator[str]:
    yield "[route]"
    yield f"id = {toml_string(route.id)}"
    yield f"name = {toml_string(route.name)}"
    for key, text in (("source", route.data_source), ("licence", route.licence)):
        if text:
            yield f"{key} = {toml_string(text)}"
    for key, flag in (("illustrative", route.illustrative), ("one_way", route.one_way)):
        if flag:
            yield f"{key} = true"
    yield f"length_km = {_number(route.length_m / KM)}"
    if route.altitude_at_start_m:
        yield f"altitude_at_start_m = {_number(route.altitude_at_start_m)}"
    if route.altitudes is not None:
        yield f"altitudes = {toml_string(route.altitudes)}"
    if route.time_zone != "UTC":
        yield f"time_zone = {toml_string(route.time_zone)}"


def _stop(stop: Stop) -> Iterator[str]:
    yield "[[stops]]"
    yield f"name = {toml_string(stop.name)}"
    yield f"position_km = {_number(stop.position_m / KM)}"
    if stop.latitude_deg is not None and stop.longitude_deg is not None:
        yield f"latitude_deg = {_number(stop.latitude_deg)}"
        yield f"longitude_deg = {_number(stop.longitude_deg)}"


def _table(key: str, names: Sequence[str], columns: Iterable[Iterable[float]]) -> list[str]:
    """A list with its columns: as many rows in a line as fit."""
    rows = [f"[{', '.join(map(_number, row))}]," for row in zip(*columns, strict=True)]
    body = [rows[0]]
    for row in rows[1:]:
        if len(body[-1]) + len(row) < WIDTH - 4:
            body[-1] += f" {row}"
        else:
            body.append(row)
    quoted = ", ".join(f'"{name}"' for name in names)
    return ["", f"[{key}]", f"columns = [{quoted}]", "rows = [", *(f"    {line}" for line in body), "]"]


def _number(value: float) -> str:
    """A number of TOML with at most seven decimals (1e-7 km is 0.1 mm)."""
    if not np.isfinite(value):
        return "inf"
    text = f"{value:.7f}".rstrip("0")
    text = text + "0" if text.endswith(".") else text
    return "0.0" if text == "-0.0" else text
