"""A random run of the assessment, simulated in closed loop, with faults of operators, sensors and clocks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from das.advice.advice import Advice
from das.advice.regimes import Regime
from das.cab.cab import Cab, CabSettings
from das.cab.heard import (
    UNSTAMPED,
    EffortHeard,
    Heard,
    JourneyHeard,
    Kind,
    PositionHeard,
    PublisherSeen,
    RestrictionsHeard,
    ToldRestriction,
)
from das.cab.orders import Post, Trains
from das.cab.outputs import Estimated, Event
from das.cab.preparation import Fronts
from das.cab.situation import Situation
from das.domain.files.load import load_route, load_vehicle
from das.domain.journey import OrderedStop
from das.domain.restriction import Restriction
from das.estimate.estimate import Effort, PositionFix
from sim.drivers.cab import CabView
from sim.drivers.kinds import Presentation
from sim.drivers.knowledge import LineKnowledge
from sim.drivers.presentations.presenter import SimplerLook
from sim.plant.kernels import PlantState
from sim.plant.plant import Plant
from sim.world.simpler import SimplerDisplay
from tests.support.drawn_day import Change, Drawn, Operators, Style, Upset
from tests.support.obedient_drivers import SIMPLER, AssessedDriver, CarelessDriver, ObedientDriver, Scene
from tests.support.raw_witness import Place, RawLine

S = 10**9
START_NS = 1_800_000_000 * S
BEGINS_S = -10
LOOK_S = 0.2
SPEED_SD_MPS = 0.05
"""The standard deviation of the measured speed."""
POSITION_SD_M = 3.0
DWELL_S = 15.0
LONGEST_S = 2000.0
AT_STOP_M = 50.0
"""Distance (m) from a stop within which the cab counts a standing train as arrived."""
CLEAR_M = 300.0
"""Least distance (m) of an added stop from other stops."""


@dataclass(frozen=True, kw_only=True)
class DayStop:
    """A stop of the journey as currently ordered; times in s, NaN if there is none."""

    name: str
    s_m: float
    arrival_s: float
    departure_s: float


@dataclass(kw_only=True)
class Seen:
    """One second for the judge: the true state of the train, the true restrictions, and the advice."""

    second: float
    state: PlantState
    places: tuple[Place, ...]
    stop_m: float
    """The position of the next stop (m)."""
    advice: Advice
    obeyed: bool
    """Whether the driver obeys the advice."""
    look: SimplerLook | None = None
    """The content of a display of one top speed or of four modes."""


@dataclass(frozen=True, kw_only=True)
class Stood:
    """The stopping position at the end of a leg and the required one (m)."""

    second: float
    s_m: float
    stop_m: float


@dataclass(kw_only=True)
class Said:
    """The messages of the cab in the run other than advice, and the stopping positions."""

    estimates: list[Estimated] = field(default_factory=list)
    events: list[tuple[float, str]] = field(default_factory=list)
    stood: list[Stood] = field(default_factory=list)


class NeverArrivedError(Exception):
    """The train did not reach its last stop within the longest time."""


class AssessedDay:
    """The simulation of one run: iterate over `seconds`, then read `said`."""

    def __init__(self, drawn: Drawn, route: Path, vehicle: Path, raw: RawLine, fronts: Fronts) -> None:
        self.drawn, self.said = drawn, Said()
        self.route, self.vehicle = load_route(str(route)), load_vehicle(str(vehicle))
        self._fronts = fronts
        self._plant = Plant(self.route, self.vehicle)
        self._line = LineKnowledge(route=self.route, vehicle=self.vehicle)
        self._driver = self._new_driver(raw)
        self._stops = self._timetable()
        self._operators = _Operators(drawn)
        self._sensors = _Measuring(drawn)
        self._cab = self._new_cab()
        self._simpler: SimplerDisplay | None = None

    def seconds(self) -> Iterator[Seen]:
        """Simulate second by second to the last stop; raises NeverArrivedError."""
        state, next_stop = self._plant.at(self._stops[0].s_m, time_s=BEGINS_S), 1
        changes_at = round(self.drawn.changes_s)
        while state.time_s < LONGEST_S:
            second = round(state.time_s)
            heard = list(self._operators.says(second, state.s_m))
            if self.drawn.change is not Change.NONE and second == changes_at:
                self._stops = changed(self._stops, next_stop, state, self.drawn)
            if self._operators.restarts(second):
                self._cab.close()
                self._cab = self._new_cab()
            # An unchanged journey is sent once more.
            told_journey = second in (BEGINS_S, changes_at) or self._operators.restarts(second)
            if told_journey:
                heard.insert(0, self._journey(second))
            for one in (*heard, *self._sensors.measured(state, second)):
                self._cab.hear(replace(one, heard_ns=self._clock_ns(second - 1) if second > BEGINS_S else 0))
            *others, advice = self._cab.tick(self._clock_ns(second))
            assert isinstance(advice, Advice)
            self.said.events += [(second, one.text) for one in others if isinstance(one, Event)]
            self.said.estimates += [one for one in others if isinstance(one, Estimated)]
            stop, look = self._stops[next_stop], self._look(advice)
            yield Seen(
                second=second,
                state=state,
                places=self._operators.in_force,
                stop_m=stop.s_m,
                advice=advice,
                obeyed=self._driver.obeys(advice, look),
                look=look,
            )
            state = self._driven(state, advice, look, next_stop, second)
            if self._has_arrived(state, advice, stop.s_m):
                state = state._replace(speed_mps=0.0)
                self.said.stood.append(Stood(second=second, s_m=state.s_m, stop_m=stop.s_m))
                next_stop += 1
                if next_stop == len(self._stops):
                    return
        raise NeverArrivedError(f"the train did not arrive, it is at {state.s_m:.0f} m")

    def _look(self, advice: Advice) -> SimplerLook | None:
        """The content of a display of one top speed or of four modes for an advice message; None for other displays."""
        leg = self._cab.legs.current
        if self.drawn.presentation not in SIMPLER or leg is None or advice.mode is Regime.NONE:
            return None
        if self._simpler is None or self._simpler.section is not leg.section:
            self._simpler = SimplerDisplay(leg.section)
        return self._simpler.look(advice, leg.goal.departure_ns, leg.goal.arrival_ns)

    def _driven(
        self, state: PlantState, advice: Advice, look: SimplerLook | None, next_stop: int, second: int
    ) -> PlantState:
        """The state of the train one second later."""
        for _ in range(round(1.0 / LOOK_S)):
            at = partial(self._view, state, next_stop)
            scene = Scene(state, self._stops[next_stop - 1].departure_s, self._stops[next_stop].s_m, at, advice, look)
            state = self._plant.advance(state, self._driver.command(scene), LOOK_S)
        return state._replace(time_s=float(second + 1))

    def _has_arrived(self, state: PlantState, advice: Advice, stop_m: float) -> bool:
        """Whether the train stands at its stop; with noise, the cab may report this at a small speed."""
        near_m, slow_mps = (AT_STOP_M, 0.1 + SPEED_SD_MPS) if advice.mode is Regime.STOP else (10.0, 0.0)
        return state.speed_mps <= slow_mps and stop_m - state.s_m <= near_m

    def _view(self, state: PlantState, next_stop: int) -> CabView:
        departure_s, stop = self._stops[next_stop - 1].departure_s, self._stops[next_stop]
        return CabView(
            state.time_s, state.s_m, state.speed_mps, float(self._line.limits_mps.at(state.s_m)), stop.s_m,
            departure_s, stop.arrival_s, state.time_s >= departure_s,
            restrictions=tuple(Restriction(*one) for one in self._operators.in_force),
        )  # fmt: skip

    def _timetable(self) -> list[DayStop]:
        """The stops of the run with their times."""
        first, last = self.drawn.stops
        stops = self.route.stops[first : last + 1]
        found, at_s = [DayStop(name=stops[0].name, s_m=stops[0].position_m, arrival_s=np.nan, departure_s=0.0)], 0.0
        for start, end in pairwise(stops):
            section = Situation(route=self.route, vehicle=self.vehicle).section(start.position_m, end.position_m)
            took_s = float(section.fastest_run.time_to_go_s[0]) * (1.0 + self.drawn.buffer_ratio)
            arrival_s = round(at_s + took_s + 5.0)
            at_s = arrival_s + DWELL_S
            found.append(DayStop(name=end.name, s_m=end.position_m, arrival_s=arrival_s, departure_s=at_s))
        return found

    def _new_driver(self, raw: RawLine) -> AssessedDriver:
        drawn = self.drawn
        if drawn.style is Style.CARELESS:
            return CarelessDriver(self._line, drawn.presentation, START_NS, drawn.seed)
        return ObedientDriver(self._line, raw, drawn.presentation, drawn.style, drawn.delay_s)

    def _new_cab(self) -> Cab:
        post = Post(train="T", route=self.route, trains=Trains(self.vehicle, self.vehicle))
        guide = self.drawn.presentation is Presentation.GUIDE
        situation = Situation(route=self.route, vehicle=self.vehicle)
        return Cab(post, situation, self._fronts, CabSettings(calibrate=True, guide=guide))

    def _clock_ns(self, second: float) -> int:
        """The time of the cab's clock (ns since 1970)."""
        at_s, by_s = self.drawn.sensors.clock_step
        return START_NS + round((second + (by_s if second >= at_s else 0.0)) * S)

    def _journey(self, second: int) -> JourneyHeard:
        def ns(at_s: float) -> int:
            return START_NS + round(at_s * S)

        first, last = self._stops[0], self._stops[-1]
        stops = [
            OrderedStop(
                one.name,
                one.s_m,
                0 if one is first else ns(one.arrival_s),
                0 if one is last else ns(one.departure_s),
            )
            for one in self._stops
        ]
        return JourneyHeard(
            source="a", time_ns=ns(second), route_id=self.route.id, vehicle_id=self.vehicle.id, stops=tuple(stops)
        )


