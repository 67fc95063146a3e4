"""The figures of a run, by the names that programs read, and the optimum of the train that drove."""

from __future__ import annotations

import dataclasses
import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

from das.domain.errors import InfeasibleError
from das.domain.levels import Level
from das.domain.units import KMH, KWH
from sim.drive.above_optimum import AboveOptimum
from sim.drive.figures import AdviceStability
from sim.drive.limits import Violations
from sim.drivers.kinds import DriverKind, Presentation
from sim.world.in_process import InProcess
from sim.world.lockstep import Traffic
from sim.world.loop import Run, World
from sim.world.outcome import SHARES, DayOutcome, DayResult, outcome, print_result, true_fronts
from sim.world.scenario import read_scenario
from sim.world.service import Day, Service, make_day, prepare_service
from tests.support.flat_days import service_of

KEYS = [
    *("scenario", "seed", "level", "late_s", "stops", "passings", "running_time_s"),
    *("energy_kwh", "energy_optimum_kwh", "above_optimum_kwh", "above_optimum_ratio", "not_comparable"),
    *("energy_at_stops_kwh", "energy_planned_kwh"),
    *("energy_blending_kwh", "energy_profile_kwh", "energy_own_braking_kwh"),
    *("component_loss_kwh", "resistance_kwh", "friction_brake_kwh", "unreturned_kwh", "comfort_kwh"),
    *("component_loss_ratio", "resistance_ratio", "friction_brake_ratio", "unreturned_ratio", "comfort_ratio"),
    *("kinetic_kwh", "potential_kwh", "ledger_residual_ratio"),
    *("advices_given", "advices_withdrawn", "advices_unheard", "advices_above_limit"),
    *("advice_changes_per_min", "reversals", "shortest_mode_s", "advice_restless"),
    *("instructions", "shortest_instruction_s", "announced_ratio", "brakes_led_ratio", "effort_changes_per_brake"),
    *("missed_coasts", "vain_accelerations", "odd_speeds", "standing_acceleration_s"),
    *("promises_kept_ratio", "above_limit_obeying_s", "hidden_limits", "last_word_acts", "availability_ratio"),
    *("signals_passed", "beyond_signal_m", "over_limit_s", "over_limit_kmh", "stops_missed", "simulated_s"),
]
"""The names that `das-sim run --json` promises, in their order."""
HOW = ["driver", "friction_policy", "advice", "happens", "drawn", "wall_s", "real_time_factor", "warnings"]
RECORDING = ["messages_sent", "messages_recorded", "messages_lost", "start_s", "file"]


def driven(service: Service) -> tuple[Day, Run]:
    """The day of seed 1, driven by the perfect follower."""
    day = make_day(service, 1)
    return day, World(day, day.driver(DriverKind.PERFECT), Presentation.SPEED_AND_EFFORT, InProcess(service)).run()


@pytest.fixture(scope="module")
def plain(flat: Callable[[str], Path]) -> tuple[Day, Run]:
    """A day on which all is as planned."""
    return driven(service_of(flat("")))


def result_of(day: Day, found: DayOutcome, file: Path | None = None, traffic: Traffic | None = None) -> DayResult:
    return DayResult(
        outcome=found, driver=DriverKind.PERFECT, advice=Presentation.SPEED_AND_EFFORT, happens="nothing",
        drawn=day.drawn, wall_s=2.0, file=file, traffic=traffic,
    )  # fmt: skip


def test_names_and_values_of_the_figures(plain: tuple[Day, Run]) -> None:
    day, run = plain
    found = outcome(day, run)
    figures = found.as_dict()
    assert list(figures) == KEYS
    json.dumps(figures, allow_nan=False)
    assert (figures["scenario"], figures["seed"], figures["level"]) == ("flat", 1, "l3")
    assert [stop["name"] for stop in figures["stops"]] == [stop.name for stop in day.service.stops]
    assert (figures["stops"][0]["arrived_s"], figures["stops"][-1]["departed_s"]) == (None, None)
    assert figures["late_s"] == found.late_s == figures["stops"][-1]["arrived_late_s"]
    assert figures["simulated_s"] == len(run.states) - 1 > figures["running_time_s"] > 100
    # Between one departure and one arrival nothing is drawn at stops, and the states say the same energy.
    (departed, arrived) = run.legs[0]
    assert figures["energy_at_stops_kwh"] == pytest.approx(0.0, abs=1e-9)
    assert figures["energy_kwh"] == pytest.approx((arrived.input_j - departed.input_j) / KWH)
    assert figures["above_optimum_ratio"] == pytest.approx(figures["energy_kwh"] / figures["energy_optimum_kwh"] - 1.0)
    above = figures["energy_blending_kwh"] + figures["energy_profile_kwh"]
    assert figures["energy_optimum_kwh"] + above == pytest.approx(figures["energy_kwh"])
    # The price of service braking on 6 km, and what a perfect driver needs beyond it.
    assert 1.01 < figures["energy_own_braking_kwh"] / figures["energy_optimum_kwh"] < 1.04
    assert figures["energy_kwh"] < 1.01 * figures["energy_own_braking_kwh"]
    assert sum(figures[f"{name}_ratio"] for name in SHARES) == pytest.approx(1.0)
    assert all(figures[f"{name}_kwh"] == getattr(found.balance, name) / KWH for name in SHARES)


