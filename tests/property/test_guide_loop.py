"""The loop with a person in it: however late a driver reacts, looks and errs, the guide does not make him oscillate.

`DAS_PROPERTY_DRIVERS=200 pytest tests/property/test_guide_loop.py` draws more of them.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest

from das.advice.advice import Advice
from das.advice.regimes import Regime
from das.domain.units import KMH
from sim.drive.figures import ShownWatch
from sim.drivers.human import HumanDriver
from sim.drivers.kinds import Presentation
from sim.drivers.parameters import HumanParameters
from sim.drivers.presentations.presenter import Shown
from sim.world.in_process import InProcess
from sim.world.loop import Run, Tick, World
from sim.world.scenario import load_scenario
from sim.world.service import Service, make_day, prepare_service
from tests.support.crossing import numbered

SECTIONS = (
    ("flat-6km", "A", "B"),
    ("zurich-luzern", "Zürich HB", "Thalwil"),
    ("zurich-luzern", "Thalwil", "Zug"),
    ("zurich-luzern", "Zug", "Luzern"),
)
MORE_REVERSALS = 3
"""A section may have so many reversals between traction and brake more than its optimum (of 150 drivers, one had 3)."""
CHANGES_PER_MIN = 4.0
MEAN_CHANGES_PER_MIN = 3.0
REPLANS_PER_MIN = 2.0
"""What is shown changes no more often than this, for one driver and in the mean of all."""
SWING_MPS = 8.0 * KMH
MORE_SWINGS = 4
"""The speed may turn so many times more than the optimum's, counted where it goes back by more than this."""
LATE_S = 60.0
"""An arrival later than this is not the driver's alone: he was told to creep, or to stand."""


class Watched(InProcess):
    """A cab in this process whose references are counted."""

    def __init__(self, service: Service) -> None:
        self.replans_ns: set[int] = set()
        super().__init__(service, guide=True)

    def exchange(self, tick: Tick) -> Advice:
        advice = super().exchange(tick)
        if advice.guide is not None and advice.guide.replan.time_ns:
            self.replans_ns.add(advice.guide.replan.time_ns)
        return advice


class Found(NamedTuple):
    """What a driver on a section came to."""

    section: tuple[str, str, str]
    human: HumanParameters
    run: Run
    problems: list[str]


@cache
def service_of(section: tuple[str, str, str], buffer_ratio: float) -> Service:
    route, start, end = section
    clear = load_scenario("clear-day")
    timed = replace(clear, running_s=None, buffer_ratio=buffer_ratio)
    return prepare_service(replace(timed, route=route, from_stop=start, to_stop=end))


def swings(speeds_mps: Any) -> int:
    """How often a speed turns, where it then goes the other way by more than a swing."""
    count, low, high, rising = 0, float(speeds_mps[0]), float(speeds_mps[0]), True
    for v in map(float, speeds_mps):
        low, high = min(low, v), max(high, v)
        if rising and v < high - SWING_MPS:
            count, rising, low = count + 1, False, v
        elif not rising and v > low + SWING_MPS:
            count, rising, high = count + 1, True, v
    return count


def optimum(service: Service) -> tuple[int, int]:
    """Reversals and swings of the optimum, its forces read as modes second by second."""
    run, watch = service.planned[0].trajectory, ShownWatch()
    seconds = np.arange(1.0, run.time_s - 1.0)
    forces = np.interp(seconds, run.t_s[:-1], run.force_el_n)
    least_n = 0.03 * service.fronts[0].section.train.traction_force_n
    for second, force in zip(seconds.tolist(), forces.tolist(), strict=True):
        mode = Regime.COAST if abs(force) < least_n else Regime.FULL_TRACTION if force > 0 else Regime.FULL_BRAKE
        watch.look(second, 20.0, Shown(mode=mode))
    return watch.found.reversals, swings(run.v_mps)


def drawn(number: int) -> Found:
    """A driver with 0–8 s of delay, 0–15 s between glances and 0–20 % error of effort, who follows all advice."""
    random = np.random.default_rng([13, number])
    glance_s = float(random.uniform(0.2, 15.0))
    human = HumanParameters(
        reaction_median_s=float(random.uniform(0.2, 8.0)),
        glance_mean_s=glance_s,
        glance_least_s=min(1.0, glance_s),
        force_error_ratio=float(random.uniform(0.0, 0.2)),
        comply_traction_ratio=1.0,
        comply_hold_ratio=1.0,
        comply_coast_ratio=1.0,
        comply_brake_ratio=1.0,
    )
    section = SECTIONS[number % len(SECTIONS)]
    service = service_of(section, float(random.choice([0.05, 0.08, 0.15])))
    link = Watched(service)
    driver = HumanDriver(service.line, human, seed=number)
    run = World(make_day(service, number), driver, Presentation.GUIDE, link).run()
    return Found(section, human, run, problems(run, len(link.replans_ns), service))


def problems(run: Run, replans: int, service: Service) -> list[str]:
    """What is restless about a run."""
    calm, minutes = run.stability, run.stability.shown_s / 60.0
    reversals, turns = optimum(service)
    bounds = {
        "reversals": (calm.reversals, reversals + MORE_REVERSALS),
        "changes per minute": (calm.changes_per_min, CHANGES_PER_MIN),
        "replans per minute": (replans / minutes, REPLANS_PER_MIN),
        "swings": (swings([state.speed_mps for state in run.states]), turns + MORE_SWINGS),
        "late": (run.calls[-1].late_s, LATE_S),
    }
    return [f"{name}: {value:.2f} > {most:.2f}" for name, (value, most) in bounds.items() if not value <= most]


@pytest.mark.slow
@pytest.mark.parametrize("numbers", numbered("DAS_PROPERTY_DRIVERS", 9))
def test_no_driver_is_made_to_oscillate(numbers: range) -> None:
    """Reversals, changes, replans and swings of the speed of every driver, and changes in the mean."""
    found = [drawn(number) for number in numbers]
    drivers = zip(numbers, found, strict=True)
    restless = {(number, *one.section, one.human): one.problems for number, one in drivers if one.problems}
    assert not restless, "\n".join(f"{who}: {what}" for who, what in restless.items())
    assert np.mean([one.run.stability.changes_per_min for one in found]) <= MEAN_CHANGES_PER_MIN


def test_swings_are_counted_where_a_speed_turns() -> None:
    """By hand: up, down by 10 km/h, up by 5 (no turn), down, up by 20: two turns."""
    speeds = np.array([0, 50, 100, 90, 95, 80, 100]) * KMH
    assert swings(speeds) == 2
    assert swings(np.array([0, 50, 100, 95, 100, 94]) * KMH) == 0
