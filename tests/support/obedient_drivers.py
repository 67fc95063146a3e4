"""Drivers of the assessment: obedient ones, who follow only the advice, and a careless one."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from das.advice.advice import Advice, Instruction
from das.advice.regimes import Regime
from sim.drivers.cab import Asked, CabView, asked
from sim.drivers.drivers import TimetableDriver
from sim.drivers.human import HumanDriver
from sim.drivers.kinds import FrictionPolicy, Presentation
from sim.drivers.knowledge import LineKnowledge
from sim.drivers.parameters import HumanParameters
from sim.drivers.presentations.presenter import SimplerLook, present
from sim.plant.kernels import Command, PlantState
from sim.plant.plant import COAST, force, speed
from tests.support.drawn_day import Style
from tests.support.raw_witness import RawLine

TRACTION = (Regime.FULL_TRACTION, Regime.REDUCED_TRACTION)
BRAKES = (Regime.REDUCED_BRAKE, Regime.FULL_BRAKE, Regime.FRICTION_BRAKE)
SIMPLER = (Presentation.TOP_SPEED, Presentation.FOUR_MODE)
REACHED_MPS = 0.1
"""Difference (m/s) within which a speed counts as reached."""
TOO_FAST_MPS = 0.3
"""Excess (m/s) over the advised speed above which a driver who holds it brakes fully."""
GAIN_PER_S = 0.5
"""Share of the deviation that a driver who holds a speed corrects in a second."""
CREEP_SHARE, CREEPS_MPS = 0.4, 1.0
"""Share of the traction, and speed (m/s) up to which it is used, when a driver departs on clearance."""
STOPS_MPS2, AT_STOP_M = 0.5, 3.0
"""Deceleration (m/s²) for a stop, and distance (m) at which it is reached, with only a top speed on the display."""
WEAKER = 0.8
"""Share of the intended force with which a careless driver brakes."""
CARELESS = HumanParameters(
    notches=5,
    glance_least_s=10.0,
    glance_mean_s=15.0,
    reaction_median_s=3.0,
    reaction_log_sd=0.0,
    comply_traction_ratio=0.67,
    comply_hold_ratio=0.67,
    comply_coast_ratio=0.67,
    comply_brake_ratio=0.67,
)


class Scene(NamedTuple):
    """A driver's information at a look: the train's state, departure (s), next stop (m), own view, and advice."""

    state: PlantState
    departure_s: float
    stop_m: float
    own_eyes: Callable[[], CabView]
    """Function that returns the driver's view out of the window."""
    advice: Advice
    """The newest advice message, not yet delayed by the driver's reaction."""
    look: SimplerLook | None = None
    """The content of a display of one top speed or of four modes."""


class AssessedDriver(Protocol):
    """A driver in a run of the assessment."""

    def command(self, scene: Scene) -> Command:
        """The driver's command until the next look."""

    def obeys(self, advice: Advice, look: SimplerLook | None = None) -> bool:
        """Whether the driver follows an advice message without looking out of the window."""


class CarelessDriver:
    """A driver who looks every 10 to 20 s, acts 3 s late, ignores a third of the advice, and brakes a fifth too weakly,
    but observes limits and stops.
    """

    def __init__(self, line: LineKnowledge, presentation: Presentation, zero_ns: int, seed: int) -> None:
        self._driver = HumanDriver(line, CARELESS, friction=FrictionPolicy.ELECTRIC_FIRST, seed=seed)
        self._train, self._presentation, self._zero_ns = line.train, presentation, zero_ns

    def command(self, scene: Scene) -> Command:
        view = present(scene.look or scene.advice, self._presentation, clock_zero_ns=self._zero_ns)
        command = self._driver.command(scene.own_eyes()._replace(advice=view))
        return command._replace(value=WEAKER * command.value) if command.value < 0 else command

    def obeys(self, advice: Advice, look: SimplerLook | None = None) -> bool:
        return False


