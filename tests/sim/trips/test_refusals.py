"""Trips cleaned, written and read back, or refused in a line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from das.domain.errors import DasError
from sim.options import TripOptions
from sim.trips.findings import FindingKind
from sim.trips.reading import read_trip
from sim.trips.report import write_cleaned
from sim.trips.trip import Trip, load_trip
from tests.support.dirt import (
    LENGTH_M,
    Points,
    all_together,
    changed,
    clean,
    counts,
    dropouts,
    duplicates,
    gap,
    jumps_along,
    late_end,
    load,
    long_posts,
    newest_first,
    no_position,
    on_route,
    spikes,
    times_back,
    write,
)
from tests.support.made_line import route


def reread(folder: Path, trip: Trip, name: str) -> tuple[bytes, Trip]:
    """Write the cleaned trip and read it back."""
    path = folder / name
    write_cleaned(path, trip)
    on = trip.route.reversed() if trip.reversed else trip.route
    return path.read_bytes(), load_trip(path, read_trip(path), on, TripOptions(reverse=trip.reversed))


@pytest.mark.parametrize("speeds", [True, False])
@pytest.mark.parametrize("reverse", [True, False])
def test_a_cleaned_trip_reads_back_as_the_same(tmp_path: Path, reverse: bool, speeds: bool) -> None:
    points = all_together(clean())
    if reverse:
        points = [replace(p, s_m=LENGTH_M - p.s_m) for p in points]
    path = write(tmp_path, points, speeds=speeds)
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
    with pytest.raises(DasError, match=r"the positions lead to 5\d\d km/h, faster than trains run"):
        on_route(tmp_path, [replace(p, t=p.t / 5) for p in clean()])


def test_posts_are_not_used_where_positions_are_on_the_route(tmp_path: Path) -> None:
    posts = long_posts(tmp_path)
    trip = on_route(tmp_path, clean(), route(), positions=True, line=posts)
    without = on_route(tmp_path, clean(), route(), positions=True)
    assert (trip.line_not_used, without.line_not_used) == (posts, None)
    assert trip.direction_known
    assert np.array_equal(trip.matched.s_m, without.matched.s_m)
