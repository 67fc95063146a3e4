"""Dirty trips: every defect planted in a clean record, found, counted, and the clean trip given back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
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
from sim.options import TripOptions
from sim.trips import cleaning
from sim.trips.cleaning import STRAY_WEIGHT, FindingKind
from sim.trips.record import read_trip
from sim.trips.trip import load_trip
from tests.support import dirt
from tests.support.dirt import EPOCH_S, STOOD_S, Points, changed, check_truth, clean, counts, load, truth_of_run
from tests.support.made_line import route


@pytest.mark.parametrize(("plant", "expected"), dirt.DEFECTS.values(), ids=dirt.DEFECTS)
def test_a_planted_defect_is_found_and_mended(
    tmp_path: Path, plant: Callable[[Points], Points], expected: dict[FindingKind, int]
) -> None:
    trip = load(tmp_path, plant(clean()))
    assert counts(trip) == expected
    assert trip.whole
    assert trip.matched.report.anchor == "start and end"
    check_truth(trip, clean(), speed_mps=0.9)
    assert np.abs(trip.run.acceleration_mps2).max() < 0.6


def test_all_defects_together_are_counted_apart(tmp_path: Path) -> None:
    trip = load(tmp_path, dirt.all_together(clean()))
    assert counts(trip) == dirt.TOGETHER_COUNTS
    check_truth(trip, clean(), speed_mps=0.9)
    report = trip.matched.report.cleaning
    assert report.read == len(dirt.all_together(clean()))
    dropped = sum(f.count for f in report.findings if f.kind.done in ("dropped", "cut"))
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
    trip = load(tmp_path, dirt.all_together(noisy))
    found = counts(trip)
    for mended in (FindingKind.STANDING_DRIFT, FindingKind.STEP_BACK):
        found.pop(mended, None)
    assert found == dirt.TOGETHER_COUNTS
    true_m, true_mps = truth_of_run(trip, clean())
    assert np.abs(trip.run.s_m - true_m).max() < 15
    assert np.abs(trip.run.speed_mps - true_mps).max() < 1.5


def test_the_report_says_where_first_and_what(tmp_path: Path) -> None:
    trip = load(tmp_path, dirt.spikes(dirt.jumps_along(dirt.gap(clean()))))
    found = {f.kind: f for f in trip.matched.report.cleaning.findings}
    jump, spike, hole = (found[kind] for kind in (FindingKind.POSITION_JUMP, FindingKind.SPEED_SPIKE, FindingKind.GAP))
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
    assert counts(trip) == {FindingKind.ENDS_MOVING: 1}
    (finding,) = trip.matched.report.cleaning.findings
    left_m, last_mps = dirt.LENGTH_M - cut[-1].s_m, cut[-1].v
    assert last_mps is not None
    assert finding.detail == f"at {last_mps * 3.6:.0f} km/h, {left_m:.0f} m before B"
    assert not trip.whole
    assert (trip.run.time_s[-1], trip.run.s_m[-1]) == pytest.approx((280, cut[-1].s_m), abs=1.5)
    assert trip.run.speed_mps[-1] == pytest.approx(last_mps, abs=0.3)


def test_a_record_without_speeds_is_led_by_its_positions(tmp_path: Path) -> None:
    trip = load(tmp_path, clean(), speeds=False)
    assert counts(trip) == {FindingKind.SPEED_MISSING: len(clean())}
    assert trip.matched.dropout.all()
    true_m, true_mps = truth_of_run(trip, clean())
    assert trip.run.speed_mps == pytest.approx(true_mps, abs=1.0)
    assert np.abs(trip.run.s_m - true_m).max() < 5


@pytest.mark.parametrize("factor", [3.6, 1 / 3.6])
def test_speeds_in_another_unit_are_not_used(tmp_path: Path, factor: float) -> None:
    trip = load(tmp_path, [replace(p, v=p.v * factor) for p in clean()])  # type: ignore[operator]
    assert counts(trip) == {FindingKind.SPEED_MISSING: len(clean())}
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
    chain = cleaning.longest_rise(np.array(values))
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
        return len(some) - sum(STRAY_WEIGHT * table[a, b] ** 2 * (b - a - 1) for a, b in pairwise(some))

    chain = cleaning.longest_chain(lambda i, j: table[i, j], np.arange(float(count)))
    assert all(table[a, b] < 1 for a, b in pairwise(chain))
    best = max(
        worth(some)
        for size in range(1, count + 1)
        for some in combinations(range(count), size)
        if all(table[a, b] < 1 for a, b in pairwise(some))
    )
    assert best - 0.5 <= worth(chain) <= best  # of two nearly as good the one that strays less


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
    trip = load_trip(path, read_trip(path), route(), TripOptions())
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
    assert counts(trip)[FindingKind.POSITION_JUMP] == 60
    assert not {FindingKind.SPEED_DROPOUT, FindingKind.SPEED_SPIKE} & counts(trip).keys()
    assert np.abs(trip.run.s_m - truth_of_run(trip, points)[0]).max() < 15


@pytest.mark.parametrize("spiked", [True, False])
def test_a_long_noisy_stand_is_one_stand(tmp_path: Path, spiked: bool) -> None:
    """The arrival is when the train came, whatever the fixes of the next 20 minutes wander, without speeds and with a
    wrong one."""
    rng = np.random.default_rng(3)
    long_stand = dirt.late_end(dirt.late_end(dirt.late_end(clean())))
    points = [replace(p, t=100.0 + i, s_m=p.s_m + 3 * rng.standard_normal()) for i, p in enumerate(long_stand)]
    trip = load(tmp_path, changed(points, (500, 800), v=98.6), speeds=spiked)
    arrived = next(i for i, p in enumerate(clean()) if i > STOOD_S and p.v == 0)
    at = (int(trip.matched.time_ns[trip.matched.ends.arrival]) * 1e-9) - EPOCH_S - 100.0
    assert at == pytest.approx(arrived, abs=8)
    assert counts(trip)[FindingKind.LONG_STAND_AT_END] > 800


def test_positions_frozen_to_the_end_are_no_stop(tmp_path: Path) -> None:
    """The receiver holds its last fix while the speeds go on: nobody knows where the train came to stand."""
    points = clean()
    trip = load(tmp_path, changed(points, range(251, len(points)), s_m=points[250].s_m))
    assert counts(trip) == {FindingKind.POSITION_FROZEN: len(points) - 251, FindingKind.ENDS_MOVING: 1}
    check_truth(trip, points)


def test_a_dropout_beside_a_gap_or_a_stop_is_found_whole(tmp_path: Path) -> None:
    """Speeds of 0 on both sides of a hole of 31 s are no stand, and those while braking not yet the arrival."""
    points = clean()
    dropped = changed(points, [*range(140, 150), *range(180, 190), *range(300, 335)], v=0.0)
    trip = load(tmp_path, dropped[:150] + dropped[180:])
    assert counts(trip)[FindingKind.SPEED_DROPOUT] >= 20 + 25
    at = (trip.matched.time_ns * 1e-9) - EPOCH_S
    assert trip.matched.s_m == pytest.approx(np.interp(at, [p.t for p in points], [p.s_m for p in points]), abs=4)
    arrived = next(p.t for i, p in enumerate(points) if i > STOOD_S and p.v == 0)
    assert at[trip.matched.ends.arrival] == pytest.approx(arrived, abs=3)


def test_a_speed_of_0_in_another_unit_is_a_stand(tmp_path: Path) -> None:
    """One fix at either stop, 6 s from the next: the positions alone do not tell that the train stands there."""
    points = [p for p in clean() if p.v]
    first, last = clean()[STOOD_S], clean()[-STOOD_S]
    sparse = [first, *points[5:-5], last]
    trip = load(tmp_path, [replace(p, v=p.v / 3.6 if p.v else p.v) for p in sparse])
    assert trip.whole
    assert counts(trip)[FindingKind.SPEED_MISSING] == len(sparse)
    with pytest.raises(DasError, match=r"cannot be aligned .* \(its speeds are not those of its positions"):
        load(tmp_path, [replace(p, v=5.0) for p in points[60:-60]])


def test_a_trip_of_gaps_alone_is_refused(tmp_path: Path) -> None:
    points = clean()
    with pytest.raises(DasError, match=r"no points in 3\d\d s of the trip's 3\d\d s, expected less than half"):
        load(tmp_path, [points[0], points[170], points[-1]])
