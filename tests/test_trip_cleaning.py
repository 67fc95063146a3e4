"""Dirty trips: every defect planted in a clean record, found, counted, and the clean trip given back."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from das.bus import das_pb2
from das.bus.recorder import RecordingFile
from das.bus.topics import POSITION
from das.domain.errors import DasError
from das.domain.route import Route, Stop
from sim.trips import cleaning
from sim.trips.findings import Kind
from sim.trips.line import EARTH_RADIUS_M
from sim.trips.reading import read_trip
from sim.trips.trip import Trip, Whereabouts, load_trip
from sim.trips.writing import write_cleaned
from tests.test_trips import motion, north, posts_file, route

LENGTH_M = 8000.0
EPOCH_S = 1_469_780_000.0
STOOD_S = 10


@dataclass(frozen=True)
class Point:
    """A point of a record before it is written: `s_m` along the meridian from stop A, `east_m` beside it."""

    t: float
    s_m: float
    v: float | None
    east_m: float = 0.0


Points = list[Point]


def clean(length_m: float = LENGTH_M, start_m: float = 0.0, start_s: float = 0.0, stood_s: int = STOOD_S) -> Points:
    """A run once a second with 10 s of standing before and after: a = 0.5 m/s², 30 m/s, whole seconds."""
    t, s, v = motion(length_m)
    before = [Point(start_s + i, start_m, 0.0) for i in range(stood_s)]
    run = [Point(start_s + stood_s + a, start_m + b, round(c, 9)) for a, b, c in zip(t, s, v, strict=True)]
    after = [Point(run[-1].t + 1 + i, run[-1].s_m, 0.0) for i in range(stood_s)]
    return before + run + after


def changed(points: Points, at: Iterable[int], **by: float | Callable[[Point], float] | None) -> Points:
    """Some points with other values."""
    chosen = set(at)
    return [
        replace(p, **{k: f(p) if callable(f) else f for k, f in by.items()}) if i in chosen else p
        for i, p in enumerate(points)
    ]


def write(folder: Path, points: Points, *, speeds: bool = True, on_route: bool = False) -> Path:
    """A CSV with a header; a point without position is written without one."""
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
    """Kilometre posts from 5 km before stop A to 5 km beyond B."""
    return posts_file(folder, *north(np.arange(-5000.0, LENGTH_M + 5001.0, 1000.0)))


def load(
    folder: Path, points: Points, on: Route | None = None, *, speeds: bool = True, **said: bool | str | None
) -> Trip:
    path = write(folder, points, speeds=speeds)
    return load_trip(path, read_trip(path), on or route(), Whereabouts(line=long_posts(folder), **said))  # type: ignore[arg-type]


def counts(trip: Trip) -> dict[Kind, int]:
    return {finding.kind: finding.count for finding in trip.matched.report.cleaning.findings}


def check_truth(trip: Trip, points: Points, tolerance_m: float = 0.02, speed_mps: float = 0.6) -> None:
    """Every point that is left is where the clean record has it; the smooth run is the motion."""
    t = np.array([p.t for p in points])
    at = (trip.matched.time_ns * 1e-9) - EPOCH_S
    s, v = np.array([p.s_m for p in points]), np.array([p.v for p in points])
    assert trip.matched.s_m == pytest.approx(np.interp(at, t, s), abs=tolerance_m)
    measured = ~trip.matched.dropout
    assert trip.matched.speed_mps[measured] == pytest.approx(np.interp(at, t, v)[measured], abs=1e-6)
    assert trip.matched.speed_mps == pytest.approx(np.interp(at, t, v), abs=1.2)
    grid = trip.run.time_s + trip.run.start_time_ns * 1e-9 - EPOCH_S
    assert trip.run.speed_mps == pytest.approx(np.interp(grid, t, v), abs=speed_mps)
    assert np.abs(trip.run.s_m - np.interp(grid, t, s)).max() < 6.0


# Each plants one kind of defect; points 20 to 320 move.
def duplicates(p: Points) -> Points:
    return [x for i, q in enumerate(p) for x in ([q, replace(q, s_m=q.s_m + 3)] if i in (40, 41, 200, 300) else [q])]


def repeated_block(p: Points) -> Points:
    return p[:150] + p[130:150] + p[150:]


def times_back(p: Points) -> Points:
    return changed(p, (60, 61, 240), t=lambda q: q.t - 5.5)


def clock_ahead(p: Points) -> Points:
    return changed(p, (100,), t=lambda q: q.t + 3600.5)


def jumps_along(p: Points) -> Points:
    p = changed(p, (50, 165), s_m=lambda q: q.s_m + 300)
    return changed(p, (120, 121, 122, 280), s_m=lambda q: q.s_m - 150)


def jumps_aside(p: Points) -> Points:
    return changed(changed(p, (70, 71), east_m=900.0), (250,), east_m=-4000.0, s_m=-9000.0)


def block_jump(p: Points) -> Points:
    return changed(p, range(200, 230), s_m=lambda q: q.s_m - 1500, east_m=60.0)


def null_island(p: Points) -> Points:
    return changed(p, (90, 91), s_m=-np.radians(59.5) * EARTH_RADIUS_M, east_m=-1e6)


def frozen(p: Points) -> Points:
    return changed(p, range(151, 159), s_m=p[150].s_m)


def no_position(p: Points) -> Points:
    return changed(p, (33, 34, 210), s_m=np.nan)


def spikes(p: Points) -> Points:
    return changed(p, (45, 46, 230, 315), v=355 / 3.6)


def spike_while_standing(p: Points) -> Points:
    return changed(p, (4, 343), v=355 / 3.6)


def dropouts(p: Points) -> Points:
    return changed(p, (55, 56, 57, 190), v=0.0)


def no_speeds(p: Points) -> Points:
    return changed(p, (80, 81, 260), v=None)


def gap(p: Points) -> Points:
    return p[:170] + p[183:]  # 14 s


def gap_while_accelerating(p: Points) -> Points:
    return p[:30] + p[43:]


def newest_first(p: Points) -> Points:
    return p[::-1]


def late_end(p: Points) -> Points:
    return p + [replace(p[-1], t=p[-1].t + 1 + i) for i in range(300)]


def early_start(p: Points) -> Points:
    return [replace(p[0], t=p[0].t - 200 + i) for i in range(200)] + p


DEFECTS: dict[str, tuple[Callable[[Points], Points], dict[Kind, int]]] = {
    "nothing": (lambda p: p, {}),
    "duplicates": (duplicates, {Kind.DUPLICATE_TIME: 4}),
    "repeated block": (repeated_block, {Kind.DUPLICATE_TIME: 20}),
    "times back": (times_back, {Kind.TIME_BACK: 3}),
    "clock ahead": (clock_ahead, {Kind.TIME_BACK: 1}),
    "jumps along": (jumps_along, {Kind.POSITION_JUMP: 6}),
    "jumps aside": (jumps_aside, {Kind.POSITION_JUMP: 3}),
    "block jump": (block_jump, {Kind.POSITION_JUMP: 30}),
    "null island": (null_island, {Kind.POSITION_JUMP: 2}),
    "frozen": (frozen, {Kind.POSITION_FROZEN: 8}),
    "no position": (no_position, {Kind.NO_POSITION: 3}),
    "spikes": (spikes, {Kind.SPEED_SPIKE: 4}),
    "spikes while standing": (spike_while_standing, {Kind.SPEED_SPIKE: 2}),
    "dropouts": (dropouts, {Kind.SPEED_DROPOUT: 4}),
    "no speeds": (no_speeds, {Kind.SPEED_MISSING: 3}),
    "gap": (gap, {Kind.GAP: 1}),
    "gap while accelerating": (gap_while_accelerating, {Kind.GAP: 1}),
    "newest first": (newest_first, {Kind.NEWEST_FIRST: 1}),
    "late end": (late_end, {Kind.LONG_STAND_AT_END: 280}),
    "early start": (early_start, {Kind.LONG_STAND_AT_START: 180}),
}


@pytest.mark.parametrize(("plant", "expected"), DEFECTS.values(), ids=DEFECTS)
def test_a_planted_defect_is_found_and_mended(
    tmp_path: Path, plant: Callable[[Points], Points], expected: dict[Kind, int]
) -> None:
    trip = load(tmp_path, plant(clean()))
    assert counts(trip) == expected
    assert trip.whole
    assert trip.matched.report.anchor == "start and end"
    check_truth(trip, clean(), speed_mps=0.9)


TOGETHER = (
    jumps_along,
    jumps_aside,
    no_position,
    spikes,
    dropouts,
    no_speeds,
    times_back,
    duplicates,
    gap,
    early_start,
    late_end,
)


def all_together(points: Points) -> Points:
    for plant in TOGETHER:
        points = plant(points)
    return points


TOGETHER_COUNTS: Counter[Kind] = sum(
    (Counter(expected) for plant, expected in DEFECTS.values() if plant in TOGETHER), Counter()
)


def test_all_defects_together_are_counted_apart(tmp_path: Path) -> None:
    trip = load(tmp_path, all_together(clean()))
    assert counts(trip) == TOGETHER_COUNTS
    check_truth(trip, clean(), speed_mps=0.9)
    report = trip.matched.report.cleaning
    assert report.read == len(all_together(clean()))
    dropped = sum(f.count for f in report.findings if f.told.done in ("dropped", "cut"))
    assert report.kept == report.read - dropped == len(trip.matched.s_m)
    assert "6 × position jump" not in report.summary
    assert "9 × position jump (dropped)" in report.summary


@pytest.mark.parametrize("seed", range(4))
def test_defects_are_counted_in_noise_too(tmp_path: Path, seed: int) -> None:
    """A receiver with 4 m of slow error and 0.3 m/s: nothing else is taken for a defect."""
    rng = np.random.default_rng(seed)
    error, noisy = 0.0, []
    for p in clean():
        error = 0.95 * error + 4 * np.sqrt(1 - 0.95**2) * rng.standard_normal()
        v = p.v if not p.v else max(p.v + 0.3 * rng.standard_normal(), 0.3)
        noisy.append(replace(p, s_m=p.s_m + error, v=v, east_m=5 * rng.standard_normal()))
    trip = load(tmp_path, all_together(noisy))
    found = counts(trip)
    for mended in (Kind.STANDING_DRIFT, Kind.STEP_BACK):
        found.pop(mended, None)
    assert found == TOGETHER_COUNTS
    run = trip.run
    grid = run.time_s + run.start_time_ns * 1e-9 - EPOCH_S
    t, s, v = (np.array([getattr(p, name) for p in clean()]) for name in ("t", "s_m", "v"))
    assert np.abs(run.s_m - np.interp(grid, t, s)).max() < 15
    assert np.abs(run.speed_mps - np.interp(grid, t, v)).max() < 1.5


def test_the_report_says_where_first_and_what(tmp_path: Path) -> None:
    trip = load(tmp_path, spikes(jumps_along(gap(clean()))))
    found = {f.kind: f for f in trip.matched.report.cleaning.findings}
    jump, spike, hole = (found[kind] for kind in (Kind.POSITION_JUMP, Kind.SPEED_SPIKE, Kind.GAP))
    assert (jump.first, jump.detail) == ("line 52", "by up to 300 m")
    assert (spike.first, spike.first_time) == ("line 47", "2016-07-29 08:14:05")
    assert spike.detail.startswith("355 instead of ")
    assert (hole.first, hole.detail) == ("line 171", "longest 14 s")
    told = trip.matched.report.cleaning.as_object()
    assert told["points_read"] == len(clean()) - 13
    assert {f["kind"]: f["count"] for f in told["findings"]} == {str(k): n for k, n in counts(trip).items()}


def test_a_record_that_ends_moving_is_left_open(tmp_path: Path) -> None:
    cut = [p for p in clean() if p.t <= STOOD_S + 280]
    trip = load(tmp_path, cut)
    assert counts(trip) == {Kind.ENDS_MOVING: 1}
    (finding,) = trip.matched.report.cleaning.findings
    assert finding.detail == f"at {cut[-1].v * 3.6:.0f} km/h, {LENGTH_M - cut[-1].s_m:.0f} m before B"  # type: ignore[operator]
    assert not trip.whole
    assert trip.run.s_m[-1] == pytest.approx(cut[-1].s_m, abs=2)


def beyond_both_ends() -> Points:
    """From 3 km before A to 3 km beyond B, with stops of 40 s at both."""
    first = clean(3000.0, start_m=-3000.0, stood_s=20)
    second = clean(LENGTH_M, start_s=first[-1].t + 1, stood_s=20)
    third = clean(3000.0, start_m=LENGTH_M, start_s=second[-1].t + 1, stood_s=20)
    return first + second + third


def test_points_before_and_after_the_section_are_cut(tmp_path: Path) -> None:
    """Kilometre posts find the stops by their distance; 40 s of standing at each belong to both runs."""
    points = beyond_both_ends()
    trip = load(tmp_path, points)
    run = motion(3000.0)[0]
    one = len(run) + 20  # the way and the stand before it
    assert counts(trip) == {
        Kind.BEFORE_SECTION: one - 1,
        Kind.AFTER_SECTION: one - 1,
        Kind.LONG_STAND_AT_START: 42 - 31,
        Kind.LONG_STAND_AT_END: 42 - 31,
    }
    assert trip.whole
    check_truth(trip, points)
    assert [stand.stop for stand in trip.stands] == ["A", "B"]


def test_with_geometry_points_beyond_the_line_are_cut(tmp_path: Path) -> None:
    """The line goes on straight beyond its ends; a point far off it is not on it, before and after."""
    points = changed(beyond_both_ends(), range(30), east_m=700.0)
    path = write(tmp_path, points)
    trip = load_trip(path, read_trip(path), route(geometry=True), Whereabouts())
    one = len(motion(3000.0)[0]) + 20
    assert counts(trip)[Kind.OFF_LINE] == 30
    assert counts(trip)[Kind.BEFORE_SECTION] == one - 1 - 30
    assert trip.matched.report.anchor == "route"
    check_truth(trip, points)


def test_a_train_that_passes_the_stops_is_cut_there(tmp_path: Path) -> None:
    points = clean(LENGTH_M + 6000, start_m=-3000.0)
    path = write(tmp_path, points)
    trip = load_trip(path, read_trip(path), route(geometry=True), Whereabouts())
    before, after = sum(p.s_m < 0 for p in points), sum(p.s_m > LENGTH_M for p in points)
    assert counts(trip) == {
        Kind.BEFORE_SECTION: before,
        Kind.AFTER_SECTION: after,
        Kind.STARTS_MOVING: 1,
        Kind.ENDS_MOVING: 1,
    }
    assert not trip.whole


def test_there_and_back_is_the_way_there(tmp_path: Path) -> None:
    there = clean()
    back = [replace(p, t=p.t + there[-1].t + 1, s_m=LENGTH_M - p.s_m) for p in there]
    trip = load(tmp_path, there + back)
    assert counts(trip)[Kind.AFTER_SECTION] > 300
    assert trip.whole
    check_truth(trip, there)


def test_a_signal_stop_does_not_bend_the_matching(tmp_path: Path) -> None:
    """Standing 60 m before B, then at B: both are within 1 % of the section's length, the better one counts."""
    first = clean(LENGTH_M - 60)
    second = [Point(first[-1].t + 1 + t, first[-1].s_m + s, v) for t, s, v in zip(*motion(60.0, top=3.0), strict=True)]
    rest = [replace(second[-1], t=second[-1].t + 1 + i) for i in range(20)]
    trip = load(tmp_path, first + second + rest)
    assert trip.matched.report.scale == pytest.approx(1.0, abs=1e-6)
    assert trip.matched.s_m[-1] == pytest.approx(LENGTH_M, abs=0.01)
    assert trip.whole


