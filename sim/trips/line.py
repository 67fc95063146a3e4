"""The line as a polyline on the map: from kilometre posts or from a route's geometry; points projected on it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from das.domain.earth import MEAN_RADIUS_M
from das.domain.errors import DasError, InputError
from das.domain.route import Floats, Route
from das.domain.units import KM
from precompute.polylines import nearest_on_segments
from sim.trips.cleaning import MAX_CROSS_TRACK_M, SCALE_TOLERANCE_RATIO
from sim.trips.record import LARGEST_DEG, LATITUDE_NAMES, LONGITUDE_NAMES, CellTable, check_column, number

COLUMNS: Final = {
    "latitude": LATITUDE_NAMES,
    "longitude": LONGITUDE_NAMES,
    "kilometre": ("kilometre", "kilometer", "km", "position_km"),
}
"""The quantities in a list of kilometre posts, and the possible names of their columns."""
_LENGTH_TOLERANCE_RATIO: Final = 0.3
"""Share by which the distance between two posts on the map may differ from their difference in kilometres."""
_PAIRS_AT_ONCE: Final = 1_000_000
"""Largest number of pairs of a point and a segment that are projected together, which bounds the memory."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Line:
    """A polyline with a chainage at each vertex, increasing in driving order; arrays of shape (vertices,).

    `on_route`: the chainage is the position on the route; otherwise it has its own zero. `by_stops`: the position
    follows from the coordinates of stops, perhaps only to some 100 m.
    """

    source: str
    chainage_m: Floats
    latitude_deg: Floats
    longitude_deg: Floats
    on_route: bool
    by_stops: bool = False

    def __post_init__(self) -> None:
        for array in (self.chainage_m, self.latitude_deg, self.longitude_deg):
            array.setflags(write=False)

    @classmethod
    def from_route(cls, route: Route) -> Line:
        """The route's own geometry, with the position on the route as chainage; DasError if the route has none."""
        if len(route.geometry_position_m) < 2:
            raise DasError(
                f"{route.source}: route {route.id!r} has no geometry to match GPS to; give kilometre posts with --posts"
            )
        return cls(
            source=route.source,
            chainage_m=route.geometry_position_m,
            latitude_deg=route.geometry_latitude_deg,
            longitude_deg=route.geometry_longitude_deg,
            on_route=True,
        )

    def turned(self) -> Line:
        """The line in the other direction, with chainages from its other end."""
        return replace(
            self,
            chainage_m=self.chainage_m[-1] - self.chainage_m[::-1],
            latitude_deg=self.latitude_deg[::-1].copy(),
            longitude_deg=self.longitude_deg[::-1].copy(),
        )

    def placed(self, route: Route) -> Line:
        """The line on the positions of a route, by the coordinates of its stops; unchanged if they do not suffice.

        They suffice if two stops or more are near the line, and are as far apart along it as on the route, within 1 %.
        They then also show the direction of the route along the line.
        """
        stops = [s for s in route.stops if s.latitude_deg is not None and s.longitude_deg is not None]
        if len(stops) < 2:
            return self
        places = np.array([(s.position_m, s.latitude_deg, s.longitude_deg) for s in stops], dtype=float)
        chainage, aside = self.match(places[:, 1], places[:, 2])
        near = np.flatnonzero(aside <= MAX_CROSS_TRACK_M)
        if len(near) < 2 or chainage[near[0]] == chainage[near[-1]]:
            return self
        first, last = near[0], near[-1]
        scale = (places[last, 0] - places[first, 0]) / (chainage[last] - chainage[first])
        if abs(abs(scale) - 1.0) > SCALE_TOLERANCE_RATIO:
            return self
        order = slice(None, None, 1 if scale > 0 else -1)
        return replace(
            self,
            chainage_m=(places[first, 0] + scale * (self.chainage_m - chainage[first]))[order],
            latitude_deg=self.latitude_deg[order].copy(),
            longitude_deg=self.longitude_deg[order].copy(),
            on_route=True,
            by_stops=True,
        )

    def match(self, latitude_deg: Floats, longitude_deg: Floats) -> tuple[Floats, Floats]:
        """Chainage and distance (m) of the nearest point of the line, for points of shape (n,).

        The chainage runs evenly along each segment; beyond the ends it continues along the first and the last segment.
        Plane coordinates are equirectangular around the line's centre: east-west lengths at Δφ from it are wrong by
        tan(φ)·Δφ (10 km north of the centre at 60°: 0.3 %). Points and line are distorted equally. The chainage is
        therefore wrong only through the angle of the projection, and the distance by the same fraction of itself.
        """
        x, y = self._plane_m(self.latitude_deg, self.longitude_deg)
        px, py = self._plane_m(latitude_deg, longitude_deg)
        rows = max(1, _PAIRS_AT_ONCE // len(x))
        parts = [self._match_plane(x, y, px[i : i + rows], py[i : i + rows]) for i in range(0, len(px), rows)]
        chainage, distance = zip(*parts, strict=True)
        return np.concatenate(chainage), np.concatenate(distance)

    def _match_plane(self, x: Floats, y: Floats, px: Floats, py: Floats) -> tuple[Floats, Floats]:
        dx, dy = np.diff(x), np.diff(y)
        lowest, highest = np.zeros(len(dx)), np.ones(len(dx))
        lowest[0], highest[-1] = -np.inf, np.inf
        from_x, from_y = x[:-1] - px[:, None], y[:-1] - py[:, None]
        share, distance = nearest_on_segments(from_x, from_y, dx, dy, lowest, highest)
        nearest = distance.argmin(axis=1)
        i = np.arange(len(px))
        chainage = self.chainage_m[nearest] + share[i, nearest] * np.diff(self.chainage_m)[nearest]
        return chainage, distance[i, nearest]

    def _plane_m(self, latitude_deg: Floats, longitude_deg: Floats) -> tuple[Floats, Floats]:
        """East and north (m) of the line's centre: x = R·cos φ₀·Δλ, y = R·Δφ."""
        centre = self.latitude_deg.mean()
        east = np.radians(longitude_deg - self.longitude_deg.mean()) * np.cos(np.radians(centre))
        return MEAN_RADIUS_M * east, MEAN_RADIUS_M * np.radians(latitude_deg - centre)


def read_kilometre_posts(path: Path) -> Line:
    """Read kilometre posts (CSV), which must be in the order in which the trip passes them.

    With a header, its columns are `latitude`, `longitude` (deg) and `kilometre` in any order (see `COLUMNS` for other
    names); without one they are latitude, longitude and line number·10000 + kilometre. Only differences of kilometres
    count: chainage 0 is the first post, whether the kilometres rise or fall. Raises DasError or InputError (file, line,
    value, expectation).
    """
    first, values = _read_columns(path)
    latitude, longitude, kilometre = values
    for name, angle in (("latitude", latitude), ("longitude", longitude)):
        largest = LARGEST_DEG[name]
        check_column(path, name, angle, np.abs(angle) > largest, f"-{largest:g} to {largest:g} deg", first)
    steps = np.diff(kilometre)
    bad = np.append(False, (steps == 0) | (np.sign(steps) != np.sign(steps[0])))
    check_column(path, "kilometre", kilometre, bad, "kilometres that only rise or only fall", first)
    line = Line(
        source=str(path),
        chainage_m=np.abs(kilometre - kilometre[0]) * KM,
        latitude_deg=latitude,
        longitude_deg=longitude,
        on_route=False,
    )
    _check_lengths(path, line, first)
    return line


def _read_columns(path: Path) -> tuple[int, Floats]:
    """The number of the first line that is a post, and latitude, longitude, kilometre of all posts (3 × posts)."""
    table = CellTable.read(path, "list of posts", tuple(COLUMNS))
    columns = {quantity: _column(path, table.names, quantity) for quantity in COLUMNS}
    values = [
        [number(path, f"line {line} {quantity}", cells[column]) for quantity, column in columns.items()]
        for line, cells in enumerate(table.body(), table.first)
    ]
    return table.first, np.array(values).T.copy()


def _column(path: Path, names: tuple[str, ...], quantity: str) -> int:
    """The column of a quantity; InputError if there is none, or more than one."""
    found = [i for i, name in enumerate(names) if name in COLUMNS[quantity]]
    if len(found) != 1:
        expected = f"one column of {quantity} ({', '.join(COLUMNS[quantity])})"
        raise InputError(path, "line 1", ",".join(names), expected)
    return found[0]


def _check_lengths(path: Path, line: Line, first: int) -> None:
    x, y = line._plane_m(line.latitude_deg, line.longitude_deg)
    lengths, nominal = np.hypot(np.diff(x), np.diff(y)), np.diff(line.chainage_m)
    bad = np.flatnonzero(np.abs(lengths - nominal) > _LENGTH_TOLERANCE_RATIO * nominal)
    if len(bad):
        i = int(bad[0])
        expected = f"{nominal[i]:.0f} m by the kilometres, within {_LENGTH_TOLERANCE_RATIO:.0%}"
        raise InputError(path, f"line {i + 1 + first} distance from the post before", f"{lengths[i]:.0f} m", expected)
