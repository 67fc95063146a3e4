"""A clean record of a made-up trip, and functions that plant one kind of defect each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.domain.earth import MEAN_RADIUS_M
from das.domain.route import Floats, Route
from sim.options import TripOptions
from sim.trips.cleaning import FindingKind
from sim.trips.record import read_trip
from sim.trips.trip import Trip, load_trip
from tests.support.made_line import motion, north, posts_file, route

LENGTH_M = 8000.0
EPOCH_S = 1_469_780_000.0
STOOD_S = 10


@dataclass(frozen=True)
class Point:
    """A point of a record before it is written: `s_m` north of stop A along the meridian, `east_m` east of it."""

    t: float
    s_m: float
    v: float | None
    east_m: float = 0.0


Points = list[Point]


def clean(length_m: float = LENGTH_M, start_m: float = 0.0, start_s: float = 0.0, stood_s: int = STOOD_S) -> Points:
    """A trip with one point a second: 0.5 m/s² up to 30 m/s and down again, standing for 10 s before and after."""
    t, s, v = motion(length_m)
    before = [Point(start_s + i, start_m, 0.0) for i in range(stood_s)]
    run = [Point(start_s + stood_s + a, start_m + b, round(c, 9)) for a, b, c in zip(t, s, v, strict=True)]
    after = [Point(run[-1].t + 1 + i, run[-1].s_m, 0.0) for i in range(stood_s)]
    return before + run + after


def changed(points: Points, at: Iterable[int], **by: float | Callable[[Point], float] | None) -> Points:
    """The points, with the values of some of them changed."""
    chosen = set(at)
    return [
        replace(p, **{k: f(p) if callable(f) else f for k, f in by.items()}) if i in chosen else p
        for i, p in enumerate(points)
    ]


def write(folder: Path, points: Points, *, speeds: bool = True, on_route: bool = False) -> Path:
    """Write points as a CSV with a header; the position of a point that has none is left empty."""
    place = ["position_m"] if on_route else ["lat", "lon"]
    rows = [",".join(["time_ms", *place, *(["speed_mps"] if speeds else [])])]
    for p in points:
        latitude, longitude = north(np.array([p.s_m]), p.east_m)
        located = [f"{p.s_m!r}"] if on_route else [f"{latitude[0]!r}", f"{longitude[0]!r}"]
        cells = ["" if np.isnan(p.s_m) else cell for cell in located]
        rows.append(",".join([f"{(EPOCH_S + p.t) * 1e3:.3f}", *cells, *([f"{p.v!r}"] if speeds else [])]))
    path = folder / "trip.csv"
    path.write_text("\n".join(rows).replace("np.float64(", "").replace(")", "").replace("None", "") + "\n")
    return path


def long_posts(folder: Path) -> Path:
    """Write the kilometre posts from 5 km before stop A to 5 km beyond stop B."""
    return posts_file(folder, *north(np.arange(-5000.0, LENGTH_M + 5001.0, 1000.0)))


def load(
    folder: Path, points: Points, on: Route | None = None, *, speeds: bool = True, **said: bool | str | None
) -> Trip:
    path = write(folder, points, speeds=speeds)
    return load_trip(path, read_trip(path), on or route(), TripOptions(posts=long_posts(folder), **said))  # type: ignore[arg-type]


def on_route(folder: Path, points: Points, on: Route | None = None, *, positions: bool = False, **said: Any) -> Trip:
    """The trip read from a CSV of these points, on a route with geometry (or `on`), without kilometre posts."""
    path = write(folder, points, on_route=positions)
    return load_trip(path, read_trip(path), on or route(geometry=True), TripOptions(**said))


def counts(trip: Trip) -> dict[FindingKind, int]:
    return {finding.kind: finding.count for finding in trip.matched.report.cleaning.findings}


def check_truth(trip: Trip, points: Points, tolerance_m: float = 0.02, speed_mps: float = 0.6) -> None:
    """Assert that every remaining point is where the clean record has it, and the smoothed trip is the true motion."""
    t = np.array([p.t for p in points])
    at = (trip.matched.time_ns * 1e-9) - EPOCH_S
    s, v = np.array([p.s_m for p in points]), np.array([p.v for p in points])
    assert trip.matched.s_m == pytest.approx(np.interp(at, t, s), abs=tolerance_m)
    measured = ~trip.matched.dropout
    assert trip.matched.speed_mps[measured] == pytest.approx(np.interp(at, t, v)[measured], abs=1e-6)
    assert trip.matched.speed_mps == pytest.approx(np.interp(at, t, v), abs=1.2)
    true_m, true_mps = truth_of_run(trip, points)
    assert trip.run.speed_mps == pytest.approx(true_mps, abs=speed_mps)
    assert np.abs(trip.run.s_m - true_m).max() < 6.0


def truth_of_run(trip: Trip, points: Points) -> tuple[Floats, Floats]:
    """Positions (m) and speeds (m/s) of the clean record at the times of the smoothed trip."""
    grid = trip.run.time_s + trip.run.start_time_ns * 1e-9 - EPOCH_S
    t, s, v = (np.array([getattr(p, name) for p in points]) for name in ("t", "s_m", "v"))
    return np.interp(grid, t, s), np.interp(grid, t, v)


# Each function plants one kind of defect; the train moves from point 20 to point 320.
def duplicates(p: Points) -> Points:
    return [x for i, q in enumerate(p) for x in ([q, replace(q, s_m=q.s_m + 3)] if i in (40, 41, 200, 300) else [q])]


times_back = partial(changed, at=(60, 61, 240), t=lambda q: q.t - 5.5)
clock_ahead = partial(changed, at=(100,), t=lambda q: q.t + 3600.5)
block_jump = partial(changed, at=range(200, 230), s_m=lambda q: q.s_m - 1500, east_m=60.0)
null_island = partial(changed, at=(90, 91), s_m=-np.radians(59.5) * MEAN_RADIUS_M, east_m=-1e6)
no_position = partial(changed, at=(33, 34, 210), s_m=np.nan)
spikes = partial(changed, at=(45, 46, 230, 315), v=355 / 3.6)
spike_while_standing = partial(changed, at=(4, 343), v=355 / 3.6)
dropouts = partial(changed, at=(55, 56, 57, 190), v=0.0)
no_speeds = partial(changed, at=(80, 81, 260), v=None)


def jumps_along(p: Points) -> Points:
    p = changed(p, (50, 165), s_m=lambda q: q.s_m + 300)
    return changed(p, (120, 121, 122, 280), s_m=lambda q: q.s_m - 150)


def jumps_aside(p: Points) -> Points:
    return changed(changed(p, (70, 71), east_m=900.0), (250,), east_m=-4000.0, s_m=-9000.0)


def frozen(p: Points) -> Points:
    return changed(p, range(151, 159), s_m=p[150].s_m)


def gap(p: Points) -> Points:
    return p[:170] + p[183:]  # 14 s


def newest_first(p: Points) -> Points:
    return p[::-1]


def late_end(p: Points) -> Points:
    return p + [replace(p[-1], t=p[-1].t + 1 + i) for i in range(300)]


def early_start(p: Points) -> Points:
    return [replace(p[0], t=p[0].t - 200 + i) for i in range(200)] + p


DEFECTS: dict[str, tuple[Callable[[Points], Points], dict[FindingKind, int]]] = {
    "nothing": (lambda p: p, {}),
    "duplicates": (duplicates, {FindingKind.DUPLICATE_TIME: 4}),
    "repeated block": (lambda p: p[:150] + p[130:150] + p[150:], {FindingKind.DUPLICATE_TIME: 20}),
    "times back": (times_back, {FindingKind.TIME_BACK: 3}),
    "clock ahead": (clock_ahead, {FindingKind.TIME_BACK: 1}),
    "jumps along": (jumps_along, {FindingKind.POSITION_JUMP: 6}),
    "jumps aside": (jumps_aside, {FindingKind.POSITION_JUMP: 3}),
    "block jump": (block_jump, {FindingKind.POSITION_JUMP: 30}),
    "null island": (null_island, {FindingKind.POSITION_JUMP: 2}),
    "frozen": (frozen, {FindingKind.POSITION_FROZEN: 8}),
    "no position": (no_position, {FindingKind.NO_POSITION: 3}),
    "spikes": (spikes, {FindingKind.SPEED_SPIKE: 4}),
    "spikes while standing": (spike_while_standing, {FindingKind.SPEED_SPIKE: 2}),
    "dropouts": (dropouts, {FindingKind.SPEED_DROPOUT: 4}),
    "no speeds": (no_speeds, {FindingKind.SPEED_MISSING: 3}),
    "gap": (gap, {FindingKind.GAP: 1}),
    "gap while accelerating": (lambda p: p[:30] + p[43:], {FindingKind.GAP: 1}),
    "newest first": (newest_first, {FindingKind.NEWEST_FIRST: 1}),
    "late end": (late_end, {FindingKind.LONG_STAND_AT_END: 280}),
    "early start": (early_start, {FindingKind.LONG_STAND_AT_START: 180}),
}


TOGETHER = (
    *(jumps_along, jumps_aside, no_position, spikes, dropouts, no_speeds, times_back, duplicates, gap),
    *(early_start, late_end),
)


def all_together(points: Points) -> Points:
    for plant in TOGETHER:
        points = plant(points)
    return points


TOGETHER_COUNTS: Counter[FindingKind] = sum(
    (Counter(expected) for plant, expected in DEFECTS.values() if plant in TOGETHER), Counter()
)