def test_stops_on_the_way_give_the_schedule(tmp_path: Path) -> None:
    first = clean(3000.0)
    second = clean(5000.0, start_m=3000.0, start_s=first[-1].t + 31)
    on = replace(route(), stops=(Stop(name="A", position_m=0), Stop(name="M", position_m=3040), route().stops[1]))
    trip = load(tmp_path, first + second, on)
    a, m, b = trip.stands
    assert [x.stop for x in trip.stands] == ["A", "M", "B"]
    assert [x.s_m for x in trip.stands] == pytest.approx([0, 3000, 8000], abs=0.01)
    assert m.off_m == pytest.approx(-40, abs=0.1)
    assert m.dwell_s == pytest.approx(2 * STOOD_S + 31, abs=1.0)
    assert (a.arrival_ns, b.departure_ns) == (None, None)
    assert (m.arrival_ns - a.departure_ns) * 1e-9 == pytest.approx(motion(3000.0)[0][-1], abs=1.0)  # type: ignore[operator]
    assert (trip.stops_on_the_way, trip.better_stops) == (("M",), "")
    part = load(tmp_path, first, on, to_stop="M")
    assert part.whole
    path = write(tmp_path, second)
    mapped = replace(route(geometry=True), stops=on.stops)
    assert load_trip(path, read_trip(path), mapped, Whereabouts()).better_stops == "--from M"


