"""The line: stops, speed limits, gradients, curves, tunnels, power supply, geometry, as functions of position."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from enum import StrEnum
from typing import TypeVar
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import ArrayLike, NDArray

from das.domain.errors import DasError, InputError, check_number
from das.domain.restriction import Restriction
from das.domain.summary import Summary
from das.domain.units import KM, KMH, kmh

Floats = NDArray[np.float64]

POSITION_TOLERANCE_M = 1e-6
"""Distance (m) below which two positions are the same point."""
AT_STOP_M = 1.0
"""Largest distance (m) from a stop at which a position counts as at the stop."""
NO_REGENERATION = -1.0
"""Supply (see `Route.supply`) of a stretch on which the electric brake must not be used."""
NEUTRAL = -2.0
"""Supply (see `Route.supply`) of a neutral section: neither traction nor electric brake."""


class Altitudes(StrEnum):
    """The source of a line's gradients, which indicates how large errors of energies may be."""

    LEVEL = "level"
    """The real line is level."""
    NONE = "none"
    """No altitudes were known: the line is assumed flat."""
    POINTS = "points"
    """A few points (stations, summits) joined by straight lines."""
    SMOOTHED = "smoothed"
    """Closely spaced altitudes, smoothed."""
    RAW = "raw"
    """Closely spaced altitudes, as measured."""


@dataclass(frozen=True, kw_only=True)
class Stop:
    """A place where trains stop, with WGS 84 coordinates (deg; None if the file has none)."""

    name: str
    position_m: float
    latitude_deg: float | None = None
    longitude_deg: float | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Stretches:
    """A piecewise constant quantity: `value[i]` applies from `start_m[i]` to the next start or the end of the line."""

    start_m: Floats
    value: Floats

    def __post_init__(self) -> None:
        self.start_m.setflags(write=False)
        self.value.setflags(write=False)

    @classmethod
    def constant(cls, value: float) -> Stretches:
        """One value on the whole line."""
        return cls(start_m=np.zeros(1), value=np.array([value]))

    def at(self, position_m: ArrayLike) -> Floats:
        """Value at each position; the first and the last value continue beyond the ends."""
        i = np.searchsorted(self.start_m, np.asarray(position_m, dtype=float), side="right") - 1
        return np.asarray(self.value[np.clip(i, 0, len(self.value) - 1)], dtype=float)

    def mean(self, from_m: ArrayLike, to_m: ArrayLike) -> Floats:
        """Mean over each interval (from < to); the first and the last value continue beyond the ends."""
        from_m, to_m = np.asarray(from_m, dtype=float), np.asarray(to_m, dtype=float)
        return np.asarray((self.integral(to_m) - self.integral(from_m)) / (to_m - from_m), dtype=float)

    def integral(self, position_m: Floats) -> Floats:
        """Integral of the quantity from 0 to each position (m); the first and last values continue beyond the ends."""
        lengths = np.diff(self.start_m)
        upto = np.concatenate(([0.0], np.cumsum(lengths * self.value[:-1])))
        i = np.clip(np.searchsorted(self.start_m, position_m, side="right") - 1, 0, len(self.value) - 1)
        return upto[i] + (position_m - self.start_m[i]) * self.value[i]

    def minimum(self, from_m: Floats, to_m: Floats) -> Floats:
        """Smallest value on each interval (from < to)."""
        first = np.clip(np.searchsorted(self.start_m, from_m + POSITION_TOLERANCE_M, side="right") - 1, 0, None)
        last = np.maximum(np.searchsorted(self.start_m, to_m - POSITION_TOLERANCE_M, side="left"), first + 1)
        edges = np.stack((first, last), axis=1).ravel()
        # Every second reduction covers the range from the end of an interval to the beginning of the next.
        return np.asarray(np.minimum.reduceat(np.append(self.value, np.inf), edges)[::2], dtype=float)

    def reversed(self, length_m: float, sign: float = 1.0) -> Stretches:
        """The quantity with positions counted from the other end of a line of `length_m`."""
        inside = self.start_m < length_m - POSITION_TOLERANCE_M  # a stretch that begins at the end has no length
        start, value = self.start_m[inside], self.value[inside]
        ends = np.append(start[1:], length_m)
        return Stretches(start_m=(length_m - ends)[::-1].copy(), value=sign * value[::-1])


@dataclass(frozen=True, kw_only=True)
class Zone:
    """A stretch of the line that begins at `start_m` and is `length_m` long."""

    start_m: float
    length_m: float


@dataclass(frozen=True, kw_only=True)
class Tunnel(Zone):
    """A tunnel with a free cross section `area_m2`."""

    area_m2: float


