"""Measures of a trial: against witnesses from its own seconds, and the page that defines them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from das.domain.levels import Level
from das.domain.units import KMH
from sim.drivers.kinds import DriverKind, Presentation
from sim.experiment.driving import Driven, StudyTrial, drive, service_of
from sim.experiment.factors import Setting
from sim.experiment.measures import MEASURES, measured
from sim.experiment.study_files import recording_file
from tests.support.making import REPOSITORY

UNITS = {"kwh": "kWh", "s": "s", "m": "m", "ratio": "1", "mps": "m/s", "mps3": "m/s³", "per_min": "1/min"}
COUNTS = {
    *("power_brake_reversals", "signals_passed", "lapses", "reversals", "instructions", "effort_changes_per_brake"),
    *("missed_coasts", "vain_accelerations", "odd_speeds", "hidden_limits", "advice_restless", "stops_missed"),
    *("advices_given", "advices_withdrawn", "advices_unheard", "advices_above_limit", "last_word_acts"),
}
OF_THE_GUIDE = {
    *("shortest_instruction_s", "announced_ratio", "brakes_led_ratio", "effort_changes_per_brake"),
    "promises_kept_ratio",
}
NO_MEASURES = {
    *("scenario", "seed", "level", "stops", "passings", "not_comparable"),
    *("over_limit_kmh", "above_optimum_ratio"),
}
"""What a run gives that is no measure; a study has the last two as `over_limit_mps` and `gap_to_optimum_ratio`."""


ON_FLAT = Setting(scenario="flat-6km", presentation=Presentation.SPEED_AND_EFFORT)


def trial(setting: Setting, *, person: int = 1, seed: int = 2) -> StudyTrial:
    return StudyTrial(
        number=1, who=1, person=person, session=1, position=1, practice=False, levels=("x",), setting=setting,
        seed=seed, chance=0, trips=None,
    )  # fmt: skip


def driven_with(setting: Setting, **more: int) -> Driven:
    return drive(trial(setting, **more), "default")


@pytest.fixture(scope="module")
def vector() -> Driven:
    return driven_with(ON_FLAT)


def shown(driven: Driven, name: str) -> list[float]:
    """A figure of the display at every second; NaN where it shows no advice."""
    return [math.nan if look.shown is None else getattr(look.shown, name) for _, look in driven.seconds]


def test_every_measure_has_a_value_and_its_unit_in_its_name(vector: Driven) -> None:
    found = measured(vector, list(MEASURES))
    assert {name for name, value in found.items() if value is None} == OF_THE_GUIDE
    for name, measure in MEASURES.items():
        ends = [unit for end, unit in UNITS.items() if name.endswith(f"_{end}")]
        assert (measure.unit in ends) or (name in COUNTS and measure.unit == "1")
        assert measure.formula
        assert measure.source


def test_every_figure_of_a_run_is_a_measure(vector: Driven) -> None:
    figures = vector.outcome.as_dict()
    assert figures.keys() - MEASURES.keys() == NO_MEASURES
    assert measured(vector, list(figures.keys() - NO_MEASURES)) == {
        name: value for name, value in figures.items() if name not in NO_MEASURES
    }
    assert measured(vector, ["gap_to_optimum_ratio"]) == {"gap_to_optimum_ratio": figures["above_optimum_ratio"]}


def test_the_energy_is_split_without_rest(vector: Driven) -> None:
    found = measured(vector, list(MEASURES))
    parts = [found[f"energy_{part}_kwh"] for part in ("optimum", "blending", "profile")]
    assert sum(parts) == pytest.approx(found["energy_kwh"])
    assert found["gap_to_optimum_ratio"] == pytest.approx(found["energy_kwh"] / found["energy_optimum_kwh"] - 1.0)
    front = vector.day.service.fronts[0]
    planned_s = vector.day.service.timetables[0].arrival_ns - vector.day.service.timetables[0].departure_ns
    on_time_kwh = front.trajectory(planned_s * 1e-9).balance.input / 3.6e6
    equal = found["energy_kwh"] - found["energy_optimum_kwh"] + on_time_kwh
    assert found["energy_at_equal_arrival_kwh"] == pytest.approx(equal)


def test_tracking_against_the_seconds(vector: Driven) -> None:
    speed = np.array([state.speed_mps for state, _ in vector.seconds])
    error = speed - np.array(shown(vector, "shown_speed_mps"))
    error = error[(speed > 0) & ~np.isnan(error)]
    found = measured(vector, list(MEASURES))
    assert found["speed_rmse_mps"] == pytest.approx(math.sqrt(np.mean(error**2)), rel=1e-12)
    assert found["speed_in_band_ratio"] == pytest.approx(np.mean(np.abs(error) <= 3 * KMH))
    lever = np.array([look.lever_ratio for _, look in vector.seconds])
    effort = lever - np.array(shown(vector, "lever_ratio"))
    effort = effort[(speed > 0) & ~np.isnan(effort)]
    assert found["effort_rmse_ratio"] == pytest.approx(math.sqrt(np.mean(effort**2)), rel=1e-12)
    acceleration = [state.acceleration_mps2 for state, _ in vector.seconds]
    jerk = np.diff(acceleration)[(speed[:-1] > 0) & (speed[1:] > 0)]
    assert found["jerk_rms_mps3"] == pytest.approx(math.sqrt(np.mean(jerk**2)), rel=1e-12)


def test_decisions_against_the_diary(vector: Driven) -> None:
    found = measured(vector, list(MEASURES))
    kinds = [one.what for one in vector.run.decisions]
    followed, refused = kinds.count("followed"), kinds.count("refused")
    assert found["compliance_ratio"] == pytest.approx(followed / (followed + refused))
    assert found["lapses"] == kinds.count("lapse")
    ((departed, arrived),) = vector.run.legs
    on_the_way = {
        what: sum(one.what == what and departed.time_s <= one.time_s <= arrived.time_s for one in vector.run.decisions)
        for what in ("glance", "lever")
    }
    moving_min = vector.moving_min
    assert found["glances_per_min"] == pytest.approx(on_the_way["glance"] / moving_min, abs=1.1 / moving_min)
    # The diary has each order to the controller; orders while it still moves are one movement.
    assert 0.85 * on_the_way["lever"] <= found["control_movements_per_min"] * moving_min <= on_the_way["lever"]
    assert 0.5 < found["reaction_s"] < 8.0
    assert found["response_s"] >= found["reaction_s"]


def test_without_advice_there_is_nothing_to_track() -> None:
    found = measured(driven_with(Setting(scenario="flat-6km", presentation=Presentation.NONE)), list(MEASURES))
    missing = {name for name, value in found.items() if value is None}
    assert missing == {
        *("speed_rmse_mps", "speed_in_band_ratio", "effort_rmse_ratio", "reaction_s", "response_s"),
        *("compliance_ratio", "advice_changes_per_min", "shortest_mode_s", *OF_THE_GUIDE),
    }


def test_a_perfect_driver_has_no_lever_and_no_diary_and_nearly_no_gap() -> None:
    driven = driven_with(
        Setting(scenario="flat-6km", driver=DriverKind.PERFECT, presentation=Presentation.SPEED_AND_EFFORT)
    )
    found, energies = measured(driven, list(MEASURES)), driven.outcome.energies
    assert found["control_movements_per_min"] is None
    assert found["glances_per_min"] is None
    assert found["gap_to_optimum_ratio"] == pytest.approx(energies.above.driven_j / energies.above.optimum_j - 1.0)
    assert energies.own_braking_j is not None
    assert energies.above.optimum_j < energies.own_braking_j < energies.above.driven_j < 1.03 * energies.own_braking_j


def test_the_true_train_does_not_change_with_the_losses_of_the_advice() -> None:
    own, planned = (service_of(Setting(scenario="flat-6km", loss_level=level)) for level in (None, Level.L1))
    assert (own.level, planned.level) == (Level.L3, Level.L1)
    assert own.timetables == planned.timetables
    gaps = {}
    for level in (None, Level.L1):
        driven = driven_with(
            Setting(
                scenario="flat-6km",
                driver=DriverKind.PERFECT,
                presentation=Presentation.SPEED_AND_EFFORT,
                loss_level=level,
            )
        )
        energies = driven.outcome.energies
        gaps[level] = energies.above.ratio
        time_s = driven.outcome.running_time_s
        assert energies.above.optimum_j == pytest.approx(own.fronts[0].trajectory(time_s).balance.input, rel=1e-12)
    assert gaps[Level.L1] is not None
    assert gaps[None] is not None
    assert gaps[Level.L1] > gaps[None] + 0.001


def test_the_pages_show_the_tables_of_the_program() -> None:
    for page, table in (("measures", "measures"), ("experiments", "factors")):
        text = (REPOSITORY / "docs" / "reference" / f"{page}.md").read_text(encoding="utf-8")
        assert f"{{{{ figures: python -m docs.studies.reference -> {table}.md }}}}" in text


def test_a_recording_is_named_by_driver_condition_and_day() -> None:
    assert recording_file(trial(Setting())) == "recordings/sub-01_run-001_x_seed-2.mcap"