def changed(stops: list[DayStop], next_stop: int, state: PlantState, drawn: Drawn) -> list[DayStop]:
    """The stops after a change of the journey during the run; unchanged if the change is impossible."""
    share, now_s = drawn.change_by, state.time_s
    done, coming = stops[:next_stop], stops[next_stop:]
    if drawn.change is Change.DROPPED_STOP and len(coming) > 1 and state.speed_mps > 0:
        return [*done, *coming[1:]]
    if drawn.change is Change.OTHER_TIMES:
        by_s = -30.0 + 150.0 * share
        late = [
            replace(one, arrival_s=max(one.arrival_s + by_s, now_s + 20.0 + 40.0 * i), departure_s=np.nan)
            for i, one in enumerate(coming)
        ]
        return [*done, *(replace(one, departure_s=one.arrival_s + DWELL_S) for one in late)]
    if drawn.change is Change.ADDED_STOP and state.speed_mps > 0:
        at_m = state.s_m + 100.0 + 2400.0 * share
        if at_m < coming[0].s_m - CLEAR_M:
            added = DayStop(name="X", s_m=at_m, arrival_s=now_s + 120.0, departure_s=now_s + 120.0 + DWELL_S)
            later = [
                replace(one, arrival_s=one.arrival_s + 240.0, departure_s=one.departure_s + 240.0) for one in coming
            ]
            return [*done, added, *later]
    return stops


