"""Speeds in another unit than m/s: found by the way between the positions, and no advice rests on them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from das.domain.units import KMH, NS
from das.estimate.estimate import ProblemKind
from das.estimate.localisation import Localisation
from das.estimate.track_filter import WANDER_S
from tests.support.crossing import few
from tests.support.fixes import SD_M, SD_MPS, T0, TRAIN, at, fixes, ns, truth


@pytest.mark.parametrize("hz", [0.25, 1.0, 10.0])
@pytest.mark.parametrize(
    ("factor", "way_factor"), [(3.6, 1.0), (1000.0, 1.0), (1.0, 0.001), (1 / 3.6, 1.0), (1.0, 3.6), (0.001, 1.0)]
)
def test_speeds_of_another_unit_give_no_state_once_the_train_has_run_a_few_metres(
    hz: float, factor: float, way_factor: float
) -> None:
    """Speeds in km/h, speeds in mm/s, positions in km, speeds converted twice; the train sets off at second 10."""
    localisation, last_m = Localisation(TRAIN), 0.0
    for fix in fixes(165.0, hz=hz):
        localisation.take(replace(fix, s_m=way_factor * fix.s_m, speed_mps=factor * fix.speed_mps))
        found = localisation.at(fix.time_ns)
        if found.usable and fix.speed_mps > 10 * KMH:
            last_m = truth((fix.time_ns - T0) * NS)[0]
        elif not found.usable and found.problem is not None and found.problem.kind is ProblemKind.SPEED_UNIT:
            assert found.problem.value == pytest.approx(factor / way_factor)
    assert found.problem is not None
    assert found.problem.kind is ProblemKind.SPEED_UNIT  # also while it stands again
    assert last_m < (20.0 if factor / way_factor > 1.0 else 60.0)


def test_a_sender_that_is_put_right_is_heeded_again() -> None:
    localisation = Localisation(TRAIN)
    for fix in fixes(120.0):
        time_s = (fix.time_ns - T0) * NS
        localisation.take(replace(fix, speed_mps=fix.speed_mps * (3.6 if time_s < 80 else 1.0)))
        found = localisation.at(fix.time_ns)
        if 30 < time_s < 80 or time_s > 90:
            assert found.usable == (time_s > 90)


@pytest.mark.parametrize("stated_mps", [0.0, 0.02, 5.0])
@pytest.mark.parametrize("sd_m", [SD_M, 10.0, 30.0])
@pytest.mark.parametrize("way_mps", [2.0, 40 * KMH, 30.0])
@pytest.mark.parametrize("factor", [3.6, 1000.0])
def test_a_state_begun_on_the_way_never_drives_by_another_unit(
    factor: float, way_mps: float, sd_m: float, stated_mps: float
) -> None:
    """A true 40 km/h sent as 40 was taken for 144 km/h for three positions, however exact it was said to be."""
    localisation = Localisation(TRAIN)
    for second in range(120):
        said = {"uncertainty_m": sd_m, "speed_uncertainty_mps": stated_mps}
        localisation.take(at(second, way_mps * second, factor * way_mps, **said))
        assert not localisation.at(ns(second)).usable
    found = localisation.at(ns(second)).problem
    assert found is not None
    assert found == (ProblemKind.SPEED_UNIT, factor)


@pytest.mark.parametrize(
    ("way_mps", "sd_m", "most_s"),
    [(40 * KMH, SD_M, 2), (30.0, SD_M, 1), (20.0, 10.0, 3), (3.0, SD_M, 2), (3.0, 8.0, 4), (3.0, 30.0, 15)],
)
def test_a_state_begun_on_the_way_is_used_once_the_way_has_confirmed_the_speed(
    way_mps: float, sd_m: float, most_s: int
) -> None:
    localisation, usable = Localisation(TRAIN), []
    for second in range(60):
        localisation.take(at(second, way_mps * second, way_mps, uncertainty_m=sd_m))
        found = localisation.at(ns(second))
        usable.append(found.usable)
        assert found.usable or found.problem == (ProblemKind.SPEED_UNCONFIRMED, pytest.approx(way_mps))
        assert found.s_m == pytest.approx(way_mps * second)  # The place is known meanwhile.
    assert usable == [False] * most_s + [True] * (60 - most_s)


def test_a_train_that_stood_or_crawls_or_whose_speed_is_not_measured_need_not_be_confirmed() -> None:
    stood, crawling, unmeasured = Localisation(TRAIN), Localisation(TRAIN), Localisation(TRAIN)
    for second in range(20):
        stood.take(at(second, 0.5 * second**2, float(second)))
        crawling.take(at(second, 1.0 * second, 1.0, uncertainty_m=30.0))
        unmeasured.take(at(second, 20.0 * second, 20.0 if second == 0 else math.nan))
        assert stood.at(ns(second)).usable
        assert crawling.at(ns(second)).usable
        assert unmeasured.at(ns(second)).usable == (second > 6)


@pytest.mark.parametrize("sd_m", few([SD_M, 8.0, 30.0], (8.0,), pytest.mark.slow))
def test_noise_jumps_late_speeds_and_a_frozen_receiver_are_no_other_unit(sd_m: float) -> None:
    random = np.random.default_rng(3)
    for seed in range(12):
        localisation = Localisation(TRAIN)
        for fix in fixes(165.0, seed=seed, noise_m=sd_m):
            time_s = (fix.time_ns - T0) * NS
            off_m = sd_m * random.standard_normal() + (-60.0 if seed % 2 and time_s > 70 else 0.0)
            off_m -= 8.0 if seed % 3 == 0 and 80 < time_s < 95 else 0.0
            speed_mps = truth(time_s - 2.5)[1]
            s_m = truth(100.0)[0] if 100 < time_s < 110 else fix.s_m + off_m
            localisation.take(replace(fix, s_m=s_m, speed_mps=speed_mps, uncertainty_m=sd_m))
            found = localisation.at(fix.time_ns)
            assert found.problem is None or found.problem.kind is not ProblemKind.SPEED_UNIT
        assert math.isfinite(found.s_m)


@pytest.mark.parametrize("sd_m", few([SD_M, 10.0], (10.0,), pytest.mark.slow))
@pytest.mark.parametrize("way_mps", [10.0, 30.0, 60.0])
@pytest.mark.parametrize("scale", few([0.9, 1.0, 1.1], (1.1,), pytest.mark.slow))
def test_positions_win_over_the_scale_of_speeds_that_claim_to_be_exact(
    scale: float, way_mps: float, sd_m: float
) -> None:
    """Speeds 10 % too high, stated to 0.05 m/s, took a train 32 m off within a minute at 10 m/s, with 2.2 m stated."""
    train, off, stated = replace(TRAIN, max_speed_mps=70.0), [], []
    for seed in range(12):
        localisation, random = Localisation(train), np.random.default_rng(seed)
        wander_m, keep = sd_m * random.standard_normal(), math.exp(-1.0 / WANDER_S)
        for second in range(121):
            wander_m = keep * wander_m + sd_m * math.sqrt(1.0 - keep**2) * random.standard_normal()
            said_mps = scale * way_mps + SD_MPS * random.standard_normal()
            localisation.take(at(second, way_mps * second + wander_m, said_mps, uncertainty_m=sd_m))
            found = localisation.at(ns(second))
            off.append((found.s_m - way_mps * second, found.speed_mps - way_mps))
            stated.append((found.position_sd_m, found.speed_sd_mps))
        assert found.speed_mps == pytest.approx(way_mps, rel=0.05)
    beyond = np.mean(np.abs(off) > 2.0 * np.array(stated), axis=0)
    assert beyond[0] < 0.15  # 0.05 by chance; a scale of 0.9 or 1.1 is itself 2.5 deviations off
    assert beyond[1] < 0.35  # the scale of the speed as well
    assert np.mean(stated, axis=0)[0] < 1.3 * sd_m
