"""A wrong force sensor: a gain, different gains in traction and braking, and forces that the train cannot have."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from das.domain.conditions import Conditions
from das.estimate.calibration import Calibrator, ForceDoubt, Recalibration
from sim.plant.plant import COAST, Plant, lever
from tests.das.estimate.test_calibration import ROUTE, SEEDS, THALWIL, VEHICLE, ZUG, States, driven, feed, fresh, ns
from tests.support.crossing import crossed

FEW_SEEDS = SEEDS[:3]


def with_gain(states: States, traction: float, braking: float | None = None) -> States:
    """A drive as a sensor with these gains measures it."""
    back = traction if braking is None else braking
    return tuple(
        s._replace(
            force_el_n=s.force_el_n * (traction if s.force_el_n > 0 else back),
            force_friction_n=s.force_friction_n * back,
        )
        for s in states
    )


def planned(calibrator: Calibrator, states: States, seed: int) -> list[Conditions]:
    """All conditions that the plans of a drive use."""
    recalibration, found = Recalibration(), []
    for state in feed(calibrator, states, seed):
        conditions = recalibration.due(calibrator.estimates, ns(state.time_s))
        if conditions is not None:
            found.append(conditions)
    return found


@pytest.mark.parametrize(("gain", "leg"), crossed([0.5, 0.65, 0.75, 0.9, 1.1, 1.25, 1.5], [THALWIL, ZUG]))
def test_a_gain_is_noticed_and_no_plan_uses_it(gain: float, leg: tuple[float, float, float]) -> None:
    for seed in FEW_SEEDS:
        calibrator = fresh()
        found = planned(calibrator, with_gain(driven(leg=leg), gain), seed)
        assert all(one.mass_ratio >= 1.0 for one in found)
        end = calibrator.estimates
        assert not end.usable
        assert end.doubt is not None or end.mass_ratio <= 0.55, end


def test_forces_above_those_of_the_train_are_noticed_at_once() -> None:
    """A driver who starts with full traction shows a gain above 1 within seconds, and it is not forgotten."""
    plant, calibrator, first = Plant(ROUTE, VEHICLE), fresh(), None
    states = [plant.at(THALWIL[0])]
    while len(states) < 40:
        states.append(plant.advance(states[-1], lever(1.0)))
    for state in feed(calibrator, with_gain(tuple(states), 1.2), 1):
        if first is None and calibrator.estimates.doubt is ForceDoubt.TOO_STRONG:
            first = state.time_s
    assert first is not None
    assert first < 60.0
    assert calibrator.estimates.doubt is ForceDoubt.TOO_STRONG


def test_a_heavy_train_is_told_from_a_gain_by_its_resistance() -> None:
    """Mass 30 % more and resistance 20 % less: no gain makes that, and it is planned with."""
    found = planned(fresh(), driven(1.3, 0.8, leg=ZUG), 1)
    assert found
    assert found[-1].mass_ratio == pytest.approx(1.3, abs=0.03)


def test_other_gains_in_traction_and_braking_make_no_train_lighter() -> None:
    found = [planned(fresh(), with_gain(driven(leg=ZUG), 0.7, 1.0), seed) for seed in FEW_SEEDS]
    assert all(one.mass_ratio >= 1.0 for conditions in found for one in conditions)


@pytest.mark.parametrize(("off_n", "doubt"), [(0.0, None), (15e3, ForceDoubt.COASTING)])
def test_coasting_contradicts_a_sensor_that_is_off_only_under_force(off_n: float, doubt: ForceDoubt | None) -> None:
    """A standing error while the motors pull looks like resistance; a coasting train does not have it."""
    run = [state for state in driven(leg=ZUG) if state.time_s <= 300.0]
    plant = Plant(ROUTE, VEHICLE)
    for _ in range(110):
        run.append(plant.advance(run[-1], COAST))
    off = [off_n if 100.0 < s.force_el_n < 120e3 else 0.0 for s in run]
    measured = tuple(s._replace(force_el_n=s.force_el_n + one) for s, one in zip(run, off, strict=True))
    for seed in FEW_SEEDS:
        calibrator = fresh()
        for _ in feed(calibrator, measured, seed):
            pass
        assert calibrator.estimates.doubt is doubt


def test_doubted_forces_bring_the_planned_train_back_at_once() -> None:
    calibrator = fresh()
    for _ in feed(calibrator, driven(1.3, 0.8, leg=ZUG), 1):
        pass
    trusted, recalibration = calibrator.estimates, Recalibration()
    assert recalibration.due(trusted, ns(0.0)) == Conditions(
        mass_ratio=trusted.mass_ratio, resistance_ratio=trusted.resistance_ratio
    )
    doubted = replace(trusted, usable=False, doubt=ForceDoubt.TWO_PUBLISHERS)
    assert recalibration.due(doubted, ns(1.0)) == Conditions()
    assert recalibration.due(doubted, ns(2.0)) is None


def test_a_lighter_train_is_planned_as_it_is_in_its_file() -> None:
    found = [planned(fresh(), driven(0.9, 1.5, leg=ZUG), seed) for seed in FEW_SEEDS]
    assert any(found)
    assert all(one.mass_ratio == 1.0 and one.resistance_ratio > 1.2 for conditions in found for one in conditions)
    assert np.isfinite([one.resistance_ratio for conditions in found for one in conditions]).all()
