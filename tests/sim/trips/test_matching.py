"""Positions matched to a line, dropouts bridged, and the even run; made-up trips with known answers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from das.domain.errors import DasError
from sim.trips.cleaning import FindingKind
from sim.trips.line import Line
from sim.trips.matching import match_trip
from sim.trips.profile import to_profile
from tests.support.made_line import START_NS, counts, matched, motion, posts, record, route


def test_standstills_are_put_on_the_stops(tmp_path: Path) -> None:
    """Posts 0.5 % too far apart for the route: both ends fit, the scale is reported."""
    t, s, v = motion(8040.0)
    result = matched(record(t, s, v, east_m=25.0), posts(tmp_path), route(8000.0))
    assert result.report.anchor == "start and end"
    assert result.report.scale == pytest.approx(8000 / 8040, rel=1e-6)
    assert result.report.offset_m == pytest.approx(-1500 * 8000 / 8040, abs=0.01)
    assert result.report.median_cross_track_m == pytest.approx(25, rel=0.005)
    assert result.s_m == pytest.approx(s * 8000 / 8040, abs=0.01)
    assert counts(result) == {}


def test_one_standstill_gives_the_offset_alone(tmp_path: Path) -> None:
    t, s, v = motion()
    cut = t < 200
    at_start = matched(record(t[cut], s[cut], v[cut]), posts(tmp_path), route())
    at_end = matched(record(t[~cut], s[~cut], v[~cut]), posts(tmp_path), route())
    assert (at_start.report.anchor, at_end.report.anchor) == ("start", "end")
    assert at_start.report.scale == at_end.report.scale == 1
    assert at_start.s_m == pytest.approx(s[cut], abs=0.01)
    assert at_end.s_m == pytest.approx(s[~cut], abs=0.01)
    middle = (t > 50) & (t < 200)
    moving = record(t[middle], s[middle], v[middle])
    said = (
        "neither at the first nor at the last line that fits.* a record from its stand at A or to that at B, or a route"
    )
    with pytest.raises(DasError, match=said):
        matched(moving, posts(tmp_path), route())


def test_lengths_that_disagree_are_not_scaled_away(tmp_path: Path) -> None:
    t, s, v = motion(7800.0)
    result = matched(record(t, s, v), posts(tmp_path), route(8000.0))
    assert (result.report.anchor, result.report.scale) == ("start", 1.0)
    assert result.s_m[-1] == pytest.approx(7800, abs=0.01)


def test_a_route_with_geometry_is_taken_as_it_is() -> None:
    t, s, v = motion(7500.0)
    on = route(8000.0, geometry=True)
    result = matched(record(t, s, v, from_m=300.0), Line.from_route(on), on)
    assert (result.report.anchor, result.report.offset_m, result.report.scale) == ("route", 0.0, 1.0)
    assert result.s_m == pytest.approx(300 + s, abs=0.01)


def test_small_backward_steps_are_made_flat_and_counted(tmp_path: Path) -> None:
    t, s, v = motion()
    noisy = s.copy()
    noisy[100] -= 45  # 15 m behind the point before, at 30 m/s
    result = matched(record(t, noisy, v), posts(tmp_path), route())
    assert counts(result) == {FindingKind.STEP_BACK: 1}
    assert result.s_m[100] == result.s_m[99]
    assert np.diff(result.s_m).min() >= 0


def test_fixes_that_wander_in_a_station_are_put_together(tmp_path: Path) -> None:
    t, s, v = motion()
    t = np.concatenate((np.arange(4.0), t + 4, t[-1] + 5 + np.arange(4.0)))
    s, v = (np.concatenate((np.full(4, x[0]), x, np.full(4, x[-1]))) for x in (s, v))
    wandering = s.copy()
    wandering[:3] += [14, 9, 3]
    wandering[-3:] += [-6, 5, 8]
    result = matched(record(t, wandering, v), posts(tmp_path), route())
    assert result.s_m == pytest.approx(s, abs=0.5)
    run = to_profile(result)
    assert run.start_time_ns == START_NS + 4 * 10**9
    assert run.time_s[-1] == pytest.approx(motion()[0][-1], abs=1.0)


def test_stops_in_the_wrong_order_are_refused(tmp_path: Path) -> None:
    on = route()
    with pytest.raises(DasError, match="B does not lie before A on the route as driven"):
        match_trip(record(*motion()), posts(tmp_path), on, (on.stops[1], on.stops[0]))


@pytest.mark.parametrize(("first", "count"), [(30, 12), (120, 1), (150, 3)])
def test_dropouts_are_found_and_bridged(tmp_path: Path, first: int, count: int) -> None:
    t, s, v = motion()
    reported = v.copy()
    reported[first : first + count] *= 0.02
    result = matched(record(t, s, reported), posts(tmp_path), route())
    assert np.flatnonzero(result.dropout).tolist() == list(range(first, first + count))
    assert counts(result) == {FindingKind.SPEED_DROPOUT: count}
    assert result.speed_mps == pytest.approx(v, abs=1.0)
    run = to_profile(result)
    assert np.abs(run.acceleration_mps2).max() < 0.6
    assert run.dropout[first : first + count].all()
    assert run.s_m == pytest.approx(s, abs=1.5)


def test_a_clean_run_is_given_back(tmp_path: Path) -> None:
    t, s, v = motion()
    run = to_profile(matched(record(t, s, v), posts(tmp_path), route()))
    assert run.speed_lag_s == 0
    assert run.s_m == pytest.approx(s, abs=1.0)
    assert run.speed_mps == pytest.approx(v, abs=0.5)
    inner = (t > 8) & (t < 52)
    assert run.acceleration_mps2[inner] == pytest.approx(0.5, abs=0.05)
    assert (run.s_m[0], run.speed_mps[0], run.speed_mps[-1]) == (0, 0, 0)
    assert run.s_m[-1] == pytest.approx(8000, abs=1e-6)


def test_a_late_speed_is_shifted_back(tmp_path: Path) -> None:
    t, s, v = motion(8100.0)  # 330 s
    seconds = np.arange(336.0)
    late, there = np.interp(seconds - 2.5, t, v), np.interp(seconds, t, s)
    run = to_profile(matched(record(seconds, there, late), posts(tmp_path), route(8100.0)))
    assert run.speed_lag_s == pytest.approx(2.5, abs=0.25)
    assert run.time_s[-1] == pytest.approx(330, abs=1)
    at = run.time_s + (run.start_time_ns - START_NS) * 1e-9
    assert run.s_m == pytest.approx(np.interp(at, t, s), abs=4.0)
    assert run.speed_mps == pytest.approx(np.interp(at, t, v), abs=0.7)


def test_an_even_speed_shows_no_lag(tmp_path: Path) -> None:
    """Nothing to see a lag by: none is made up, though the reported speed is 1 % low."""
    t = np.append(np.arange(5.0, 200.0), 200.0)
    on = route(8000.0, geometry=True)
    trip = record(t, 30 * t, np.full(len(t), 29.7), from_m=0.0)
    run = to_profile(matched(trip, Line.from_route(on), on))
    assert run.speed_lag_s == 0
    assert run.s_m == pytest.approx(150 + 30 * run.time_s, abs=20)  # at an open end: 50 s (σ_s/σ_v) of 0.3 m/s


@pytest.mark.parametrize("seed", range(3))
def test_noise_does_not_become_acceleration(tmp_path: Path, seed: int) -> None:
    t, s, v = motion()
    rng = np.random.default_rng(seed)
    noisy_s = s + np.where(v > 1, rng.normal(0, 4, len(t)), 0)
    noisy_v = np.abs(v + np.where(v > 1, rng.normal(0, 0.4, len(t)), 0))
    result = matched(record(t, noisy_s, noisy_v), posts(tmp_path), route())
    run = to_profile(result)
    cruise = (t > 70) & (t < 255)
    assert not result.dropout.any()
    assert run.acceleration_mps2[cruise].std() < 0.1
    assert np.abs(run.s_m - s).max() < 12
    assert np.sum(run.speed_mps) == pytest.approx(run.s_m[-1] - run.s_m[0], abs=1.0)


def test_a_run_of_two_seconds_is_too_short() -> None:
    t, s, v = (x[100:103] for x in motion())
    on = route(geometry=True)
    with pytest.raises(DasError, match="a run of 2 s is too short, expected at least 3 s"):
        to_profile(matched(record(t, s, v, from_m=0.0), Line.from_route(on), on))