class _Operators:
    """The operators of a run: the restrictions that each of them sends, and those truly in force."""

    def __init__(self, drawn: Drawn) -> None:
        self._drawn, self._is_lost = drawn, False
        self._happens_s = round(drawn.happens_s)
        self._told: dict[int, RestrictionsHeard] = {}
        self.in_force: tuple[Place, ...] = ()

    def restarts(self, second: int) -> bool:
        """Whether the node is restarted in this second."""
        kinds = (Operators.NODE_RESTARTED, Operators.NODE_RESTARTED_ALONE)
        return self._drawn.operators in kinds and second == self._happens_s

    def says(self, second: int, head_m: float) -> Iterator[Heard | PublisherSeen]:
        """The messages of all operators in a second, for the train's head at a position."""
        if second == BEGINS_S:
            for told in (Kind.JOURNEY, Kind.RESTRICTION):
                yield PublisherSeen(kind=told, source="a", there=True)
        if not self._is_lost:
            for told_list in self._drawn.lists:
                if second == round(told_list.at_s):
                    self.in_force = told_list.resolved(head_m)
                    self._told[second + 2] = _list(second, self.in_force, "a")
                    yield self._told[second + 2]
            if second in self._told and self._drawn.sensors.late_ratio and self._told[second] == self._newest():
                yield self._told[second]  # The bus delivers the message twice.
        if second == self._happens_s:
            yield from self._incident(second)

    def _newest(self) -> RestrictionsHeard:
        return self._told[max(self._told)]

    def _incident(self, second: int) -> Iterator[Heard | PublisherSeen]:
        """Operators appear or disappear, or the node is restarted."""
        kind, rival = self._drawn.operators, self._drawn.rival
        gone = PublisherSeen(kind=Kind.RESTRICTION, source="a", there=False)
        if kind is Operators.LOST:
            self._is_lost = True
            yield gone
        elif kind in (Operators.RIVAL_SAME, Operators.RIVAL_OTHER):
            yield PublisherSeen(kind=Kind.RESTRICTION, source="b", there=True)
            yield _list(second, self.in_force if kind is Operators.RIVAL_SAME else rival, "b")
        elif kind is Operators.RIVAL_UNSTAMPED:
            yield _list(second, rival, UNSTAMPED)
        elif kind is Operators.TAKEN_OVER:
            self._is_lost = True
            yield PublisherSeen(kind=Kind.RESTRICTION, source="b", there=True)
            yield _list(second, rival, "b")
            yield gone
            self.in_force = rival
        elif kind is Operators.NODE_RESTARTED:
            yield _list(second, self.in_force, "a")
        elif kind is Operators.NODE_RESTARTED_ALONE:
            self._is_lost = True


