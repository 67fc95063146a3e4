"""A route in figures, as a table, what is unusual in it, and what it lacks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from das.command_line.printing import new_table
from das.domain.plausibility import energy_range, unusual_in
from das.domain.route import Route
from das.domain.units import KM, KMH, PERMILLE, kmh
from precompute.polylines import nearest_on_line
from precompute.route_import.altitudes import climb_and_fall_m

if TYPE_CHECKING:
    from rich.table import Table

OFF_LINE_M: Final = 500.0
"""Distance (m) from the line at its position beyond which a stop's coordinates lie elsewhere."""
SHORT_LIMIT_M: Final = 20.0
"""Length (m) below which a limit is mostly a slip."""
KINK_RATIO: Final = 0.03
"""Change of gradient (m/m) at one point above which it is no track: real ones are rounded out."""
MOST_SIDEWAYS_MPS2: Final = 2.3
"""Sideways acceleration (m/s²) that a limit may give in a curve: 1.0 by cant (150 mm) and 1.3 uncompensated."""


def as_dict(route: Route) -> dict[str, Any]:
    """A route in figures, as `--json` prints it."""
    climb_m, fall_m = climb_and_fall_m(route)
    gradients = route.gradients_ratio.value / PERMILLE
    curves = route.curvature_per_m.value
    return {
        "id": route.id,
        "name": route.name,
        "illustrative": route.illustrative,
        "length_m": route.length_m,
        "stops": [{"name": stop.name, "position_m": stop.position_m} for stop in route.stops],
        "limits": len(route.limits_mps.value),
        "lowest_limit_kmh": float(kmh(route.limits_mps.value.min())),
        "highest_limit_kmh": float(kmh(route.limits_mps.value.max())),
        "gradients": len(gradients),
        "steepest_up_permille": max(float(gradients.max()), 0.0),
        "steepest_down_permille": min(float(gradients.min()), 0.0),
        "climb_m": climb_m,
        "fall_m": fall_m,
        "altitudes": route.altitudes and str(route.altitudes),
        "smallest_radius_m": 1.0 / float(curves.max()) if curves.max() > 0 else None,
        "tunnels": len(route.tunnels),
        "tunnels_m": sum(tunnel.length_m for tunnel in route.tunnels),
        "geometry_points": len(route.geometry_position_m),
        "one_way": route.one_way,
        "time_zone": route.time_zone,
        "source": route.data_source,
        "licence": route.licence,
    }


def table(route: Route) -> Table:
    """A route in a few rows."""
    found = as_dict(route)
    shown = new_table(f"{route.id}: {route.name}", ("", ""), ())
    shown.show_header, shown.columns[0].no_wrap = False, True
    radius_m = found["smallest_radius_m"]
    rows = {
        "length": f"{route.length_m / KM:.3f} km, {'one way' if route.one_way else 'both ways'}",
        "stops": ", ".join(f"{stop.name} ({stop.position_m / KM:.3f})" for stop in route.stops),
        "limits": f"{found['limits']}: {found['lowest_limit_kmh']:.0f} to {found['highest_limit_kmh']:.0f} km/h",
        "gradients": (
            f"{found['gradients']}: {found['steepest_up_permille']:+.1f} to {found['steepest_down_permille']:+.1f} ‰, "
            f"climb {found['climb_m']:.1f} m, fall {found['fall_m']:.1f} m"
        ),
        "curves": "none" if radius_m is None else f"{len(route.curvature_per_m.value)}: radius from {radius_m:.0f} m",
        "tunnels": f"{found['tunnels']}, {found['tunnels_m'] / KM:.2f} km" if found["tunnels"] else "none",
        "geometry": f"{found['geometry_points']} points" if found["geometry_points"] else "none",
        "data": route.credit or "source and licence not stated",
    }
    for name, text in rows.items():
        shown.add_row(name, text)
    return shown


def warnings(route: Route) -> list[str]:
    """A sentence for everything unusual in a route."""
    return [*unusual_in(route), *_stops(route), *_limits(route), *_gradients(route)]


def notes(route: Route) -> list[str]:
    """A sentence for everything that a route lacks."""
    return [*filter(None, [energy_range(route)]), *_lacks(route)]


def _stops(route: Route) -> Iterator[str]:
    names = Counter(stop.name.casefold() for stop in route.stops)
    for name in (name for name, count in names.items() if count > 1):
        yield f"stops: {names[name]} are called {name!r}; --from and --to find only the first"
    if len(route.geometry_position_m) < 2:
        return
    line = route.geometry_position_m, route.geometry_latitude_deg, route.geometry_longitude_deg
    for stop in route.stops:
        if stop.latitude_deg is not None and stop.longitude_deg is not None:
            found_m, away_m = nearest_on_line(line, stop.latitude_deg, stop.longitude_deg)
            off_m = max(away_m, abs(found_m - stop.position_m))
            if off_m > OFF_LINE_M:
                where = f"{away_m:.0f} m beside km {found_m / KM:.3f}"
                yield f"stops: {stop.name} is at km {stop.position_m / KM:.3f}, its coordinates {where}"


def _limits(route: Route) -> Iterator[str]:
    limits, curves = route.limits_mps, route.curvature_per_m
    lengths_m = np.diff(np.append(limits.start_m, route.length_m))
    short = np.flatnonzero(lengths_m < SHORT_LIMIT_M)
    if len(short):
        i = int(short[0])
        first_km = limits.start_m[i] / KM
        yield (
            f"speed_limits: {len(short)} shorter than {SHORT_LIMIT_M:g} m, the first at km {first_km:.3f}: "
            f"{kmh(float(limits.value[i])):.0f} km/h on {lengths_m[i]:.0f} m"
        )
    at_m = np.union1d(limits.start_m, curves.start_m)
    sideways_mps2 = limits.at(at_m) ** 2 * curves.at(at_m)
    worst = int(sideways_mps2.argmax())
    if sideways_mps2[worst] > MOST_SIDEWAYS_MPS2:
        yield (
            f"curves: {limits.at(at_m)[worst] / KMH:.0f} km/h at km {at_m[worst] / KM:.3f} in a radius of "
            f"{1 / curves.at(at_m)[worst]:.0f} m gives {sideways_mps2[worst]:.1f} m/s² sideways"
        )


def _gradients(route: Route) -> Iterator[str]:
    kinks = np.abs(np.diff(route.gradients_ratio.value))
    large = np.flatnonzero(kinks > KINK_RATIO)
    if len(large):
        i = int(kinks.argmax())
        yield (
            f"gradients: {len(large)} kinks above {KINK_RATIO / PERMILLE:g} ‰, the largest at km "
            f"{route.gradients_ratio.start_m[i + 1] / KM:.3f}: {kinks[i] / PERMILLE:.1f} ‰"
        )


def _lacks(route: Route) -> Iterator[str]:
    if not len(route.geometry_position_m):
        yield "no geometry: recorded trips with GPS need kilometre posts (--posts)"
    if not route.data_source:
        yield "no source: say in [route] source where the data come from"
    if not route.licence:
        yield "no licence: say in [route] licence under which terms the data may be used"
    if route.one_way:
        yield "one_way: it cannot be driven with --reverse"