class ObedientDriver:
    """A driver who follows the advice after a short delay, and without advice the timetable and own observation."""

    def __init__(
        self, line: LineKnowledge, raw: RawLine, presentation: Presentation, style: Style, delay_s: float
    ) -> None:
        self._raw, self._presentation, self._style, self._delay_s = raw, presentation, style, delay_s
        self._own = TimetableDriver(line)
        self._coming: deque[tuple[float, Advice, SimplerLook | None]] = deque()
        self._seen: tuple[float, Advice, SimplerLook | None] | None = None
        self._due: Instruction | None = None
        self._reached = False

    def obeys(self, advice: Advice, look: SimplerLook | None = None) -> bool:
        """Whether an advice message shows anything on the driver's display."""
        if advice.mode is Regime.NONE:
            return False
        if self._presentation in SIMPLER:
            return look is not None and not (
                self._presentation is Presentation.TOP_SPEED and math.isnan(look.top_speed_mps)
            )
        is_guided = advice.guide is not None and advice.guide.now.mode is not Regime.NONE
        return is_guided or self._presentation is not Presentation.GUIDE

    def command(self, scene: Scene) -> Command:
        """The driver's command from the advice shown one reaction time ago."""
        state, now_s = scene.state, scene.state.time_s
        if not self._coming or self._coming[-1][1] is not scene.advice:
            self._coming.append((now_s, scene.advice, scene.look))
        while self._coming and now_s - self._coming[0][0] >= self._delay_s - 1e-6:
            self._seen = self._coming[0]
            if len(self._coming) == 1 or now_s - self._coming[1][0] < self._delay_s - 1e-6:
                break
            self._coming.popleft()
        if self._seen is None or not self.obeys(*self._seen[1:]):
            self._due = None
            return self._own.command(scene.own_eyes())
        shown_s, advice, look = self._seen
        if look is not None and self._presentation is Presentation.TOP_SPEED:
            return self._under_top(scene, look)
        if state.speed_mps <= 0 and now_s < scene.departure_s:
            return COAST
        if advice.mode is Regime.DEPART and state.speed_mps < CREEPS_MPS:
            return force(CREEP_SHARE * self._raw.train.pulling_n(0.0))
        if advice.mode in (Regime.STOP, Regime.DEPART):
            return self._brake(state)
        if look is not None and self._presentation is Presentation.FOUR_MODE:
            return self._one_of_four(state, look)
        return self._obeyed(scene, advice, now_s - shown_s)

    def _under_top(self, scene: Scene, look: SimplerLook) -> Command:
        """Hold the top speed shown; with such a display the driver decides on departures and on braking for stops."""
        state, way_m = scene.state, scene.stop_m - scene.state.s_m
        if state.speed_mps <= 0 and (scene.state.time_s < scene.departure_s or way_m <= AT_STOP_M):
            return COAST
        if state.speed_mps**2 >= 2.0 * STOPS_MPS2 * max(way_m - state.speed_mps, 0.1):
            return self._stop_by_eye(state, way_m)
        return self._hold(state, look.top_speed_mps)

    def _one_of_four(self, state: PlantState, look: SimplerLook) -> Command:
        """Do what the display of four modes shows."""
        mode = Regime(look.four_mode)
        if mode is Regime.CRUISE:
            return self._hold(state, look.display_speed_mps)
        if mode in BRAKES:
            return self._brake(state)
        return force(self._raw.train.pulling_n(state.speed_mps)) if mode in TRACTION else COAST

    def _stop_by_eye(self, state: PlantState, way_m: float) -> Command:
        """Brake to a stop at the place that the driver sees, `way_m` ahead."""
        needed_mps2 = state.speed_mps**2 / (2.0 * max(way_m, 0.5))
        return force(self._raw.held_n(state.s_m, state.speed_mps) - self._raw.train.inertial_kg * needed_mps2)

    def _obeyed(self, scene: Scene, advice: Advice, since_s: float) -> Command:
        """Do what the display shows."""
        if self._presentation is Presentation.GUIDE:
            return self._guided(scene, advice, since_s)
        state = scene.state
        if self._style is Style.FORCE:
            return force(advice.advised_force_n)
        if self._style is Style.SPEED:
            return self._vector_speed(state, advice, since_s)
        mode = advice.mode
        if mode is Regime.CRUISE:
            return self._hold(state, advice.display_speed_mps)
        if mode in BRAKES and advice.advised_force_ratio <= -0.999:
            return self._brake(state)
        return force(advice.advised_force_n)

    def _vector_speed(self, state: PlantState, advice: Advice, since_s: float) -> Command:
        """Hold the speed of the advice and its horizon; brake fully if the train would be faster."""
        speeds = (advice.advised_speed_mps, *advice.horizon_speed_mps)
        now, soon, later = (float(np.interp(since_s + x, range(len(speeds)), speeds)) for x in (0.0, 1.0, 2.0))
        if state.speed_mps > min(now, soon, later) + TOO_FAST_MPS:
            return self._brake(state)
        return speed(soon, rate_mps2=later - soon)

    def _guided(self, scene: Scene, advice: Advice, since_s: float) -> Command:
        """Do what the guide shows; for a brake without an effort before the stop, brake by eye."""
        state, guide = scene.state, advice.guide
        assert guide is not None
        if self._style is Style.FORCE:
            return force(guide.reference_force_n)
        now = guide.now
        if self._due is None or now.in_s - since_s <= 0:
            before, self._due = self._due, now
            same = before is not None and (before.mode, before.speed_mps) == (now.mode, now.speed_mps)
            self._reached = self._reached and same
        if self._style is Style.SPEED:
            return COAST if self._due.mode is Regime.COAST else self._hold(state, self._due.speed_mps)
        return self._card(state, self._due, scene.stop_m - state.s_m)

    def _card(self, state: PlantState, card: Instruction, way_m: float) -> Command:
        """Follow an instruction; the stop is `way_m` ahead."""
        v, train = state.speed_mps, self._raw.train
        gains = card.mode in TRACTION
        away_mps = card.speed_mps - v if gains else v - card.speed_mps
        self._reached = self._reached or away_mps <= REACHED_MPS
        told = asked(card.mode, card.speed_mps, card.effort_ratio, v, reached=self._reached)
        if told is Asked.ACCELERATE:
            return force(card.effort_ratio * train.pulling_n(v))
        if told is Asked.BRAKE:
            return force(card.effort_ratio * train.electric_n(v))
        if told is Asked.COAST:
            return COAST
        if told is Asked.BRAKE_BY_EYE:
            return self._stop_by_eye(state, way_m)
        held = self._hold(state, card.speed_mps)
        return held._replace(high_n=0.0) if told is Asked.KEEP_BELOW else held

    def _hold(self, state: PlantState, speed_mps: float) -> Command:
        """Hold a speed with up to full traction and brakes; for a speed of 0, brake fully."""
        v, raw = state.speed_mps, self._raw
        if speed_mps <= REACHED_MPS:
            return self._brake(state)
        return speed(
            speed_mps,
            force_n=raw.held_n(state.s_m, v),
            gain_per_s=GAIN_PER_S,
            low_n=-self._brakes_n(v),
            high_n=raw.train.pulling_n(v),
        )

    def _brake(self, state: PlantState) -> Command:
        return force(-self._brakes_n(state.speed_mps))

    def _brakes_n(self, speed_mps: float) -> float:
        """The driver's largest braking force: all brakes when following speeds, the plan's when following efforts."""
        train = self._raw.train
        if self._style is Style.SPEED:
            return train.electric_n(speed_mps) + train.service_friction_n
        return train.brakes_n(speed_mps)