def test_parts_far_apart_in_time_are_not_joined(tmp_path: Path) -> None:
    """The clock of the first five points is a day behind; and a logger that slept while the train drove on."""
    points = clean()
    trip = load(tmp_path, changed(points, range(5), t=lambda q: q.t - 86400))
    assert counts(trip) == {Kind.LONG_STAND_AT_START: 5}
    later = [replace(p, t=p.t + 400) for p in points[200:]]
    trip = load(tmp_path, points[:160] + later)
    assert counts(trip) == {Kind.FAR_APART: len(later), Kind.ENDS_MOVING: 1}


@pytest.mark.parametrize("kind", ["posts", "geometry", "positions"])
def test_a_trip_the_other_way_is_driven_the_other_way(tmp_path: Path, kind: str) -> None:
    """Clean, written from B to A, and not said to be reversed."""
    back = [replace(p, s_m=LENGTH_M - p.s_m) for p in clean()]
    path = write(tmp_path, back, on_route=kind == "positions")
    said = Whereabouts(line=long_posts(tmp_path) if kind == "posts" else None)
    trip = load_trip(path, read_trip(path), route(geometry=kind == "geometry"), said)
    assert counts(trip) == {Kind.OTHER_WAY: 1}
    (finding,) = trip.matched.report.cleaning.findings
    posts = f", or turn the list {said.line} round" if said.line else ""
    assert finding.detail == f"B to A: give --reverse{posts}"
    assert (trip.reversed, trip.start.name, trip.end.name) == (True, "B", "A")
    check_truth(trip, clean())
    if kind != "posts":  # there the other direction turns the trip against the posts
        told = load_trip(path, read_trip(path), route(geometry=kind == "geometry"), replace(said, reverse=True))
        assert counts(told) == {}
        assert np.array_equal(told.matched.s_m, trip.matched.s_m)
    with pytest.raises(DasError, match="line 2: trip runs the other way, B to A: give --reverse"):
        load_trip(path, read_trip(path), route(geometry=kind == "geometry"), replace(said, strict=True))
    with pytest.raises(DasError, match=r"runs the other way.*give --reverse, and change --from and --to"):
        load_trip(path, read_trip(path), route(geometry=kind == "geometry"), replace(said, from_stop="A", to_stop="B"))


