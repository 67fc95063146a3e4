"""A whole trip from its file: what is cut, turned and told, written and read back, or refused in a line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.domain.errors import DasError
from das.domain.route import Floats, Route, Stop
from sim.options import TripOptions
from sim.trips.cleaning import FindingKind
from sim.trips.matching import slowed_to
from sim.trips.record import read_trip
from sim.trips.report import describe, write_cleaned
from sim.trips.trip import Trip, load_trip
from tests.support import dirt
from tests.support.dirt import LENGTH_M, STOOD_S, Point, Points, changed, check_truth, clean, counts, load, on_route
from tests.support.made_line import motion, north, route


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
        FindingKind.BEFORE_SECTION: one - 1,
        FindingKind.AFTER_SECTION: one - 1,
        FindingKind.LONG_STAND_AT_START: 42 - 31,
        FindingKind.LONG_STAND_AT_END: 42 - 31,
    }
    assert trip.whole
    check_truth(trip, points)
    assert [stand.stop for stand in trip.stands] == ["A", "B"]


def test_with_geometry_points_beyond_the_line_are_cut(tmp_path: Path) -> None:
    """The line goes on straight beyond its ends; a point far off it is not on it, before and after."""
    points = changed(beyond_both_ends(), range(30), east_m=700.0)
    trip = on_route(tmp_path, points)
    one = len(motion(3000.0)[0]) + 20
    assert counts(trip)[FindingKind.OFF_LINE] == 30
    assert counts(trip)[FindingKind.BEFORE_SECTION] == one - 1 - 30
    assert trip.matched.report.anchor == "route"
    assert trip.direction_known
    check_truth(trip, points)


def test_a_train_that_passes_the_stops_is_cut_there(tmp_path: Path) -> None:
    points = clean(LENGTH_M + 6000, start_m=-3000.0)
    trip = on_route(tmp_path, points)
    before, after = sum(p.s_m < 0 for p in points), sum(p.s_m > LENGTH_M for p in points)
    assert counts(trip) == {
        FindingKind.BEFORE_SECTION: before,
        FindingKind.AFTER_SECTION: after,
        FindingKind.STARTS_MOVING: 1,
        FindingKind.ENDS_MOVING: 1,
    }
    assert not trip.whole


def test_there_and_back_is_the_way_there(tmp_path: Path) -> None:
    there = clean()
    back = [replace(p, t=p.t + there[-1].t + 1, s_m=LENGTH_M - p.s_m) for p in there]
    trip = load(tmp_path, there + back)
    assert counts(trip)[FindingKind.AFTER_SECTION] > 300
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


def test_a_train_that_stands_for_a_second_on_the_way_has_not_stopped(tmp_path: Path) -> None:
    first = clean(3000.0, stood_s=0)
    second = clean(5000.0, start_m=3000.0, start_s=first[-1].t + 1, stood_s=0)
    trip = load(tmp_path, first + second)
    assert [stand.stop for stand in trip.stands] == ["A", "B"]


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
    mapped = replace(route(geometry=True), stops=on.stops)
    assert on_route(tmp_path, second, mapped).better_stops == "--from M"


def test_parts_far_apart_in_time_are_not_joined(tmp_path: Path) -> None:
    """The clock of the first five points is a day behind; and a logger that slept while the train drove on."""
    points = clean()
    trip = load(tmp_path, changed(points, range(5), t=lambda q: q.t - 86400))
    assert counts(trip) == {FindingKind.LONG_STAND_AT_START: 5}
    later = [replace(p, t=p.t + 400) for p in points[200:]]
    trip = load(tmp_path, points[:160] + later)
    assert counts(trip) == {FindingKind.FAR_APART: len(later), FindingKind.ENDS_MOVING: 1}


@pytest.mark.parametrize("kind", ["posts", "geometry", "positions"])
def test_a_trip_the_other_way_is_driven_the_other_way(tmp_path: Path, kind: str) -> None:
    """Clean, written from B to A, and not said to be reversed."""
    back = [replace(p, s_m=LENGTH_M - p.s_m) for p in clean()]
    path = dirt.write(tmp_path, back, on_route=kind == "positions")
    line = dirt.long_posts(tmp_path) if kind == "posts" else None

    def driven(**said: Any) -> Trip:
        options = TripOptions(posts=line, **said)
        return load_trip(path, read_trip(path), route(geometry=kind == "geometry"), options)

    trip = driven()
    assert counts(trip) == {FindingKind.OTHER_WAY: 1}
    (finding,) = trip.matched.report.cleaning.findings
    posts = f", or turn the list {line} round" if line else ""
    assert finding.detail == f"B to A: give --reverse{posts}"
    assert (trip.reversed, trip.start.name, trip.end.name) == (True, "B", "A")
    check_truth(trip, clean())
    if kind != "posts":  # there the other direction turns the trip against the posts
        told = driven(reverse=True)
        assert counts(told) == {}
        assert np.array_equal(told.matched.s_m, trip.matched.s_m)
    with pytest.raises(DasError, match=r"runs the other way.*give --reverse, and change --from and --to"):
        driven(from_stop="A", to_stop="B")


def test_a_trip_against_a_one_way_line_is_refused_with_the_reason(tmp_path: Path) -> None:
    line = replace(route(geometry=True), one_way=True)
    there = dirt.write(tmp_path, clean())
    assert not load_trip(there, read_trip(there), line, TripOptions()).reversed
    back = dirt.write(tmp_path, [replace(p, s_m=LENGTH_M - p.s_m) for p in clean()])
    with pytest.raises(DasError, match="one_way = true: its limits are those from A to B"):
        load_trip(back, read_trip(back), line, TripOptions())


@pytest.mark.parametrize(("reverse", "expected"), [(True, "leave out --reverse"), (False, "give --reverse")])
def test_a_stated_direction_is_never_overruled(tmp_path: Path, *, reverse: bool, expected: str) -> None:
    back = [replace(p, s_m=LENGTH_M - p.s_m) for p in clean()]
    points = clean() if reverse else back
    order = "--reverse" if reverse else "--no-reverse"
    with pytest.raises(DasError, match=f"{order}: the trip runs the other way along .*: {expected}$"):
        on_route(tmp_path, points, reverse=reverse)
    with pytest.raises(DasError, match=r"or turn the list .*posts.* round"):
        load(tmp_path, back, reverse=reverse)


def test_no_highest_speed_and_no_force_is_taken_from_a_gap(tmp_path: Path) -> None:
    """It speeds up before a gap of 40 s and slows down after it: inertia leads to more than was ever recorded."""
    points = [p for p in clean() if not 50 <= p.t < 90]
    points = [replace(p, s_m=p.s_m + (250.0 if p.t >= 90 else 0.0)) for p in points]
    trip = on_route(tmp_path, points)
    recorded_mps = max(p.v for p in points if p.v is not None)
    assert trip.run.speed_mps.max() > recorded_mps + 2.0
    assert trip.run.top_mps <= recorded_mps + 1.2  # smoothing leads up to the gap
    since = trip.run.time_s + trip.run.start_time_ns * 1e-9 - dirt.EPOCH_S
    assert since[trip.run.inferred].min() == pytest.approx(50.0, abs=5.0)
    assert since[trip.run.inferred].max() == pytest.approx(89.0, abs=5.0)
    found = describe(trip, None, None)
    assert found["max_speed_kmh"] == pytest.approx(trip.run.top_mps * 3.6)


@pytest.mark.parametrize(
    ("gap", "what"), [(range(5, 40), "departed"), (range(300, 340), "arrived"), (range(80, 120), "")]
)
def test_a_departure_within_a_gap_is_not_known(tmp_path: Path, gap: range, what: str) -> None:
    trip = on_route(tmp_path, [p for i, p in enumerate(clean()) if i not in gap])
    notes = [note for note in describe(trip, None, None)["not_known"] if "next to that end" in note]
    assert notes == ([f"when the train {what}: there is a gap next to that end of the run"] if what else [])


@pytest.mark.parametrize("every", [1, 2, 3])
def test_a_record_without_speeds_need_not_stand_at_its_ends(tmp_path: Path, every: int) -> None:
    """From the moment it starts to that it stops: positions, smooth run and running time are those of the motion."""
    run = clean(stood_s=0)
    trip = load(tmp_path, [*run[:-1:every], run[-1]], speeds=False)
    check_truth(trip, run, speed_mps=1.0)
    assert trip.whole
    assert trip.matched.report.anchor == "start and end"
    assert trip.run.time_s[-1] == pytest.approx(run[-1].t, abs=1.0)
    assert counts(trip)[FindingKind.SLOWS_TO_STAND] == 2
    assert 0 <= trip.matched.report.stand_uncertainty_m < 0.5  # it stands exactly there


@pytest.mark.parametrize("cut", [2, 3])
def test_how_far_the_stand_is_beyond_is_told(tmp_path: Path, cut: int) -> None:
    """The record ends `cut` s before the train stops at 0.5 m/s²: a²t²/2 further, which must be within what is said."""
    run = clean(stood_s=0)
    trip = load(tmp_path, run[:-cut], speeds=False)
    said_m = trip.matched.report.stand_uncertainty_m
    assert run[-1].s_m - run[-1 - cut].s_m <= said_m < 5.0
    (told,) = (f for f in trip.matched.report.cleaning.findings if f.kind == FindingKind.SLOWS_TO_STAND)
    assert told.detail.startswith(f"the stand is up to {said_m:.1f} m and ")


def test_only_who_slows_down_is_led_to_a_stand() -> None:
    """Parabolas, whose speed at the end is known; slow but even, fast, few points, and a measured speed are none."""
    t = np.arange(0.0, 31.0)
    told = np.ones(len(t), dtype=bool)

    def ends(speed_mps: float, change_mps2: float) -> Floats:
        return -(speed_mps * (30 - t) + 0.5 * change_mps2 * (30 - t) ** 2)

    assert slowed_to(t, ends(1.2, 0.4), told)[-1] == pytest.approx(1.2)
    assert slowed_to(t, -ends(1.2, 0.4)[::-1], told)[0] == pytest.approx(1.2)
    for along in (ends(1.2, 0.0), ends(2.5, 0.4), ends(1.2, -0.1)):
        assert np.isnan(slowed_to(t, along, told)).all()
    assert np.isnan(slowed_to(t[::6], ends(1.2, 0.4)[::6], told[::6])).all()
    assert np.isnan(slowed_to(t, ends(1.2, 0.4), ~told)).all()


@pytest.mark.parametrize(
    ("said", "back", "known"),
    [
        ({}, False, False),
        ({"reverse": False}, False, True),
        ({"reverse": True}, False, True),
        ({"from_stop": "A", "to_stop": "B"}, False, True),
        ({"from_stop": "A"}, False, False),
        ({}, True, False),  # against the posts: the list, or the direction
    ],
)
def test_posts_do_not_tell_the_direction(tmp_path: Path, said: dict[str, Any], back: bool, known: bool) -> None:
    points = [replace(p, s_m=LENGTH_M - p.s_m) for p in clean()] if back else clean()
    assert load(tmp_path, points, **said).direction_known == known


def reread(folder: Path, trip: Trip, name: str) -> tuple[bytes, Trip]:
    """Write the cleaned trip and read it back."""
    path = folder / name
    write_cleaned(path, trip)
    on = trip.route.reversed() if trip.reversed else trip.route
    return path.read_bytes(), load_trip(path, read_trip(path), on, TripOptions(reverse=trip.reversed))


@pytest.mark.parametrize("speeds", [True, False])
@pytest.mark.parametrize("reverse", [True, False])
def test_a_cleaned_trip_reads_back_as_the_same(tmp_path: Path, reverse: bool, speeds: bool) -> None:
    points = dirt.all_together(clean())
    if reverse:
        points = [replace(p, s_m=LENGTH_M - p.s_m) for p in points]
    path = dirt.write(tmp_path, points, speeds=speeds)
    first = load_trip(path, read_trip(path), route(geometry=True), TripOptions(reverse=reverse))
    written, again = reread(tmp_path, first, "cleaned.csv")
    rewritten, _ = reread(tmp_path, again, "again.csv")
    assert rewritten == written
    assert set(counts(again)) <= {FindingKind.GAP}
    a, b = first.matched, again.matched
    assert np.array_equal(a.time_ns, b.time_ns)
    assert np.array_equal(a.latitude_deg, b.latitude_deg)
    assert np.array_equal(a.dropout, b.dropout)
    assert np.array_equal(a.standing, b.standing)
    assert a.ends == b.ends
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
    try:
        first = on_route(tmp_path, points)
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
    "turning back": (
        lambda p: [replace(q, s_m=min(q.s_m, 12000 - q.s_m)) for q in p],
        r"position decreases by \d\d m at line \d+ \(wrong direction\? see --reverse\)",
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
    with pytest.raises(DasError, match=r"the positions lead to 5\d\d km/h, faster than trains run"):
        on_route(tmp_path, [replace(p, t=p.t / 5) for p in clean()])


def test_posts_are_refused_where_positions_are_on_the_route(tmp_path: Path) -> None:
    posts = dirt.long_posts(tmp_path)
    with pytest.raises(DasError, match=r"^--posts .*posts\.csv: not needed, .* has positions on the route$"):
        on_route(tmp_path, clean(), route(), positions=True, posts=posts)
    assert on_route(tmp_path, clean(), route(), positions=True).direction_known


def located() -> Route:
    """The route without geometry, whose stops have coordinates."""
    places = zip(("A", "B"), (0.0, LENGTH_M), *north(np.array([0.0, LENGTH_M])), strict=True)
    stops = (Stop(name=n, position_m=p, latitude_deg=a, longitude_deg=b) for n, p, a, b in places)
    return replace(route(), stops=tuple(stops))


@pytest.mark.parametrize("back", [False, True])
def test_coordinates_of_the_stops_tell_the_direction(tmp_path: Path, back: bool) -> None:
    """Along the posts or against them: it runs to the stop where it ends, and posts need no turn."""
    points = [replace(p, s_m=LENGTH_M - p.s_m) for p in clean()] if back else clean()
    with pytest.raises(DasError, match="reverse: the trip runs the other way"):
        load(tmp_path, points, located(), reverse=not back)
    for said in ({}, {"reverse": back}):
        trip = load(tmp_path, points, located(), **said)
        assert trip.direction_known
        assert trip.reversed == back
        assert (trip.start.name, trip.end.name) == (("B", "A") if back else ("A", "B"))
        assert trip.whole
        check_truth(trip, clean())


@pytest.mark.parametrize("back", [False, True])
def test_coordinates_of_the_stops_place_a_record_that_never_stands(tmp_path: Path, back: bool) -> None:
    points = [p for p in clean() if 1000.0 < p.s_m < 7000.0]
    points = [replace(p, s_m=LENGTH_M - p.s_m) for p in points] if back else points
    trip = load(tmp_path, points, located())
    assert trip.matched.report.anchor == "stops"
    assert trip.reversed == back
    check_truth(trip, clean())
    with pytest.raises(DasError, match="the train stands neither at the first nor at the last line"):
        load(tmp_path, points)
