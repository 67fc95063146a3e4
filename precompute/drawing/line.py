"""Draws a line without trains: limits, gradients, altitude, curves, tunnels, stops, and a map without tiles."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from das.domain.route import Floats, Route, Stretches
from das.domain.units import KM, PERMILLE, kmh
from das.drawing.colors import GRID, INK, LIMIT
from das.drawing.picture import ALTITUDE_MARGIN_M, LEAST_RISE_M, Picture, explain, name_stops, new_figure

MAP_IN: Final = 3.6
"""Height (in) of the map."""
LEAST_STRETCH: Final = 0.05
"""Least share of a degree of latitude with which a degree of longitude is drawn near a pole."""
MOST_STOPS_ON_MAP: Final = 25


def draw_line(route: Route) -> Picture:
    """The picture of a line: its known quantities over the position, and its course on the map."""
    panels = [(2.2, _limits)]
    if float(np.ptp(route.altitude_m(_edges(route.gradients_ratio, route)))) > LEAST_RISE_M:
        panels += [(1.4, _altitude), (1.2, _gradients)]
    if route.curvature_per_m.value.any():
        panels.append((1.0, _curves))
    has_map = len(route.geometry_position_m) > 1
    figure, axes = new_figure([height for height, _ in panels], below_in=MAP_IN if has_map else 0.0)
    over_distance = axes[: len(panels)]
    for axis, (_, draw) in zip(over_distance, panels, strict=True):
        draw(axis, route)
        for tunnel in route.tunnels:
            axis.axvspan(
                tunnel.start_m / KM, (tunnel.start_m + tunnel.length_m) / KM, color=INK, alpha=0.12, linewidth=0.0
            )
        for stop in route.stops:
            axis.axvline(stop.position_m / KM, color=INK, linewidth=0.6, alpha=0.35)
    over_distance[0].set_xlim(-0.01 * route.length_m / KM, 1.01 * route.length_m / KM)
    name_stops(over_distance[0], [(stop.name, stop.position_m / KM) for stop in route.stops])
    over_distance[-1].set_xlabel(f"position, km{' (grey: tunnels)' if route.tunnels else ''}", color=INK)
    if has_map:
        _map(axes[-1], route)
    ways = "one way" if route.one_way else "both ways"
    explain(figure, over_distance[0], f"{route.name}: {route.length_m / KM:.3f} km, {ways}", route.credit)
    return figure


def _edges(stretches: Stretches, route: Route) -> Floats:
    """The beginnings of the stretches, and the end of the line."""
    return np.append(stretches.start_m, route.length_m)


def _step(axis: Any, stretches: Stretches, values: Floats, route: Route, color: str) -> None:
    at_km = _edges(stretches, route) / KM
    axis.step(at_km, np.append(values, values[-1]), where="post", color=color, linewidth=1.2)


def _limits(axis: Any, route: Route) -> None:
    _step(axis, route.limits_mps, kmh(route.limits_mps.value), route, LIMIT)
    axis.set_ylim(0, 1.1 * float(kmh(route.limits_mps.value).max()))
    axis.set_ylabel("limit, km/h", color=INK)


def _altitude(axis: Any, route: Route) -> None:
    at_m = _edges(route.gradients_ratio, route)
    altitude_m = route.altitude_m(at_m)
    low_m = float(altitude_m.min()) - ALTITUDE_MARGIN_M
    axis.fill_between(at_m / KM, altitude_m, low_m, color=INK, alpha=0.15, linewidth=0.0)
    axis.plot(at_m / KM, altitude_m, color=INK, linewidth=0.8)
    axis.set_ylim(bottom=low_m)
    axis.set_ylabel("altitude, m", color=INK)


def _gradients(axis: Any, route: Route) -> None:
    _step(axis, route.gradients_ratio, route.gradients_ratio.value / PERMILLE, route, INK)
    axis.axhline(0.0, color=GRID, linewidth=1.0)
    axis.set_ylabel("gradient, ‰", color=INK)


def _curves(axis: Any, route: Route) -> None:
    _step(axis, route.curvature_per_m, KM * route.curvature_per_m.value, route, INK)
    axis.set_ylim(bottom=0)
    axis.set_ylabel("curvature, 1/km", color=INK)


def _map(axis: Any, route: Route) -> None:
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
