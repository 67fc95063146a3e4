"""Days on a flat line: who arrives, who never does, and what nearly went unnoticed."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from das.cab.heard import DelayHeard
from das.domain.errors import DasError
from sim.drivers.cab import AT_STOP_M, CabView
from sim.drivers.kinds import DriverKind, Presentation
from sim.plant.kernels import Command
from sim.plant.plant import lever
from sim.world import loop
from sim.world.in_process import InProcess
from sim.world.loop import Tick, World
from sim.world.service import make_day
from tests.support.crossing import few
from tests.support.flat_days import FLAT, Alone, run_of, service_of, signal_at, standing_m, states_of


@pytest.mark.parametrize("advice", few(Presentation, (Presentation.GUIDE,)))
def test_the_same_seed_drives_the_same_and_another_differently(flat: Callable[[str], Path], advice: str) -> None:
    """Every state of the day is the same for one seed, whatever advice is shown; another seed differs."""
    path = flat()
    first = states_of(path, "human", advice, 5)
    assert first == states_of(path, "human", advice, 5)
    assert first != states_of(path, "human", advice, 6)


@pytest.mark.parametrize("driver", list(DriverKind))
def test_every_driver_arrives_on_a_flat_line(flat: Callable[[str], Path], driver: str) -> None:
    """Each kind of driver stands within 10 m of the stop at the end."""
    states = states_of(flat(), driver, "speed-and-effort", 2)
    assert abs(states[-1].s_m - 6000) < 10
    assert states[-1].speed_mps == 0


@pytest.mark.slow
def test_a_driver_who_never_gets_there_ends_the_run(
    flat: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A signal that never clears; the train is waited for by a minute instead of half an hour."""
    monkeypatch.setattr(loop, "LONGEST_S", 60.0)
    monkeypatch.setattr(loop, "LONGEST_RATIO", 1.0)
    path = flat("[[disturbances]]\nkind = 'signal-stop'\nat_km = 3\nseen_m = 1500\nclears_after_s = 86400")
    with pytest.raises(DasError, match=r"did not arrive within \d+ s \(it is at 30\d\d m|at 299\d m"):
        states_of(path, "perfect", "speed-and-effort", 1)


class Asleep:
    """A driver who leaves the lever at full power, as somebody may who walks away from a desk."""

    def command(self, _cab: CabView) -> Command:
        """Full power."""
        return lever(1.0)


def test_a_train_that_does_not_stop_ends_the_run_2_km_behind_its_stop(flat: Callable[[str], Path]) -> None:
    day = make_day(service_of(flat("")), 1)
    with pytest.raises(DasError, match=r"drove past its stop \(it is at 80\d\d m, the next stop at 6000 m"):
        World(day, Asleep(), Presentation.NONE, Alone()).run()


def test_the_follower_drives_on_after_a_signal_short_of_the_stop(flat: Callable[[str], Path]) -> None:
    """The advice takes a train 15 m before its stop for one that brakes there."""
    first, last = standing_m(run_of(flat(signal_at(5985, 1500)), "perfect"))
    assert first == pytest.approx(5985, abs=0.5)
    assert last == pytest.approx(6000, abs=0.5)


def test_a_signal_seen_too_late_stops_the_train_beyond_it(flat: Callable[[str], Path]) -> None:
    """In sight for less than a second: it is not passed unnoticed."""
    first, _ = standing_m(run_of(flat(signal_at(3000, 10)), "perfect"))
    assert 3000 < first < 4000


def test_a_human_stands_before_a_signal_not_beyond(flat: Callable[[str], Path]) -> None:
    """Two days with two signals: the driver stands at most 15 m before each and never more than half a metre beyond."""
    service = service_of(flat(signal_at(2000, 1500) + signal_at(4500, 1500)))
    for seed in range(2):
        driver = make_day(service, seed).driver(DriverKind.HUMAN)
        run = World(make_day(service, seed), driver, Presentation.SPEED_AND_EFFORT, InProcess(service)).run()
        first_m, second_m, _ = standing_m(run)
        assert 1985 < first_m < 2000.5
        assert 4485 < second_m < 4500.5


def test_who_misses_his_marks_by_far_still_keeps_his_stops(flat: Callable[[str], Path]) -> None:
    """At the greatest error he may have, every other mark would be more than 5 m off: he takes none to be further."""
    service = service_of(flat("[human]\nstop_error_m = 8\n"))
    missed = []
    for seed in (10, 19):
        day = make_day(service, seed)
        run = World(day, day.driver(DriverKind.HUMAN), Presentation.NONE, Alone()).run()
        missed.append(run.calls[-1].stopping_error_m)
    assert max(map(abs, missed)) < AT_STOP_M
    assert np.min(missed) < -4.5


@pytest.mark.slow
def test_a_human_does_not_brake_every_few_seconds_downhill(flat: Callable[..., Path]) -> None:
    """On 12 permille down to Zug (3.5 min) he brakes as often as the speed has risen again, not 30 to 50 times."""
    down = 'route = "zurich-luzern"\nfrom = "Thalwil"\nto = "Zug"'
    service = service_of(flat(base=FLAT.replace('route = "flat-6km"', down)))
    for shown in (Presentation.NONE, Presentation.TOP_SPEED):
        day = make_day(service, 0)
        states = World(day, day.driver(DriverKind.HUMAN), shown, InProcess(service)).run().states
        brakes = [x.force_el_n + x.force_friction_n < -20e3 for x in states if 20_000 < x.s_m < 27_000]
        assert 1 <= sum(after and not before for before, after in pairwise(brakes)) <= 14


class Hears(Alone):
    """A link that keeps the delays the node is told."""

    def __init__(self) -> None:
        self.delays_s: list[float] = []

    def exchange(self, tick: Tick) -> None:
        self.delays_s += [one.delay_s for one in tick.told if isinstance(one, DelayHeard)]


def test_who_has_arrived_is_not_late_any_more_than_that(flat: Callable[[str], Path]) -> None:
    """The last delay that the node is told is the delay of the arrival."""
    service = service_of(flat("[[disturbances]]\nkind = 'departure-delay'\nstop = 'A'\ndelay_s = 60"))
    day, link = make_day(service, 0), Hears()
    run = World(day, day.driver(DriverKind.HUMAN), Presentation.NONE, link).run()
    assert link.delays_s[-1] == pytest.approx(run.calls[-1].late_s, abs=1e-6)


def test_a_stop_overrun_is_a_stop_and_said(flat: Callable[[str], Path]) -> None:
    """On a slippery rail the train slides past its stop; the run ends there and says by how much."""
    slippery = "[[disturbances]]\nkind = 'slippery-rail'\nfrom_km = 4\nto_km = 6.5\nadhesion_ratio = 0.1\n"
    run = run_of(flat(f"[truth]\nadhesive_mass_t = 84\n{slippery}"), "perfect")
    assert run.calls[-1].stopping_error_m > 100


def test_a_train_that_resists_far_more_than_known_comes_to_a_stand(flat: Callable[[str], Path]) -> None:
    """With ten times the resistance a train driven as fast as possible still stops at its stop."""
    assert abs(run_of(flat("[truth]\nresistance_ratio = 10\n"), "fast", "none").calls[-1].stopping_error_m) < 1
