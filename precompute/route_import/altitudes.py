"""Gradients from altitudes: smoothed, interpolated in tunnels and on bridges, and capped, as the remarks state.

Noise of altitudes becomes gradients, and gradients become energy: docs/explanation/own-lines.md has figures. A few
points far apart (stations, summits) are joined by straight lines.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from das.domain.errors import DasError
from das.domain.route import Altitudes, Floats, Route
from das.domain.units import PERMILLE
from precompute.polylines import nearest_on_line
from precompute.route_import.line import DECIMALS, ImportedLine, ImportOrder, stretches
from precompute.route_import.tables import LineTable, check_coordinates
from precompute.route_import.track_map import same_station

GRID_M: Final = 25.0
"""Distance (m) between the points at which altitudes are averaged."""
STRETCHES_PER_LENGTH: Final = 4
"""Number of gradients for each length of smoothing: more would only make planning slower."""
SHORTEST_STRETCH_M: Final = 100.0
FAR_M: Final = 500.0
"""Largest distance (m) from the line at which an altitude still belongs to the line."""
LOWEST_M, HIGHEST_M = -500.0, 9000.0
SAME_POINT_M: Final = 1.0


def with_altitudes(line: ImportedLine, table: LineTable, order: ImportOrder) -> ImportedLine:
    """A line with gradients from the altitudes of a table, by positions, coordinates or names of stops.

    The order contains the length over which altitudes are averaged, and the steepest gradient that remains. Raises
    DasError or InputError for altitudes that are not of this line, or fewer than two.
    """
    at_m, altitude_m = _points(line.route, table)
    inside = np.zeros(len(at_m), dtype=bool)  # in a tunnel or on a bridge
    for zone in line.structures:
        inside |= (at_m > zone.start_m) & (at_m < zone.start_m + zone.length_m)
    kept_m, kept_altitude_m = at_m[~inside], altitude_m[~inside]
    if len(kept_m) < 2:
        kept_m, kept_altitude_m, inside = at_m, altitude_m, np.zeros(len(at_m), dtype=bool)
    spacing_m = float(np.median(np.diff(kept_m)))
    few = spacing_m > 0.5 * (order.smooth_m or ImportOrder.smooth_m)
    length_m = 0.0 if few else order.smooth_m
    cap_ratio = order.cap_permille * PERMILLE
    whole_m = line.route.length_m
    edges_m = _edges(whole_m, length_m) if length_m else np.union1d(kept_m, (0.0, whole_m))
    heights_m = _averaged(kept_m, kept_altitude_m, edges_m, whole_m, length_m)
    slopes = np.diff(heights_m) / np.diff(edges_m)
    capped_m = float(np.diff(edges_m)[np.abs(slopes) > cap_ratio].sum())
    capped = np.round(np.clip(slopes, -cap_ratio, cap_ratio), 7)
    gradients = stretches(edges_m[:-1], capped, whole_m)
    kind = Altitudes.POINTS if few else (Altitudes.SMOOTHED if length_m else Altitudes.RAW)
    route = replace(line.route, gradients_ratio=gradients, altitude_at_start_m=float(heights_m[0]), altitudes=kind)
    how = {
        Altitudes.POINTS: "joined by straight lines, because they are far apart (include summits)",
        Altitudes.SMOOTHED: f"averaged over {length_m:g} m",
        Altitudes.RAW: "as they are (--smooth-m 0)",
    }[kind]
    remark = f"Altitudes: {len(at_m)} of {table.path.name}, one in {spacing_m:.0f} m, {how}"
    remark += f"; {int(inside.sum())} in tunnels and on bridges left out." if inside.any() else "."
    cap = f"Gradients above {cap_ratio / PERMILLE:g} ‰ were cut to it on {capped_m:.0f} m (--cap-permille)."
    return replace(line, route=route).with_remarks(remark, cap if capped_m else "")


def _points(route: Route, table: LineTable) -> tuple[Floats, Floats]:
    check_coordinates(table)
    rows = table.numbered("altitude")
    if not rows:
        raise DasError(f"{table.path}: no altitudes, expected a column altitude_m")
    found: list[tuple[float, float]] = []
    for i, (altitude_m,) in rows:
        if not LOWEST_M <= altitude_m <= HIGHEST_M:
            raise table.error(i, "altitude", f"{altitude_m:g} m", f"{LOWEST_M:g} to {HIGHEST_M:g} m")
        at_m = _position_m(route, table, i)
        if at_m is not None and -SAME_POINT_M <= at_m <= route.length_m + SAME_POINT_M:
            found.append((min(max(at_m, 0.0), route.length_m), altitude_m))
    if len(found) < 2:
        raise DasError(f"{table.path}: {len(found)} of {len(rows)} altitudes are on the line, expected two or more")
    found.sort()
    at_m, altitude_m = np.array(found).T
    group = np.cumsum(np.concatenate(([0], np.diff(at_m) > SAME_POINT_M)))
    count = np.bincount(group)
    if len(count) < 2:
        raise DasError(f"{table.path}: all altitudes are at one place of the line, expected two or more places")
    return np.bincount(group, at_m) / count, np.bincount(group, altitude_m) / count


def _position_m(route: Route, table: LineTable, row: int) -> float | None:
    """The position of an altitude on the line (m); None if it is off the line."""
    at_m, latitude, longitude = (table.cell(row, name) for name in ("position", "latitude", "longitude"))
    if at_m is not None:
        return at_m
    if latitude is not None and longitude is not None:
        if len(route.geometry_position_m) < 2:
            raise DasError(f"{table.path}: altitudes by coordinates, but the line has no geometry")
        line = route.geometry_position_m, route.geometry_latitude_deg, route.geometry_longitude_deg
        found_m, away_m = nearest_on_line(line, latitude, longitude)
        return found_m if away_m <= FAR_M else None
    name = table.names[row] if table.names else ""
    stops = [stop for stop in route.stops if name and same_station(stop.name, name)]
    if name and not stops:
        known = ", ".join(stop.name for stop in route.stops)
        raise table.error(row, "name", name, f"a stop of the line ({known}), or a position or coordinates in the row")
    return stops[0].position_m if stops else None


def _edges(length_m: float, smooth_m: float) -> Floats:
    """Ends of the stretches of constant gradient."""
    count = max(1, round(length_m / max(smooth_m / STRETCHES_PER_LENGTH, SHORTEST_STRETCH_M)))
    return np.round(np.linspace(0.0, length_m, count + 1), DECIMALS)


def _averaged(at_m: Floats, altitude_m: Floats, edges_m: Floats, length_m: float, smooth_m: float) -> Floats:
    """The altitude at each edge: of a straight line fitted to the altitudes around it, within half of `smooth_m`.

    Away from the ends of the line this is the mean. At the ends, with only one side known, a mean would be wrong
    because of the gradient.
    """
    if not smooth_m:
        return np.interp(edges_m, at_m, altitude_m)
    grid_m = np.linspace(0.0, length_m, max(2, round(length_m / GRID_M) + 1))
    on_grid_m = np.interp(grid_m, at_m, altitude_m)
    low = np.searchsorted(grid_m, edges_m - 0.5 * smooth_m - 1e-6)
    high = np.searchsorted(grid_m, edges_m + 0.5 * smooth_m + 1e-6)
    sums = [np.concatenate(([0.0], np.cumsum(x))) for x in (grid_m, on_grid_m, grid_m**2, grid_m * on_grid_m)]
    count = high - low
    mean_x, mean_z, mean_xx, mean_xz = ((total[high] - total[low]) / count for total in sums)
    spread = mean_xx - mean_x**2
    slope = np.where(spread > 1.0, (mean_xz - mean_x * mean_z) / np.maximum(spread, 1.0), 0.0)
    return np.asarray(mean_z + slope * (edges_m - mean_x), dtype=float)


def climb_and_fall_m(route: Route) -> tuple[float, float]:
    """All metres that a line climbs and falls, by its gradients."""
    gradients = route.gradients_ratio
    rise_m = np.diff(np.append(gradients.start_m, route.length_m)) * gradients.value
    return float(rise_m[rise_m > 0].sum()), abs(float(rise_m[rise_m < 0].sum()))
