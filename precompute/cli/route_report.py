"""A route in figures, as a table and as a picture, with warnings about unusual values and notes on missing data."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from das.command_line.printing import new_table
from das.domain.plausibility import energy_range, unusual_in
from das.domain.route import Floats, Route, Stretches
from das.domain.units import KM, KMH, PERMILLE, kmh
from das.drawing.colors import GRID, INK, LIMIT
from precompute.polylines import nearest_on_line
from precompute.route_import.altitudes import climb_and_fall_m

if TYPE_CHECKING:
    from rich.table import Table

    from das.drawing.picture import Picture

OFF_LINE_M: Final = 500.0
"""Largest distance (m) between a stop's coordinates and its position on the line without a warning."""
SHORT_LIMIT_M: Final = 20.0
"""Length (m) below which a limit is probably a mistake."""
KINK_RATIO: Final = 0.03
"""Largest change of gradient (m/m) at one point in credible data: real tracks are rounded out."""
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
                where = f"{away_m:.0f} m from km {found_m / KM:.3f}"
                yield f"stops: {stop.name} is at km {stop.position_m / KM:.3f}, its coordinates {where}"


def _limits(route: Route) -> Iterator[str]:
    limits, curves = route.limits_mps, route.curvature_per_m
    lengths_m = np.diff(np.append(limits.start_m, route.length_m))
    short = np.flatnonzero(lengths_m < SHORT_LIMIT_M)
    if len(short):
        i = int(short[0])
        first = f"km {limits.start_m[i] / KM:.3f}: {kmh(float(limits.value[i])):.0f} km/h on {lengths_m[i]:.0f} m"
        yield f"speed_limits: {len(short)} shorter than {SHORT_LIMIT_M:g} m, the first at {first}"
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
    if count := int((kinks > KINK_RATIO).sum()):
        i = int(kinks.argmax())
        largest = f"km {route.gradients_ratio.start_m[i + 1] / KM:.3f}: {kinks[i] / PERMILLE:.1f} ‰"
        yield f"gradients: {count} kinks above {KINK_RATIO / PERMILLE:g} ‰, the largest at {largest}"


def notes(route: Route) -> Iterator[str]:
    """A sentence for each kind of data that a route lacks."""
    if uncertain := energy_range(route):
        yield uncertain
    if not len(route.geometry_position_m):
        yield "no geometry: recorded trips with GPS need kilometre posts (--posts)"
    if not route.data_source:
        yield "no source: say in [route] source where the data come from"
    if not route.licence:
        yield "no licence: say in [route] licence under which terms the data may be used"
    if route.one_way:
        yield "one_way: it cannot be driven with --reverse"


MAP_IN: Final = 3.6
"""Height (in) of the map."""
LEAST_STRETCH: Final = 0.05
"""Least width of a drawn degree of longitude, as a share of a degree of latitude: a bound for lines near a pole."""
MOST_STOPS_ON_MAP: Final = 25


def draw_line(route: Route) -> Picture:
    """The picture of a line: its known quantities over the position, and its course on the map without tiles."""
    from das.drawing.picture import LEAST_RISE_M, explain, name_stops, new_figure

    def limits(axis: Any) -> None:
        speeds = kmh(route.limits_mps.value)
        _draw_steps(axis, route.limits_mps, speeds, route, LIMIT, "limit, km/h")
        axis.set_ylim(0, 1.1 * float(speeds.max()))

    def gradients(axis: Any) -> None:
        slopes = route.gradients_ratio.value / PERMILLE
        _draw_steps(axis, route.gradients_ratio, slopes, route, INK, "gradient, ‰")
        axis.axhline(0.0, color=GRID, linewidth=1.0)

    def curves(axis: Any) -> None:
        _draw_steps(axis, route.curvature_per_m, KM * route.curvature_per_m.value, route, INK, "curvature, 1/km")
        axis.set_ylim(bottom=0)

    panels: list[tuple[float, Callable[[Any], None]]] = [(2.2, limits)]
    if float(np.ptp(route.altitude_m(_edges(route.gradients_ratio, route)))) > LEAST_RISE_M:
        panels += [(1.4, lambda axis: _draw_altitude(axis, route)), (1.2, gradients)]
    if route.curvature_per_m.value.any():
        panels.append((1.0, curves))
    has_map = len(route.geometry_position_m) > 1
    figure, axes = new_figure([height for height, _ in panels], below_in=MAP_IN if has_map else 0.0)
    over_distance = axes[: len(panels)]
    for axis, (_, draw) in zip(over_distance, panels, strict=True):
        draw(axis)
        for tunnel in route.tunnels:
            ends_km = tunnel.start_m / KM, (tunnel.start_m + tunnel.length_m) / KM
            axis.axvspan(*ends_km, color=INK, alpha=0.12, linewidth=0.0)
        for stop in route.stops:
            axis.axvline(stop.position_m / KM, color=INK, linewidth=0.6, alpha=0.35)
    over_distance[0].set_xlim(-0.01 * route.length_m / KM, 1.01 * route.length_m / KM)
    name_stops(over_distance[0], [(stop.name, stop.position_m / KM) for stop in route.stops])
    over_distance[-1].set_xlabel(f"position, km{' (grey: tunnels)' if route.tunnels else ''}", color=INK)
    if has_map:
        _draw_map(axes[-1], route)
    ways = "one way" if route.one_way else "both ways"
    explain(figure, over_distance[0], f"{route.name}: {route.length_m / KM:.3f} km, {ways}", route.credit)
    return figure


def _edges(stretches: Stretches, route: Route) -> Floats:
    """The beginnings of the stretches, and the end of the line."""
    return np.append(stretches.start_m, route.length_m)


def _draw_steps(axis: Any, stretches: Stretches, values: Floats, route: Route, color: str, label: str) -> None:
    at_km = _edges(stretches, route) / KM
    axis.step(at_km, np.append(values, values[-1]), where="post", color=color, linewidth=1.2)
    axis.set_ylabel(label, color=INK)


def _draw_altitude(axis: Any, route: Route) -> None:
    from das.drawing.picture import ALTITUDE_MARGIN_M

    at_m = _edges(route.gradients_ratio, route)
    altitude_m = route.altitude_m(at_m)
    low_m = float(altitude_m.min()) - ALTITUDE_MARGIN_M
    axis.fill_between(at_m / KM, altitude_m, low_m, color=INK, alpha=0.15, linewidth=0.0)
    axis.plot(at_m / KM, altitude_m, color=INK, linewidth=0.8)
    axis.set_ylim(bottom=low_m)
    axis.set_ylabel("altitude, m", color=INK)


def _draw_map(axis: Any, route: Route) -> None:
    """The course of the line: east–west and north–south in one scale, and the stops on it."""
    axis.plot(route.geometry_longitude_deg, route.geometry_latitude_deg, color=LIMIT, linewidth=1.5)
    for i, stop in enumerate(route.stops):
        place = route.location_deg([stop.position_m])
        assert place is not None
        (latitude,), (longitude,) = place
        axis.plot(longitude, latitude, "o", color=INK, markersize=4)
        if len(route.stops) <= MOST_STOPS_ON_MAP or i in (0, len(route.stops) - 1):
            axis.annotate(stop.name, (longitude, latitude), (4, 4), textcoords="offset points", color=INK, fontsize=8)
    axis.margins(0.08)
    stretch = np.cos(np.radians(float(route.geometry_latitude_deg.mean())))
    axis.set_aspect(1.0 / max(stretch, LEAST_STRETCH), adjustable="datalim")
    axis.set_xlabel("longitude, ° east", color=INK)
    axis.set_ylabel("latitude, ° north", color=INK)