def test_reverse_where_the_trip_is_not_is_left_out(tmp_path: Path) -> None:
    path = write(tmp_path, clean())
    trip = load_trip(path, read_trip(path), route(geometry=True), Whereabouts(reverse=True))
    assert not trip.reversed
    (finding,) = trip.matched.report.cleaning.findings
    assert finding.detail == "A to B: leave out --reverse"
    check_truth(trip, clean())


def test_a_record_without_speeds_is_led_by_its_positions(tmp_path: Path) -> None:
    trip = load(tmp_path, clean(), speeds=False)
    assert counts(trip) == {Kind.SPEED_MISSING: len(clean())}
    assert trip.matched.dropout.all()
    grid = trip.run.time_s + trip.run.start_time_ns * 1e-9 - EPOCH_S
    t, s, v = (np.array([getattr(p, name) for p in clean()]) for name in ("t", "s_m", "v"))
    assert trip.run.speed_mps == pytest.approx(np.interp(grid, t, v), abs=1.0)
    assert np.abs(trip.run.s_m - np.interp(grid, t, s)).max() < 5


@pytest.mark.parametrize("factor", [3.6, 1 / 3.6])
def test_speeds_in_another_unit_are_not_used(tmp_path: Path, factor: float) -> None:
    trip = load(tmp_path, [replace(p, v=p.v * factor) for p in clean()])  # type: ignore[operator]
    assert counts(trip) == {Kind.SPEED_MISSING: len(clean())}
    (finding,) = trip.matched.report.cleaning.findings
    assert finding.detail.endswith("so most are: another unit?")
    assert trip.run.speed_mps.max() == pytest.approx(30, abs=0.5)


