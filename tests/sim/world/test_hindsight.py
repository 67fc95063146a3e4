"""The optimum that a run is compared with is that of the train that drove, whatever the plan believes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from das.domain.losses import Level
from sim.drivers.cab import Presentation
from sim.drivers.registry import DriverKind
from sim.world.day import make_day
from sim.world.in_process import InProcess
from sim.world.loop import World
from sim.world.outcome import DayOutcome, outcome, true_fronts
from sim.world.scenario import read_scenario
from sim.world.service import Service, prepare_service


def service_at(path: Path, level: Level | None = None) -> Service:
    return prepare_service(read_scenario(path), level=level)


def driven(service: Service, seed: int = 1) -> DayOutcome:
    day = make_day(service, seed)
    run = World(day, day.driver(DriverKind.PERFECT), Presentation.VECTOR, InProcess(service)).run()
    return outcome(day, run)


def test_a_plan_with_other_losses_is_compared_with_the_optimum_of_the_true_ones(flat: Callable[[str], Path]) -> None:
    """Planned with constant efficiency, driven with a loss map: the optimum is that of the map."""
    path = flat('[truth]\nlevel = "l3"')
    plain = driven(service_at(path, Level.L1))
    true = driven(service_at(path))
    assert (plain.level, true.level) == ("l1", "l3")
    of_map = service_at(path).fronts[0].trajectory(plain.running_time_s)
    assert plain.energies.hindsight_j == pytest.approx(of_map.ledger.input, rel=1e-12)
    gaps = [found.energies.above.ratio for found in (plain, true)]
    assert all(gap is not None and 0.0 < gap < 0.05 for gap in gaps)
    # The plan of the wrong level cannot be better for the train than the plan of its own.
    assert gaps[0] >= gaps[1] - 1e-3


def test_a_heavier_train_has_a_higher_optimum(flat: Callable[[str], Path]) -> None:
    heavy = service_at(flat("[truth]\nmass_ratio = 1.2"))
    found = driven(heavy)
    of_plan = heavy.fronts[0].trajectory(found.running_time_s)
    assert found.energies.hindsight_j > 1.05 * of_plan.ledger.input
    day = make_day(heavy, 1)
    assert true_fronts(day)[0] is true_fronts(day)[0], "solved once"
    assert true_fronts(day)[0].section.train.inertial_mass_kg == pytest.approx(day.plant.vehicle.inertial_mass_kg)


def test_where_the_plan_is_true_its_own_optimum_is_taken(flat: Callable[[str], Path]) -> None:
    service = service_at(flat(""))
    assert true_fronts(make_day(service, 1)) is service.fronts


def test_another_scenario_of_the_same_service_has_its_own_truth(flat: Callable[[str], Path]) -> None:
    service = service_at(flat("[truth]\nmass_ratio = 1.2"))
    heavy = true_fronts(make_day(service, 1))
    other = service.on(read_scenario(flat('[truth]\nmass_ratio = 1.2\nlevel = "l2"')))
    assert other.true_fronts == {}
    assert true_fronts(make_day(other, 1))[0].section.level is Level.L2
    assert heavy[0].section.level is Level.L3