_Zone = TypeVar("_Zone", bound=Zone)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Route(Summary):
    """A line from position 0 to `length_m`.

    `curvature_per_m` holds the mean |κ| of each stretch (for a clothoid, its mean curvature). `receptivity_ratio` is
    the share of the power fed back that the line accepts (0 to 1). While the head of the train is in one of the
    `neutral_sections` there is neither traction nor electric brake, and in one of the `no_regeneration` zones there is
    no electric brake. `geometry_*` is a polyline (position, WGS 84 latitude and longitude), empty where unknown.
    `restrictions` are the temporary speed restrictions contained in `limits_mps`. `time_zone` is the IANA name of the
    line's time zone. `source` is the file; `data_source` and `licence` are the source and licence of the data, as
    stated in the file. A `one_way` line describes one direction only and cannot be reversed.
    """

    id: str
    name: str
    source: str
    illustrative: bool
    length_m: float
    stops: tuple[Stop, ...]
    limits_mps: Stretches
    gradients_ratio: Stretches
    curvature_per_m: Stretches = field(default_factory=lambda: Stretches.constant(0.0))
    tunnels: tuple[Tunnel, ...] = ()
    receptivity_ratio: Stretches = field(default_factory=lambda: Stretches.constant(1.0))
    neutral_sections: tuple[Zone, ...] = ()
    no_regeneration: tuple[Zone, ...] = ()
    altitude_at_start_m: float = 0.0
    restrictions: tuple[Restriction, ...] = ()
    time_zone: str = "UTC"
    data_source: str = ""
    licence: str = ""
    one_way: bool = False
    altitudes: Altitudes | None = None
    geometry_position_m: Floats = field(default_factory=lambda: np.empty(0))
    geometry_latitude_deg: Floats = field(default_factory=lambda: np.empty(0))
    geometry_longitude_deg: Floats = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        if not np.isfinite(self.length_m) or self.length_m <= 0:
            raise InputError(self.source, "length", self.length_m, "a length > 0 m")
        if len(self.stops) < 2:
            raise InputError(self.source, "stops", len(self.stops), "at least two stops")
        _check_positions(self.source, "stops", np.array([s.position_m for s in self.stops]), self.length_m)
        for key, stretches in self.quantities():
            _check_positions(self.source, key, stretches.start_m, self.length_m, first_at_zero=True)
            _check_finite(self.source, key, stretches.value)
        limits_mps, share = self.limits_mps.value, self.receptivity_ratio.value
        _check_each(self.source, "speed limits", limits_mps / KMH, limits_mps > 0, "a speed > 0", unit=" (km/h)")
        if not np.isfinite(self.altitude_at_start_m):
            raise InputError(self.source, "altitude", self.altitude_at_start_m, "a finite number")
        _check_zones(self.source, "tunnels", self.tunnels, self.length_m)
        for i, tunnel in enumerate(self.tunnels):
            check_number(self.source, f"tunnels[{i}] area_m2", tunnel.area_m2, positive=True)
        _check_zones(self.source, "neutral_sections", self.neutral_sections, self.length_m)
        _check_zones(self.source, "no_regeneration", self.no_regeneration, self.length_m)
        _check_each(self.source, "receptivity", share, (share >= 0) & (share <= 1), "a ratio from 0 to 1")
        if len(self.geometry_position_m):
            _check_positions(self.source, "geometry", self.geometry_position_m, self.length_m)
        latitude, longitude = self.geometry_latitude_deg, self.geometry_longitude_deg
        for array in (self.geometry_position_m, latitude, longitude):
            _check_finite(self.source, "geometry", array)
            array.setflags(write=False)
        _check_each(self.source, "geometry latitude_deg", latitude, np.abs(latitude) <= 90, "-90 to 90")
        _check_each(self.source, "geometry longitude_deg", longitude, np.abs(longitude) <= 180, "-180 to 180")

    def facts(self) -> dict[str, str]:
        """Name, length, stops and highest limit."""
        return {
            "name": self.name,
            "length": f"{self.length_m / KM:.3f} km",
            "stops": ", ".join(f"{stop.name} (km {stop.position_m / KM:.3f})" for stop in self.stops),
            "highest limit": f"{kmh(float(self.limits_mps.value.max())):.0f} km/h",
            **({"data": self.credit} if self.credit else {}),
        }

    @property
    def credit(self) -> str:
        """Source and licence of the line's data as stated in its file, for pictures and reports; may be empty."""
        return ", ".join(text for text in (self.data_source, self.licence) if text)

    @property
    def zone(self) -> ZoneInfo:
        """The time zone of the line."""
        return ZoneInfo(self.time_zone)

    def midnight_ns(self, time_ns: int) -> int:
        """The midnight (ns since 1970) before a time, in the line's time zone.

        The result is twelve hours before noon: if clocks change, a timetable's day begins an hour off midnight.
        """
        day = datetime.fromtimestamp(time_ns // 10**9, self.zone).date()
        noon = datetime(day.year, day.month, day.day, 12, tzinfo=self.zone)
        return (round(noon.timestamp()) - 12 * 3600) * 10**9

    def quantities(self) -> tuple[tuple[str, Stretches], ...]:
        """Speed limits, gradients, curves and receptivity, each with its name in messages."""
        return (
            ("speed limits", self.limits_mps),
            ("gradients", self.gradients_ratio),
            ("curves", self.curvature_per_m),
            ("receptivity", self.receptivity_ratio),
        )

    def breakpoints_m(self) -> Floats:
        """Every position where a limit, gradient, curve, tunnel or the supply changes, sorted."""
        parts = [stretches.start_m for _, stretches in self.quantities()]
        zones = (*self.tunnels, *self.neutral_sections, *self.no_regeneration)
        parts += [np.array([zone.start_m, zone.start_m + zone.length_m]) for zone in zones]
        return np.unique(np.concatenate(parts))

    def supply(self) -> Stretches:
        """The power supply along the line: the receptivity (0 to 1), `NO_REGENERATION` or `NEUTRAL`."""
        starts = self.breakpoints_m()
        value = self.receptivity_ratio.at(starts)
        for zones, code in ((self.no_regeneration, NO_REGENERATION), (self.neutral_sections, NEUTRAL)):
            for zone in zones:
                inside = (starts >= zone.start_m) & (starts < zone.start_m + zone.length_m - POSITION_TOLERANCE_M)
                value = np.where(inside, code, value)
        return Stretches(start_m=starts, value=value)

    def stop(self, wanted: str) -> Stop:
        """The stop with this name (case does not matter), or with this number counted from 1."""
        for candidate in self.stops:
            if candidate.name.casefold() == wanted.casefold():
                return candidate
        if wanted.isdecimal() and 1 <= int(wanted) <= len(self.stops):
            return self.stops[int(wanted) - 1]
        names = ", ".join(f"{i}: {s.name}" for i, s in enumerate(self.stops, 1))
        raise DasError(f"{self.source}: no stop {wanted!r}; it has {names}")

    def stop_name_at(self, position_m: float) -> str:
        """The name of the stop at a position (m); empty if there is none."""
        near = (stop.name for stop in self.stops if abs(stop.position_m - position_m) <= AT_STOP_M)
        return next(near, "")

    def reversed(self) -> Route:
        """The line in the opposite direction, positions counted from its other end; DasError for a `one_way` line."""
        if self.one_way:
            raise DasError(
                f"{self.source}: one_way = true: its limits are those from {self.stops[0].name} to "
                f"{self.stops[-1].name}, and it cannot be reversed; import or write a file for the other direction"
            )
        length = self.length_m
        return replace(
            self,
            name=f"{self.name} (reversed)",
            stops=tuple(replace(s, position_m=length - s.position_m) for s in reversed(self.stops)),
            limits_mps=self.limits_mps.reversed(length),
            gradients_ratio=self.gradients_ratio.reversed(length, sign=-1.0),
            curvature_per_m=self.curvature_per_m.reversed(length),
            tunnels=_zones_reversed(self.tunnels, length),
            receptivity_ratio=self.receptivity_ratio.reversed(length),
            neutral_sections=_zones_reversed(self.neutral_sections, length),
            no_regeneration=_zones_reversed(self.no_regeneration, length),
            restrictions=tuple(
                replace(x, start_m=length - x.end_m, end_m=length - x.start_m) for x in self.restrictions
            ),
            altitude_at_start_m=float(self.altitude_m(length)),
            geometry_position_m=length - self.geometry_position_m[::-1],
            geometry_latitude_deg=self.geometry_latitude_deg[::-1].copy(),
            geometry_longitude_deg=self.geometry_longitude_deg[::-1].copy(),
        )

    def with_restrictions(self, restrictions: Sequence[Restriction]) -> Route:
        """The line with temporary limits, regardless of their windows; the lowest limit at each position applies."""
        limits = self.limits_mps
        edges = np.array([edge for one in restrictions for edge in (one.start_m, one.end_m)])
        inside = edges[(edges > 0) & (edges < self.length_m)]
        start_m = np.unique(np.concatenate((limits.start_m, inside)))
        value = limits.at(start_m)
        for one in restrictions:
            within = (start_m >= one.start_m) & (start_m < one.end_m)
            value = np.where(within, np.minimum(value, one.limit_mps), value)
        together = (*self.restrictions, *restrictions)
        return replace(self, limits_mps=Stretches(start_m=start_m, value=value), restrictions=together)

    def limits_over_train(self, train_length_m: float) -> Stretches:
        """Lowest speed limit (m/s) over a train of a length (m, 0: a point mass), by the position of its head."""
        limits = self.limits_mps
        start_m = np.unique(np.concatenate((limits.start_m, limits.start_m + train_length_m)))
        inside = np.append(0.5 * (start_m[:-1] + start_m[1:]), start_m[-1] + 1.0)
        lowest = limits.minimum(inside - train_length_m, inside + POSITION_TOLERANCE_M)
        return Stretches(start_m=start_m, value=lowest)

    def altitude_m(self, position_m: ArrayLike) -> Floats:
        """Altitude above sea level (m), from the altitude at the start and the gradients."""
        return self.altitude_at_start_m + self.gradients_ratio.integral(np.asarray(position_m, dtype=float))

    def location_deg(self, position_m: ArrayLike) -> tuple[Floats, Floats] | None:
        """Latitude and longitude at each position, or None if the route has no geometry."""
        if not len(self.geometry_position_m):
            return None
        x = np.asarray(position_m, dtype=float)
        return (
            np.interp(x, self.geometry_position_m, self.geometry_latitude_deg),
            np.interp(x, self.geometry_position_m, self.geometry_longitude_deg),
        )


def section_stops(route: Route, from_stop: str | None, to_stop: str | None) -> tuple[Stop, Stop]:
    """The two stops of a section by name or number, by default the route's first and last.

    Raises DasError for an unknown stop, or if the stops are not in the route's direction.
    """
    start = route.stop(from_stop) if from_stop is not None else route.stops[0]
    end = route.stop(to_stop) if to_stop is not None else route.stops[-1]
    if end.position_m <= start.position_m:
        way = "the line is one_way" if route.one_way else "see --reverse"
        raise DasError(f"{route.source}: {end.name!r} does not come after {start.name!r} in this direction; {way}")
    return start, end


def _check_positions(
    source: str, key: str, position_m: Floats, length_m: float, *, first_at_zero: bool = False
) -> None:
    _check_finite(source, f"{key}: position", position_m)
    if not len(position_m):
        raise InputError(source, key, "[]", "at least one entry")
    bad = np.flatnonzero(np.diff(position_m) <= 0)
    if len(bad):
        i = int(bad[0]) + 1
        raise InputError(source, f"{key}[{i}] position", f"{position_m[i]:g} m", f"more than {position_m[i - 1]:g} m")
    if first_at_zero and position_m[0] != 0:
        raise InputError(source, f"{key}[0] position", f"{position_m[0]:g} m", "0 m, to cover the whole line")
    if position_m[0] < 0:
        raise InputError(source, f"{key}[0] position", f"{position_m[0]:g} m", "a position >= 0 m")
    if position_m[-1] > length_m + POSITION_TOLERANCE_M:
        last = f"{key}[{len(position_m) - 1}] position"
        raise InputError(source, last, f"{position_m[-1]:g} m", f"at most {length_m:g} m")


def _zones_reversed(zones: tuple[_Zone, ...], length_m: float) -> tuple[_Zone, ...]:
    return tuple(replace(zone, start_m=length_m - zone.start_m - zone.length_m) for zone in reversed(zones))


def _check_zones(source: str, key: str, zones: Sequence[Zone], length_m: float) -> None:
    """Raise InputError unless the zones lie on the line in order, do not overlap and have lengths > 0."""
    free_from_m = 0.0
    for i, zone in enumerate(zones):
        check_number(source, f"{key}[{i}] length_m", zone.length_m, positive=True)
        if not zone.start_m >= free_from_m:
            raise InputError(source, f"{key}[{i}] position", f"{zone.start_m:g} m", f"at least {free_from_m:g} m")
        free_from_m = zone.start_m + zone.length_m
        if free_from_m > length_m + POSITION_TOLERANCE_M:
            raise InputError(source, f"{key}[{i}] end", f"{free_from_m:g} m", f"at most {length_m:g} m")


def _check_finite(source: str, key: str, values: Floats) -> None:
    _check_each(source, key, values, np.isfinite(values), "a finite number")


def _check_each(
    source: str, key: str, values: Floats, good: NDArray[np.bool_], expected: str, *, unit: str = ""
) -> None:
    """Raise InputError for the first value that is not good; `unit` is appended to its key."""
    bad = np.flatnonzero(~good)
    if len(bad):
        raise InputError(source, f"{key}[{bad[0]}]{unit}", float(values[bad[0]]), expected)