def test_positions_that_stall_do_not_make_spikes() -> None:
    """Positions stand still for 3 s twice while the speed is right, as in the real record with dropouts."""
    t = np.arange(60.0)
    s = 25 * t
    s[30:33], s[34:37] = s[30], s[34]
    dropout, spike = cleaning.find_wrong_speeds(t, s, np.full(60, 25.0))
    assert not dropout.any()
    assert not spike.any()


def test_a_long_block_of_spikes_or_dropouts_is_found_whole() -> None:
    t = np.arange(400.0)
    for wrong_mps, which in ((98.0, 1), (0.0, 0)):
        v = np.full(400, 25.0)
        v[100:260] = wrong_mps
        found = cleaning.find_wrong_speeds(t, 25 * t, v)
        assert np.flatnonzero(found[which]).tolist() == list(range(100, 260))
        assert not found[1 - which].any()


@given(st.lists(st.integers(0, 12), min_size=1, max_size=9))
def test_the_longest_rise_is_the_longest(values: list[int]) -> None:
    """Against all subsets."""
    chain = cleaning._longest_rise(np.array(values))
    assert (np.diff(np.array(values)[chain]) > 0).all()
    best = max(
        size
        for size in range(1, len(values) + 1)
        for some in combinations(values, size)
        if all(a < b for a, b in pairwise(some))
    )
    assert len(chain) == best