def test_violations_and_a_drive_without_an_optimum_are_told(plain: tuple[Day, Run]) -> None:
    found = outcome(*plain)
    bad = Violations(signals_passed=2, beyond_signal_m=30.0, over_limit_s=4.0, over_limit_mps=10 * KMH)
    (section,) = found.energies.above.sections
    fast = AboveOptimum.of([dataclasses.replace(section, late_s=2.5)], measured=True)
    figures = dataclasses.replace(
        found,
        figures=dataclasses.replace(found.figures, violations=bad),
        energies=dataclasses.replace(found.energies, above=fast),
    ).as_dict()
    assert (figures["signals_passed"], figures["beyond_signal_m"], figures["over_limit_s"]) == (2, 30.0, 4.0)
    assert figures["over_limit_kmh"] == pytest.approx(10.0)
    assert (figures["above_optimum_ratio"], figures["not_comparable"]) == (None, fast.why_not)
    assert (fast.words, fast.ratio) == ("not comparable", None)
    assert fast.why_not.endswith("the optimum is its fastest run, 2.5 s later")


def test_restless_advice_is_told_with_the_result_and_calm_advice_is_not(
    plain: tuple[Day, Run], capsys: pytest.CaptureFixture[str]
) -> None:
    day, run = plain
    calm = AdviceStability(shown_s=600.0, changes=12, reversals=3, shortest_mode_s=9.0)
    restless = dataclasses.replace(calm, changes=123, shortest_mode_s=2.0)
    for measured, warns in ((calm, False), (restless, True)):
        found = outcome(day, run)
        known = dataclasses.replace(found.figures, stability=measured)
        result = result_of(day, dataclasses.replace(found, figures=known))
        told = result.as_dict()
        assert (told["advice_restless"], len(told["warnings"])) == (warns, int(warns))
        assert (told["reversals"], told["advice_changes_per_min"]) == (3, measured.changes / 10)
        print_result(result)
        printed = capsys.readouterr()
        assert f"{measured.changes / 10:.1f} times a minute" in printed.out
        assert ("warning: the advice shown was restless: 12.30 changes" in printed.out + printed.err) == warns


@pytest.mark.parametrize("recorded", [True, False])
def test_what_is_told_beside_the_outcome(recorded: bool, plain: tuple[Day, Run]) -> None:
    day, run = plain
    traffic = Traffic(sent=Counter(cab=5), recorded=Counter(cab=4), start_s=0.5)
    found = outcome(day, run)
    result = result_of(day, found, Path("x.mcap"), traffic) if recorded else result_of(day, found)
    told = result.as_dict()
    assert list(told) == [*KEYS, *HOW, *(RECORDING if recorded else ["file"])]
    assert told["file"] == ("x.mcap" if recorded else None)
    assert (told["driver"], told["advice"]) == ("perfect", "speed-and-effort")
    assert told["real_time_factor"] == result.outcome.simulated_s / 2.0
    json.dumps(told, allow_nan=False)


def service_at(path: Path, level: Level | None = None) -> Service:
    return prepare_service(read_scenario(path), level=level)


def test_a_plan_with_other_losses_is_compared_with_the_optimum_of_the_true_ones(flat: Callable[[str], Path]) -> None:
    """Planned with constant efficiency, driven with a loss map: the optimum is that of the map."""
    path = flat('[truth]\nlevel = "l3"')
    efficient, true = (outcome(*driven(service_at(path, level))) for level in (Level.L1, None))
    assert (efficient.level, true.level) == ("l1", "l3")
    of_map = service_at(path).fronts[0].trajectory(efficient.running_time_s)
    assert efficient.energies.above.optimum_j == pytest.approx(of_map.balance.input, rel=1e-12)
    gaps = [found.energies.above.ratio for found in (efficient, true)]
    assert all(gap is not None and 0.0 < gap < 0.05 for gap in gaps)
    # The plan of the wrong level cannot be better for the train than the plan of its own.
    assert gaps[0] >= gaps[1] - 1e-3


def test_a_heavier_train_has_a_higher_optimum(flat: Callable[[str], Path]) -> None:
    heavy = service_at(flat("[truth]\nmass_ratio = 1.2"))
    found = outcome(*driven(heavy))
    of_plan = heavy.fronts[0].trajectory(found.running_time_s)
    assert found.energies.above.optimum_j > 1.05 * of_plan.balance.input
    day = make_day(heavy, 1)
    assert true_fronts(day)[0] is true_fronts(day)[0], "solved once"
    assert true_fronts(day)[0].section.train.inertial_mass_kg == pytest.approx(day.plant.vehicle.inertial_mass_kg)


def test_where_the_plan_is_true_its_own_optimum_is_taken(plain: tuple[Day, Run]) -> None:
    assert true_fronts(plain[0]) is plain[0].service.fronts


def test_another_scenario_of_the_same_service_has_its_own_truth(flat: Callable[[str], Path]) -> None:
    service = service_at(flat("[truth]\nmass_ratio = 1.2"))
    heavy = true_fronts(make_day(service, 1))
    other = service.on(read_scenario(flat('[truth]\nmass_ratio = 1.2\nlevel = "l2"')))
    assert other.true_fronts == {}
    assert true_fronts(make_day(other, 1))[0].section.level is Level.L2
    assert heavy[0].section.level is Level.L3


def test_a_true_train_that_such_braking_cannot_hold_costs_one_figure_only(
    plain: tuple[Day, Run], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    day, run = plain
    whole = outcome(day, run).as_dict()

    def refused(*_: object) -> None:
        raise InfeasibleError("line.toml: the train cannot brake on the descent at 900 m")

    monkeypatch.setattr("sim.world.outcome.fronts_of_braking", refused)
    found = outcome(day, run)
    assert found.as_dict() == {**whole, "energy_own_braking_kwh": None}
    print_result(result_of(day, found))
    said = " ".join("".join(capsys.readouterr()).split())
    assert "not known" in said
    assert "the train cannot brake on the descent at 900 m" in said
