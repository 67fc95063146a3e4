"""What a run says of signals passed at danger and speeds above what is allowed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from das.domain.restriction import Restriction
from das.domain.route import Stop
from das.domain.units import KMH
from sim.drive.limits import Violations
from sim.plant.kernels import PlantState
from sim.world.surroundings import Calls, Watch
from tests.support.flat_days import flat_day, run_of, signal_at
from tests.support.making import das_sim

LATE_TOLD = "[[disturbances]]\nkind = 'restriction'\nfrom_km = 2\nto_km = 3\nspeed_kmh = 40\nannounced_m = 50\n"


def at(s_m: float, v_mps: float) -> PlantState:
    names = PlantState._fields
    return PlantState(**(dict.fromkeys(names, 0.0) | {"s_m": s_m, "speed_mps": v_mps}))


def test_a_signal_passed_is_counted_once_and_measured() -> None:
    watch = Watch(200.0)
    said = [
        watch.take(at(s, 10.0), 0.2, signal_m=1000.0, limit_mps=50.0, temporary=()) for s in (990, 1000.4, 1002, 1040)
    ]
    assert said == [[], [], ["signal at km 1.0 passed at danger"], []]
    assert watch.found == Violations(signals_passed=1, beyond_signal_m=40.0)


def test_a_stop_is_missed_far_behind_it_or_at_the_stop_after_it() -> None:
    day = flat_day()
    for stops_m, missed_m in (
        ((0.0, 6000.0), 8000.0),
        ((0.0, 2000.0, 3200.0), 3190.0),
        ((0.0, 2000.0, 6000.0), 4000.0),
    ):
        stops = tuple(Stop(name=f"{at_m:.0f}", position_m=at_m) for at_m in stops_m)
        service = replace(day.service, stops=stops)
        assert Calls(replace(day, service=service)).missed_m == missed_m


def test_the_lowest_limit_over_the_whole_train_counts() -> None:
    watch, slow = Watch(200.0), (Restriction(500.0, 600.0, 10.0),)
    spans = {490.0: 12.0, 510.0: 12.0, 799.0: 10.2, 799.9: 11.0, 801.0: 12.0}
    said = [watch.take(at(s, v), 0.2, signal_m=1e9, limit_mps=20.0, temporary=slow) for s, v in spans.items()]
    assert said == [[], ["43 km/h where 36 are allowed"], [], ["40 km/h where 36 are allowed"], []]
    assert watch.found.over_limit_s == pytest.approx(0.4)
    assert watch.found.over_limit_mps == pytest.approx(2.0)


def test_a_day_on_which_it_could_not_be_helped(flat: Callable[[str], Path], tmp_path: Path) -> None:
    """Signal seen and restriction told too late to brake: the command says it."""
    path = flat(LATE_TOLD + signal_at(4500, 50))
    run = run_of(path, "fast", "none")
    assert run.violations.signals_passed == 1
    assert run.violations.beyond_signal_m > 100
    assert run.violations.over_limit_mps > 50 * KMH
    done = das_sim("run", str(path), "--driver", "fast", "--advice", "none", "--in-process", cwd=tmp_path)
    assert "signals passed at danger: 1, by up to" in done.stdout
    assert "above limits, by up to" in done.stdout


def test_a_follower_on_an_ordinary_day_does_nothing_of_the_kind(flat: Callable[[str], Path]) -> None:
    assert run_of(flat(signal_at(3000, 1500)), "perfect").violations == Violations()
