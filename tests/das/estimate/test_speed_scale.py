"""Speeds in another unit than m/s: found by the way between the positions, and no advice rests on them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from das.domain.units import KMH, NS
from das.estimate.estimate import ProblemKind
from das.estimate.localisation import Localisation
from tests.support.fixes import SD_M, T0, TRAIN, at, fixes, truth


@pytest.mark.parametrize("hz", [0.25, 1.0, 10.0])
@pytest.mark.parametrize(("factor", "way_factor"), [(3.6, 1.0), (1000.0, 1.0), (1.0, 0.001)])
def test_speeds_of_another_unit_give_no_state_once_the_train_has_run_a_few_metres(
    hz: float, factor: float, way_factor: float
) -> None:
    """Speeds in km/h, speeds in mm/s, positions in km; the train sets off at second 10."""
    localisation, last_m = Localisation(TRAIN), 0.0
    for fix in fixes(165.0, hz=hz):
        localisation.take(replace(fix, s_m=way_factor * fix.s_m, speed_mps=factor * fix.speed_mps))
        found = localisation.at(fix.time_ns)
        if found.usable and found.speed_mps > 10 * KMH:
            last_m = truth((fix.time_ns - T0) * NS)[0]
        elif not found.usable and found.problem is not None and found.problem.kind is ProblemKind.SPEED_UNIT:
            assert found.problem.value == (factor if factor > 1.0 else 1.0 / way_factor)
    assert found.problem is not None
    assert found.problem.kind is ProblemKind.SPEED_UNIT  # also while it stands again
    assert last_m < 20.0


def test_a_sender_that_is_put_right_is_heeded_again() -> None:
    localisation = Localisation(TRAIN)
    for fix in fixes(120.0):
        time_s = (fix.time_ns - T0) * NS
        localisation.take(replace(fix, speed_mps=fix.speed_mps * (3.6 if time_s < 80 else 1.0)))
        found = localisation.at(fix.time_ns)
        if 30 < time_s < 80 or time_s > 90:
            assert found.usable == (time_s > 90)


def test_a_node_started_on_the_way_does_not_drive_by_km_h() -> None:
    """A true 40 km/h sent as 40 was taken for 144 km/h, and the friction brake was advised."""
    localisation = Localisation(TRAIN)
    for second in range(120):
        localisation.take(at(second, 40 * KMH * second, 40.0))
        found = localisation.at(T0 + round(second / NS))
        if second >= 3:
            assert found.problem is not None
            assert found.problem.kind is ProblemKind.SPEED_UNIT


@pytest.mark.parametrize("sd_m", [SD_M, 8.0, 30.0])
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
