"""A route put together from several, and a new one from nothing but stops and a limit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from das.domain.errors import DasError
from das.domain.plausibility import INSIST, check_route
from das.domain.route import Route, Stop, Stretches, Zone
from das.domain.units import KM, PERCENT
from precompute.route_import.line import ImportedLine, made_route, stretches
from precompute.route_import.order import Words

MOST_SCALE_RATIO: Final = 0.02
"""Share by which the lengths of routes of the same line may differ."""
PARTS: Final = {
    "limits": ("limits_mps",),
    "gradients": ("gradients_ratio", "altitude_at_start_m", "altitudes"),
    "curves": ("curvature_per_m",),
    "tunnels": ("tunnels",),
    "stops": ("stops",),
    "geometry": ("geometry_position_m", "geometry_latitude_deg", "geometry_longitude_deg"),
    "supply": ("receptivity_ratio", "neutral_sections", "no_regeneration"),
}
"""The fields of a route that each option takes from another one."""
OF_ONE_DIRECTION: Final = ("limits", "supply")
"""Properties that differ between the directions of a line; gradients, curves and tunnels are the same, mirrored."""


def merged(base: Route, others: Mapping[str, Route], words: Words) -> ImportedLine:
    """A route with the parts (keys of `PARTS`) of others; DasError if their lengths differ by more than 2 %."""
    remarks = []
    taken: dict[str, Any] = {}
    for what, other in others.items():
        scale = base.length_m / other.length_m
        if abs(scale - 1.0) > MOST_SCALE_RATIO:
            raise DasError(
                f"{other.source}: {other.length_m / KM:.3f} km long, {base.source} {base.length_m / KM:.3f} km: "
                f"expected the same line, within {MOST_SCALE_RATIO / PERCENT:g} %"
            )
        taken |= {name: _scaled(name, getattr(other, name), scale, base.length_m) for name in PARTS[what]}
        by = "" if other.length_m == base.length_m else f", positions times {scale:.6f}"
        remarks.append(f"The {what} are those of {other.id}{by}.")
    routes = (base, *others.values())
    kept = [route for part, route in others.items() if part in OF_ONE_DIRECTION]
    if not set(OF_ONE_DIRECTION) <= set(others):
        kept.append(base)
    together = {
        name: "; ".join(dict.fromkeys(text for route in routes if (text := getattr(route, name))))
        for name in ("data_source", "licence")
    }
    route = replace(
        base,
        **taken,
        id=words.id or base.id,
        name=words.name or base.name,
        data_source=together["data_source"] if words.source is None else words.source,
        licence=together["licence"] if words.licence is None else words.licence,
        time_zone=base.time_zone if words.time_zone is None else words.time_zone,
        illustrative=any(route.illustrative for route in routes),
        one_way=any(route.one_way for route in kept),
    )
    check_route(route, insist=INSIST % "route")
    return ImportedLine(route=route).with_remarks(f"Put together from {base.id} and others.", *remarks)


def _scaled(name: str, value: Any, scale: float, length_m: float) -> Any:
    """A field of a route with its positions scaled, no position beyond the end."""
    if name == "geometry_position_m":
        return value * scale
    if isinstance(value, Stretches):
        return stretches(value.start_m * scale, value.value, length_m)
    if isinstance(value, tuple) and value and isinstance(value[0], Zone):
        return tuple(
            replace(
                zone, start_m=zone.start_m * scale, length_m=min(zone.length_m * scale, length_m - zone.start_m * scale)
            )
            for zone in value
        )
    if isinstance(value, tuple) and value and isinstance(value[0], Stop):
        return tuple(replace(stop, position_m=min(stop.position_m * scale, length_m)) for stop in value)
    return value


def new_line(stops: Sequence[str], limit_mps: float, words: Words) -> ImportedLine:
    """A flat line with one limit between stops given as NAME=KM; DasError for anything else."""
    found = []
    for text in stops:
        name, mark, km = text.rpartition("=")
        try:
            position_m = float(km) * KM
        except ValueError:
            position_m = -1.0
        if not mark or not name.strip() or not 0 <= position_m < np.inf:
            raise DasError(f"{text}: expected NAME=KM, the name of a stop and its position, like Adorf=0")
        found.append(Stop(name=name.strip(), position_m=round(position_m, 3)))
    if len(found) < 2 or found[0].position_m != 0:
        raise DasError("route new: expected two stops or more, the first at 0: Adorf=0 Bestadt=12.5")
    length_m = found[-1].position_m
    route = replace(
        made_route(words, found, length_m, "route new", one_way=False),
        limits_mps=Stretches.constant(limit_mps),
    )
    check_route(route, insist=INSIST % "route")
    return ImportedLine(route=route).with_remarks(
        "To fill in: a row for each change of limit and gradient; then say what the altitudes are (level, points, "
        "smoothed, raw), or leave that out. Further lists: curves, tunnels, geometry, neutral_sections and others "
        "(docs/reference/file-formats.md)."
    )