@given(st.lists(st.sampled_from([0.0, 0.4, 0.9, 2.0]), min_size=28, max_size=28), st.integers(2, 8))
def test_the_longest_chain_is_the_longest(strays: list[float], count: int) -> None:
    """Any relation between pairs of up to 8 points, against all subsets; what is left out costs by how far a step
    strays."""
    table = np.full((8, 8), 2.0)
    table[np.triu_indices(8, 1)] = strays

    def worth(some: Sequence[int]) -> float:
        return len(some) - sum(cleaning.STRAY_WEIGHT * table[a, b] ** 2 * (b - a - 1) for a, b in pairwise(some))

    chain = cleaning._longest_chain(lambda i, j: table[i, j], np.arange(float(count)))
    assert all(table[a, b] < 1 for a, b in pairwise(chain))
    best = max(
        worth(some)
        for size in range(1, count + 1)
        for some in combinations(range(count), size)
        if all(table[a, b] < 1 for a, b in pairwise(some))
    )
    assert best - 0.5 <= worth(chain) <= best  # of two nearly as good the one that strays less


def reread(folder: Path, trip: Trip, name: str) -> tuple[bytes, Trip]:
    """Write the cleaned trip and read it back."""
    path = folder / name
    write_cleaned(path, trip)
    on = trip.route.reversed() if trip.reversed else trip.route
    return path.read_bytes(), load_trip(path, read_trip(path), on, Whereabouts(reverse=trip.reversed))


@pytest.mark.parametrize("speeds", [True, False])
@pytest.mark.parametrize("reverse", [True, False])
def test_a_cleaned_trip_reads_back_as_the_same(tmp_path: Path, reverse: bool, speeds: bool) -> None:
    points = all_together(clean())
    if reverse:
        points = [replace(p, s_m=LENGTH_M - p.s_m) for p in points]
    path = write(tmp_path, points, speeds=speeds)
    first = load_trip(path, read_trip(path), route(geometry=True), Whereabouts(reverse=reverse))
    written, again = reread(tmp_path, first, "cleaned.csv")
    rewritten, _ = reread(tmp_path, again, "again.csv")
    assert rewritten == written
    assert set(counts(again)) <= {Kind.GAP}
    a, b = first.matched, again.matched
    assert np.array_equal(a.time_ns, b.time_ns)
    assert np.array_equal(a.latitude_deg, b.latitude_deg)
    assert np.array_equal(a.dropout, b.dropout)
    assert np.array_equal(a.standing, b.standing)
    assert (a.departure, a.arrival) == (b.departure, b.arrival)
    assert b.s_m == pytest.approx(a.s_m, abs=1e-6)
    assert b.speed_mps == pytest.approx(a.speed_mps, abs=1e-6)
    assert again.run.speed_mps == pytest.approx(first.run.speed_mps, abs=1e-4)
    assert again.matched.report.anchor == "positions"


@pytest.mark.parametrize("seed", range(25))
def test_any_dirt_is_refused_in_a_line_or_reads_back_as_cleaned(tmp_path: Path, seed: int) -> None:
    """Two to four defects at random places, of random length: never a traceback, never a trip that cannot be."""
    rng = np.random.default_rng(seed)
    points = clean()
    for name in rng.choice(list(RANDOM), size=rng.integers(2, 5)):
        i, length = int(rng.integers(0, max(len(points) - 1, 1))), int(rng.choice([1, 4, 40, 150]))
        points = RANDOM[name](points, i, i + length)
    path = write(tmp_path, points)
    try:
        first = load_trip(path, read_trip(path), route(geometry=True), Whereabouts())
    except DasError as refused:
        lines = str(refused).splitlines()
    else:
        lines = []
        _check_round_trip(tmp_path, first)
    assert len(lines) < 2


def _check_round_trip(folder: Path, first: Trip) -> None:
    assert (np.diff(first.matched.s_m) >= 0).all()
    assert first.run.speed_mps.max() < 111.2
    assert len(first.matched.s_m) == first.matched.report.cleaning.kept
    written, again = reread(folder, first, "cleaned.csv")
    assert reread(folder, again, "again.csv")[0] == written


RANDOM: dict[str, Callable[[Points, int, int], Points]] = {
    "again": lambda p, i, j: p[:j] + p[i:],
    "back": lambda p, i, j: changed(p, range(i, j), t=lambda q: q.t - 7.5),
    "an hour back": lambda p, i, j: changed(p, range(i, j), t=lambda q: q.t - 3600.5),
    "jump": lambda p, i, j: changed(p, range(i, j), s_m=lambda q: q.s_m + 400),
    "aside": lambda p, i, j: changed(p, range(i, j), east_m=1000.0),
    "frozen": lambda p, i, j: changed(p, range(i, j), s_m=p[i].s_m) if p else p,
    "spike": lambda p, i, j: changed(p, range(i, j), v=98.6),
    "dropout": lambda p, i, j: changed(p, range(i, j), v=0.0),
    "gap": lambda p, i, j: p[:i] + p[j:],
    "cut": lambda p, i, j: p[:j],
    "begun late": lambda p, i, j: p[i:],
    "newest first": lambda p, i, j: p[::-1],
    "backwards": lambda p, i, j: [replace(q, t=x.t) for q, x in zip(p[::-1], p, strict=True)],
    "sparse": lambda p, i, j: p[::9],
}

