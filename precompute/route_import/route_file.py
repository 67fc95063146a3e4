"""Writing a route as a TOML file of this project (docs/reference/file-formats.md)."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from das.domain.files.routes import SCHEMA_VERSION
from das.domain.files.writing import toml_string
from das.domain.route import Route, Stop, Zone
from das.domain.units import KM, PERMILLE, kmh

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
    lines += _table(
        "gradients", ("position_km", "gradient_permille"), (gradients.start_m / KM, gradients.value / PERMILLE)
    )
    if curves.value.any():
        with np.errstate(divide="ignore"):
            radius_m = 1.0 / curves.value
        lines += _table(
            "curves", ("position_km", "radius_start_m", "radius_end_m"), (curves.start_m / KM, radius_m, radius_m)
        )
    if route.tunnels:
        columns = [(x.start_m / KM, x.length_m / KM, x.area_m2) for x in route.tunnels]
        names = ("position_km", "length_km", "cross_section_m2")
        lines += _table("tunnels", names, tuple(np.array(columns).T))
    if len(route.receptivity_ratio.value) > 1 or route.receptivity_ratio.value[0] != 1:
        taken = route.receptivity_ratio
        lines += _table("receptivity", ("position_km", "receptivity_ratio"), (taken.start_m / KM, taken.value))
    for key, zones in (("neutral_sections", route.neutral_sections), ("no_regeneration", route.no_regeneration)):
        lines += _zones(key, zones)
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


def _zones(key: str, zones: Sequence[Zone]) -> list[str]:
    if not zones:
        return []
    columns = np.array([(zone.start_m / KM, zone.length_m) for zone in zones]).T
    return _table(key, ("position_km", "length_m"), tuple(columns))


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
    """A number of TOML with seven digits behind the point at most (1e-7 km is 0.1 mm)."""
    if not np.isfinite(value):
        return "inf"
    text = f"{value:.7f}".rstrip("0")
    text = text + "0" if text.endswith(".") else text
    return "0.0" if text == "-0.0" else text