def _list(second: int, places: tuple[Place, ...], source: str) -> RestrictionsHeard:
    told = tuple(ToldRestriction(*one) for one in places)
    return RestrictionsHeard(source=source, time_ns=START_NS + second * S, restrictions=told)


class _Measuring:
    """The measurements of the sensors with all faults of the run."""

    def __init__(self, drawn: Drawn) -> None:
        self._sensors = drawn.sensors
        self._random = np.random.default_rng([20, drawn.seed])
        self._wander_m, self._frozen_m = 0.0, np.nan
        self._late: list[PositionHeard] = []

    def measured(self, state: PlantState, second: int) -> Iterator[Heard]:
        """The messages of a second: positions, possibly late or repeated, and the wheel forces."""
        noise, chance = self._random.standard_normal(4), float(self._random.random())
        self._wander_m = 0.967 * self._wander_m + 0.25 * POSITION_SD_M * float(noise[0])
        late, self._late = self._late, []
        yield from late
        heard = PositionHeard(source="sensor", fix=self._fix(state, second, float(noise[1])))
        upset, (from_s, to_s) = self._sensors.upset, self._sensors.upset_s
        if upset is Upset.SILENT and from_s <= second < to_s:
            pass
        elif chance < self._sensors.late_ratio:
            self._late.append(heard)
        else:
            yield heard
            if chance > 1.0 - self._sensors.late_ratio:
                yield heard
        electric, friction = (self._sensors.gain * (1.0 + 0.02 * noise[2:])).tolist()
        yield EffortHeard(
            source="control",
            effort=Effort(
                time_ns=START_NS + round((second - self._sensors.force_clock_off_s) * S),
                force_el_n=electric * state.force_el_n,
                force_friction_n=min(friction * state.force_friction_n, 0.0),
            ),
        )

    def _fix(self, state: PlantState, second: int, noise: float) -> PositionFix:
        sensors, moves = self._sensors, state.speed_mps > 0
        s_m = state.s_m + (self._wander_m if moves else 0.0)
        v_mps = max(state.speed_mps + SPEED_SD_MPS * noise, 0.0) if moves else 0.0
        upset, (from_s, to_s) = sensors.upset, sensors.upset_s
        if from_s <= second < to_s:
            if np.isnan(self._frozen_m):
                self._frozen_m = s_m
            s_m = {Upset.JUMP: s_m + sensors.upset_by, Upset.FROZEN: self._frozen_m}.get(upset, s_m)
            v_mps *= 1.0 + sensors.upset_by if upset is Upset.WRONG_SPEED else 1.0
        return PositionFix(
            time_ns=START_NS + round((second - sensors.clock_off_s) * S),
            s_m=s_m,
            speed_mps=v_mps,
            uncertainty_m=POSITION_SD_M,
            speed_uncertainty_mps=SPEED_SD_MPS,
        )