STRICT = {
    "duplicates": (duplicates, "line 43: time given twice, same time as a point before (4 in all; --strict)"),
    "times back": (times_back, "line 62: time running back, up to 4.5 s back (3 in all; --strict)"),
    "jumps": (jumps_along, "line 52: position jump, by up to 300 m (6 in all; --strict)"),
    "no position": (no_position, "line 35: no position, neither on the map nor on the route (3 in all; --strict)"),
    "newest first": (newest_first, "line 2: newest point first"),
}


@pytest.mark.parametrize(("plant", "expected"), STRICT.values(), ids=STRICT)
def test_strict_refuses_what_would_be_dropped(tmp_path: Path, plant: Callable[[Points], Points], expected: str) -> None:
    with pytest.raises(DasError) as caught:
        load(tmp_path, plant(clean()), strict=True)
    assert str(caught.value).startswith(f"{tmp_path / 'trip.csv'}: {expected}")


@pytest.mark.parametrize("plant", [spikes, dropouts, gap, late_end])
def test_strict_lets_pass_what_is_mended(tmp_path: Path, plant: Callable[[Points], Points]) -> None:
    assert counts(load(tmp_path, plant(clean()), strict=True)) == counts(load(tmp_path, plant(clean())))


def shuffled(p: Points) -> Points:
    return [p[i] for i in np.random.default_rng(0).permutation(len(p))]


def jumping_about(p: Points) -> Points:
    at = np.random.default_rng(0).uniform(0, LENGTH_M, len(p))
    return [replace(q, s_m=float(s)) if q.v else q for q, s in zip(p, at, strict=True)]


REFUSED = {
    "shuffled": (shuffled, r"the times are in disorder: only \d+ of 348 points are in order, sort the file"),
    "one time": (lambda p: [replace(q, t=0.0) for q in p], "all points have one time"),
    "jumping about": (jumping_about, r"the positions jump: only \d+ of 348 points fit together, line \d+ does not"),
    "nowhere": (lambda p: changed(p, range(len(p)), s_m=np.nan), "no point has a position"),
    "standing": (lambda p: [replace(q, s_m=0.0, v=0.0) for q in p], "the train never moves"),
    "elsewhere": (
        lambda p: [replace(q, east_m=3000.0) for q in p],
        r"trip not on the line .*: line 2 is (29|30)\d\d m away",
    ),
    "a few metres": (lambda p: [q for q in p if q.s_m < 20], "does not run from A towards B: it covers 1. m"),
}


@pytest.mark.parametrize(("plant", "expected"), REFUSED.values(), ids=REFUSED)
def test_what_nothing_sensible_remains_of_is_refused(
    tmp_path: Path, plant: Callable[[Points], Points], expected: str
) -> None:
    with pytest.raises(DasError, match=expected) as caught:
        load(tmp_path, plant(clean()))
    assert "\n" not in str(caught.value)


def test_what_no_train_runs_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path, [replace(p, t=p.t / 5) for p in clean()])
    with pytest.raises(DasError, match=r"the positions lead to 5\d\d km/h, faster than trains run"):
        load_trip(path, read_trip(path), route(geometry=True), Whereabouts())


def test_posts_are_refused_where_positions_are_on_the_route(tmp_path: Path) -> None:
    path = write(tmp_path, clean(), on_route=True)
    with pytest.raises(DasError, match="has positions on the route, which need no kilometre posts"):
        load_trip(path, read_trip(path), route(), Whereabouts(line=long_posts(tmp_path)))


def test_invalid_positions_of_a_recording_stay_but_lead_nowhere(tmp_path: Path) -> None:
    """The node was told them, so a replay tells them again; the run is made from the others."""
    path = tmp_path / "run.mcap"
    file = RecordingFile(path)
    for i, p in enumerate(clean()):
        bad = 100 <= i < 110
        position = das_pb2.Position(
            time_ns=round((EPOCH_S + p.t) * 1e9),
            s_m=np.nan if bad else p.s_m,
            speed_mps=99.0 if bad else p.v,
            quality=das_pb2.Position.QUALITY_INVALID if bad else das_pb2.Position.QUALITY_GOOD,
        )
        file.add(POSITION, POSITION.key("t"), position, position.time_ns)
    file.close()
    trip = load_trip(path, read_trip(path), route(), Whereabouts())
    assert counts(trip) == {}
    assert np.flatnonzero(trip.matched.invalid).tolist() == list(range(100, 110))
    assert (np.diff(trip.matched.s_m) >= 0).all()
    check_truth(trip, clean())


