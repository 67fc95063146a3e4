"""A simple run in one process: a driver on a simulated train between two points, with or without an advisor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from das.domain.errors import DasError
from das.domain.units import NS
from das.estimate.estimate import LEAST_SD_M, LEAST_SD_MPS, PositionFix
from sim.drivers.cab import AT_STOP_M, AdviceView, CabView, Driver
from sim.drivers.kinds import Presentation
from sim.drivers.knowledge import LineKnowledge
from sim.drivers.presentations.presenter import present, presenter_of
from sim.plant.kernels import PlantState
from sim.plant.plant import Plant
from sim.world.simpler import SimplerDisplay
from tests.support.one_section import OneSection

LOOK_S = 0.2
"""Interval (s) at which a driver looks and acts."""
ADVICE_EVERY_S = 1.0
LONGEST_RATIO, LONGEST_S = 5.0, 1800.0
"""Longest run as a multiple of its timetable, plus an additional time (s)."""

Advise = Callable[[PlantState], AdviceView | None]
"""Callback that returns the display's content in a state of the train; called once a second."""


def shown(presentation: Presentation, mode: int, time_s: float = 0.0, **fields: Any) -> AdviceView:
    """Advice on a display at a time, valid for 3 s."""
    return AdviceView(time_s=time_s, valid_until_s=time_s + 3.0, presentation=presentation, mode=mode, **fields)


@dataclass(frozen=True, kw_only=True)
class Leg:
    """A distance (m) with its timetable (s on the run's clock)."""

    start_m: float
    stop_m: float
    departure_s: float
    arrival_s: float


@dataclass(frozen=True, kw_only=True)
class Ride:
    """The states of a run, one a second. In the last one the train stands at the stop, or beyond it."""

    states: tuple[PlantState, ...]

    @property
    def arrival_s(self) -> float:
        return self.states[-1].time_s


def ride(plant: Plant, driver: Driver, line: LineKnowledge, leg: Leg, advise: Advise | None = None) -> Ride:
    """Drive from standstill to standstill at the stop; raises DasError if the train does not arrive."""
    latest_s = leg.departure_s + LONGEST_S + LONGEST_RATIO * (leg.arrival_s - leg.departure_s)
    looks = round(ADVICE_EVERY_S / LOOK_S)
    state = plant.at(leg.start_m)
    states = [state]
    while not _arrived(state, leg):
        view = advise(state) if advise is not None else None
        for _ in range(looks):
            cab = CabView(
                time_s=state.time_s,
                s_m=state.s_m,
                speed_mps=state.speed_mps,
                limit_mps=float(line.limits_mps.at(state.s_m)),
                stop_m=leg.stop_m,
                departure_s=leg.departure_s,
                arrival_s=leg.arrival_s,
                advice=view,
            )
            state = plant.advance(state, driver.command(cab), LOOK_S)
            if _arrived(state, leg):
                break
        states.append(state)
        if state.time_s > latest_s:
            raise DasError(f"the simulated train did not arrive within {latest_s:.0f} s (it is at {state.s_m:.0f} m)")
    return Ride(states=tuple(states))


def advised_by(advisor: OneSection, presentation: Presentation, line: LineKnowledge) -> Advise:
    """The display's content with an advisor that has the train's true position and timetable."""

    simpler = SimplerDisplay(advisor.leg.section) if presenter_of(presentation).is_simpler else None

    def advise(state: PlantState) -> AdviceView | None:
        now_ns = round(state.time_s / NS)
        fix = PositionFix(
            time_ns=now_ns,
            s_m=state.s_m,
            speed_mps=state.speed_mps,
            uncertainty_m=LEAST_SD_M,
            speed_uncertainty_mps=LEAST_SD_MPS,
        )
        advisor.set_position(fix)
        advice, goal = advisor.update(now_ns), advisor.leg.goal
        shown = advice if simpler is None else simpler.look(advice, goal.departure_ns, goal.arrival_ns)
        return present(shown, presentation)

    return advise


def _arrived(state: PlantState, leg: Leg) -> bool:
    return state.speed_mps <= 0 and leg.stop_m - state.s_m <= AT_STOP_M