@pytest.mark.parametrize("speeds", [True, False])
@pytest.mark.parametrize("ahead_m", [-300.0, 250.0])
def test_a_minute_of_positions_far_off_is_not_the_trip(tmp_path: Path, ahead_m: float, speeds: bool) -> None:
    """No detour over the wrong part, though the train could just brake and speed up again to get there."""
    points = clean()
    shifted = changed(points, range(150, 210), s_m=lambda q: q.s_m + ahead_m)
    trip = load(tmp_path, shifted, speeds=speeds)
    assert counts(trip)[Kind.POSITION_JUMP] == 60
    assert not {Kind.SPEED_DROPOUT, Kind.SPEED_SPIKE} & counts(trip).keys()
    t, s = np.array([p.t for p in points]), np.array([p.s_m for p in points])
    grid = trip.run.time_s + trip.run.start_time_ns * 1e-9 - EPOCH_S
    assert np.abs(trip.run.s_m - np.interp(grid, t, s)).max() < 15


@pytest.mark.parametrize("spiked", [True, False])
def test_a_long_noisy_stand_is_one_stand(tmp_path: Path, spiked: bool) -> None:
    """The arrival is when the train came, whatever the fixes of the next 20 minutes wander, without speeds and with a
    wrong one."""
    rng = np.random.default_rng(3)
    points = [replace(p, s_m=p.s_m + 3 * rng.standard_normal()) for p in late_end(late_end(late_end(clean())))]
    points = [replace(p, t=EARLIEST_S + i) for i, p in enumerate(points)]
    trip = load(tmp_path, changed(points, (500, 800), v=98.6), speeds=spiked)
    arrived = next(i for i, p in enumerate(clean()) if i > STOOD_S and p.v == 0)
    at = (int(trip.matched.time_ns[trip.matched.arrival]) * 1e-9) - EPOCH_S - EARLIEST_S
    assert at == pytest.approx(arrived, abs=8)
    assert counts(trip)[Kind.LONG_STAND_AT_END] > 800


EARLIEST_S = 100.0


def test_positions_frozen_to_the_end_are_no_stop(tmp_path: Path) -> None:
    """The receiver holds its last fix while the speeds go on: nobody knows where the train came to stand."""
    points = clean()
    trip = load(tmp_path, changed(points, range(251, len(points)), s_m=points[250].s_m))
    assert counts(trip) == {Kind.POSITION_FROZEN: len(points) - 251, Kind.ENDS_MOVING: 1}
    check_truth(trip, points)


def test_a_dropout_beside_a_gap_or_a_stop_is_found_whole(tmp_path: Path) -> None:
    """Speeds of 0 on both sides of a hole of 31 s are no stand, and those while braking not yet the arrival."""
    points = clean()
    dropped = changed(points, [*range(140, 150), *range(180, 190), *range(300, 335)], v=0.0)
    trip = load(tmp_path, dropped[:150] + dropped[180:])
    assert counts(trip)[Kind.SPEED_DROPOUT] >= 20 + 25
    at = (trip.matched.time_ns * 1e-9) - EPOCH_S
    assert trip.matched.s_m == pytest.approx(np.interp(at, [p.t for p in points], [p.s_m for p in points]), abs=4)
    arrived = next(p.t for i, p in enumerate(points) if i > STOOD_S and p.v == 0)
    assert at[trip.matched.arrival] == pytest.approx(arrived, abs=3)


def test_a_speed_of_0_in_another_unit_is_a_stand(tmp_path: Path) -> None:
    """One fix at either stop, 6 s from the next: the positions alone do not tell that the train stands there."""
    points = [p for p in clean() if p.v]
    first, last = clean()[STOOD_S], clean()[-STOOD_S]
    sparse = [first, *points[5:-5], last]
    trip = load(tmp_path, [replace(p, v=p.v / 3.6 if p.v else p.v) for p in sparse])
    assert trip.whole
    assert counts(trip)[Kind.SPEED_MISSING] == len(sparse)
    with pytest.raises(DasError, match=r"cannot be aligned .* \(its speeds are not those of its positions"):
        load(tmp_path, [replace(p, v=5.0) for p in points[60:-60]])


def test_a_trip_of_gaps_alone_is_refused(tmp_path: Path) -> None:
    points = clean()
    with pytest.raises(DasError, match=r"no points in 3\d\d s of the trip's 3\d\d s, expected less than half"):
        load(tmp_path, [points[0], points[170], points[-1]])
