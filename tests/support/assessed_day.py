"""A random day in closed loop for the assessment: line, train, operators, sensors and clocks that go wrong."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from das.advice.advice import Advice
from das.advice.coach.settings import CoachSettings
from das.advice.modes import Mode
from das.advice.settings import AdviceSettings
from das.cab.cab import Cab, CabSettings
from das.cab.fronts import Fronts
from das.cab.heard import (
    UNSTAMPED,
    EffortHeard,
    Heard,
    JourneyHeard,
    Kind,
    OrderedStop,
    PositionHeard,
    PublisherSeen,
    RestrictionsHeard,
    ToldRestriction,
)
from das.cab.orders import Post
from das.cab.outputs import Estimated, Event
from das.cab.situation import Situation
from das.cab.trains import Trains
from das.domain.files.load import load_route, load_vehicle
from das.estimate.effort import Effort
from das.estimate.fix import PositionFix
from sim.drivers.cab import AdviceView, CabView, PostedRestriction, Presentation, present
from sim.drivers.knowledge import LineKnowledge
from sim.drivers.perfect import PerfectDriver
from sim.plant.plant import Command, Plant, PlantState, lever, speed
from tests.support.making import REPOSITORY
from tests.support.raw_witness import Place

S = 10**9
START_NS = 1_800_000_000 * S
LOOK_S = 0.2
TOO_FAST_MPS = 0.3
"""A driver who holds the advised speed brakes fully where he will be faster than it by more than this."""
SPEED_SD_MPS = 0.05
"""Deviation of the measured speed."""
LONGEST_S = 2500.0
CATALOGUE = REPOSITORY / "das" / "domain" / "catalogue"


class Operators(StrEnum):
    """What becomes of the operators on a day."""

    ONE = "one"
    LOST = "lost"
    RIVAL_SAME = "rival-same"
    RIVAL_OTHER = "rival-other"
    RIVAL_UNSTAMPED = "rival-unstamped"
    TAKEN_OVER = "taken-over"
    NODE_RESTARTED = "node-restarted"
    NODE_RESTARTED_ALONE = "node-restarted-alone"


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """What is drawn for a day."""

    seed: int
    operators: Operators
    gain: float
    clock_off_s: float
    force_clock_off_s: float
    holds_speed: bool
    lists: tuple[tuple[float, tuple[Place, ...]], ...]
    """From when on (s) which restrictions hold."""
    rival: tuple[Place, ...]
    happens_s: float
    buffer_ratio: float
    blended: bool

    @property
    def said(self) -> str:
        """What is drawn, in short."""
        follower = "holds the speed" if self.holds_speed else "follows all"
        return (
            f"day {self.seed}: operators {self.operators} at {self.happens_s:.0f} s, force gain {self.gain:.2f}, "
            f"clocks {self.clock_off_s:+.1f}/{self.force_clock_off_s:+.1f} s, {len(self.lists)} lists, {follower}"
        )


def draw(seed: int, length_m: float) -> Drawn:
    """Draw a day's faults."""
    random = np.random.default_rng([18, seed])

    def places(most: int) -> tuple[Place, ...]:
        made = []
        for _ in range(int(random.integers(0, most + 1))):
            start_m = float(random.uniform(-300.0, length_m))
            made.append((start_m, start_m + float(random.uniform(20.0, 2000.0)), float(random.uniform(4.0, 40.0))))
        return tuple(made)

    off_s = float(random.choice([0.0, random.uniform(-5.0, 5.0), random.uniform(-1.5, 1.5)], p=[0.5, 0.25, 0.25]))
    same_clock = bool(random.random() < 0.7)
    times = sorted(random.uniform(0.0, 150.0, int(random.integers(0, 3))).tolist())
    return Drawn(
        seed=seed,
        operators=list(Operators)[int(random.integers(0, len(Operators)))],
        gain=float(random.choice([1.0, random.uniform(0.5, 1.5)], p=[0.25, 0.75])),
        clock_off_s=off_s,
        force_clock_off_s=off_s if same_clock else 0.0,
        holds_speed=bool(random.random() < 0.5),
        lists=((-10.0, places(3)), *((at_s, places(3)) for at_s in times)),
        rival=places(2),
        happens_s=float(random.uniform(5.0, 150.0)),
        buffer_ratio=float(random.uniform(0.0, 0.3)),
        blended=bool(random.random() < 0.3),
    )


def write_files(folder: Path, number: int, *, blended: bool) -> tuple[Path, Path]:
    """Write the route and the vehicle of a number: a short line with limits and gradients, and a train for it."""
    random = np.random.default_rng([19, number])
    middle_km, length_km = (round(float(x), 3) for x in (random.uniform(1.8, 2.6), random.uniform(4.2, 5.5)))
    at_km, limits = 0.0, []
    while at_km < length_km:
        limits.append([round(at_km, 3), float(random.choice([50, 60, 80, 90, 100, 120, 140]))])
        at_km += float(random.uniform(0.4, 1.5))
    gradients = [[0.0, 0.0]]
    while gradients[-1][0] < length_km - 1.0:
        before = gradients[-1][0]
        gradients.append([round(before + float(random.uniform(0.3, 0.8)), 3), round(float(random.uniform(-12, 12)), 1)])
    route = folder / f"line-{number}.toml"
    route.write_text(
        f'schema_version = 1\n[route]\nid = "line-{number}"\nname = "Line {number}"\nlength_km = {length_km}\n'
        + "".join(
            f'[[stops]]\nname = "{name}"\nposition_km = {km}\n'
            for name, km in (("A", 0.0), ("B", middle_km), ("C", length_km))
        )
        + f'[speed_limits]\ncolumns = ["position_km", "limit_kmh"]\nrows = {limits}\n'
        + f'[gradients]\ncolumns = ["position_km", "gradient_permille"]\nrows = {gradients}\n'
    )
    text = (CATALOGUE / "vehicles" / "re460-ic.toml").read_text()
    # A train that blends has more brake than the plan uses: friction brakes take seconds to build up.
    limited = "max_deceleration_mps2 = 0.6\n" if blended else ""
    changes = {
        "mass_t = 440.0": f"{limited}mass_t = {random.uniform(300, 560):.1f}",
        "length_m = 200.0": f"length_m = {random.uniform(80, 250):.0f}.0",
        'policy = "electric"': f'policy = "{"blended" if blended else "electric"}"',
    }
    for before_text, after in changes.items():
        assert before_text in text
        text = text.replace(before_text, after)
    vehicle = folder / f"train-{number}-{'blended' if blended else 'electric'}.toml"
    vehicle.write_text(text)
    return route, vehicle


@dataclass(kw_only=True)
class Seen:
    """What the witness is told of a second: where the train truly is, what truly holds, and what was said."""

    second: float
    state: PlantState
    places: tuple[Place, ...]
    leg: int
    advice: Advice
    followed: bool


@dataclass(kw_only=True)
class Told:
    """What was said on the day beside advice."""

    estimates: list[Estimated] = field(default_factory=list)
    events: list[str] = field(default_factory=list)
    stood_m: list[float] = field(default_factory=list)
    """Where the train stood at the end of each leg (m)."""


class AssessedDay:
    """Drives one day; iterate over `seconds`, then look at `told`."""

    def __init__(self, drawn: Drawn, route: Path, vehicle: Path, fronts: Fronts) -> None:
        self.drawn, self.told = drawn, Told()
        self.route, self.vehicle = load_route(str(route)), load_vehicle(str(vehicle))
        self._fronts = fronts
        self._random = np.random.default_rng([20, drawn.seed])
        self._plant = Plant(self.route, self.vehicle)
        line = LineKnowledge(route=self.route, vehicle=self.vehicle)
        self._line, self._driver = line, PerfectDriver(line)
        self._stops_m = [stop.position_m for stop in self.route.stops]
        self._times_s = self._timetable()
        self._cab = self._new_cab()
        self._in_force: tuple[Place, ...] = ()
        self._wander_m = 0.0
        self._is_lost = False

    def _timetable(self) -> list[tuple[float, float]]:
        """Departure and arrival (s) of each leg."""
        found, at_s = [], 0.0
        for start_m, end_m in zip(self._stops_m, self._stops_m[1:], strict=False):
            section = Situation(route=self.route, vehicle=self.vehicle).section(start_m, end_m)
            took_s = section.fastest_run.time_to_go_s[0] * (1.0 + self.drawn.buffer_ratio)
            found.append((at_s, at_s + float(took_s) + 5.0))
            at_s = found[-1][1] + 20.0
        return found

    def _new_cab(self) -> Cab:
        post = Post(train="T", route=self.route, trains=Trains(self.vehicle, self.vehicle))
        advice = AdviceSettings(coach=CoachSettings(enabled=False))
        situation = Situation(route=self.route, vehicle=self.vehicle)
        return Cab(post, situation, self._fronts, CabSettings(calibrate=True, advice=advice))

    def seconds(self) -> Iterator[Seen]:
        """Drive to the last stop, second by second."""
        state, leg, view = self._plant.at(0.0, time_s=-10.0), 0, None
        while state.time_s < LONGEST_S:
            second = round(state.time_s)
            for heard in (*self._operators(second), *self._measured(state, second)):
                self._hear(heard, second - 1)
            *others, advice = self._cab.tick(START_NS + second * S)
            assert isinstance(advice, Advice)
            self.told.events += [one.text for one in others if isinstance(one, Event)]
            self.told.estimates += [one for one in others if isinstance(one, Estimated)]
            view = present(advice, Presentation.VECTOR, self._line.train, clock_zero_ns=START_NS)
            yield Seen(
                second=second, state=state, places=self._in_force, leg=leg, advice=advice, followed=view is not None
            )
            for _ in range(round(1.0 / LOOK_S)):
                state = self._plant.advance(state, self._command(state, leg, view), LOOK_S)
            state = state._replace(time_s=float(second + 1))
            # For the cab, a train that is measured at 0.1 m/s or less within 50 m of a stop has arrived there.
            near_m, slow_mps = (50.0, 0.1 + SPEED_SD_MPS) if advice.mode is Mode.STOP else (10.0, 0.0)
            if state.speed_mps <= slow_mps and self._stops_m[leg + 1] - state.s_m <= near_m:
                state = state._replace(speed_mps=0.0)
                self.told.stood_m.append(state.s_m)
                leg += 1
                if leg == len(self._times_s):
                    return
        raise AssertionError(f"{self.drawn.said}: the train did not arrive, it is at {state.s_m:.0f} m")

    def _command(self, state: PlantState, leg: int, view: AdviceView | None) -> Command:
        places = tuple(PostedRestriction(*one) for one in self._in_force)
        departure_s, arrival_s = self._times_s[leg]
        cab = CabView(
            state.time_s, state.s_m, state.speed_mps, float(self._line.limits_mps.at(state.s_m)),
            self._stops_m[leg + 1], departure_s, arrival_s, state.time_s >= departure_s, restrictions=places,
            advice=view,
        )  # fmt: skip
        left_m = self._stops_m[leg + 1] - state.s_m
        if view is None or not self.drawn.holds_speed or left_m < 0 or cab.shall_stand or view.mode == Mode.STOP:
            # The rules of the perfect follower are without restrictions: the advice alone keeps him to those.
            return self._driver.command(cab if view is None else cab._replace(restrictions=()))
        since_s = state.time_s - view.time_s
        speeds = (view.speed_mps, *view.horizon_speed_mps)
        if state.speed_mps < 0.5 and max(speeds[:4]) < 0.5 and left_m > 10.0:
            return self._driver.command(cab)
        now, soon, later = (float(np.interp(since_s + x, range(len(speeds)), speeds)) for x in (0.0, 1.0, 2.0))
        if state.speed_mps > min(now, soon, later) + TOO_FAST_MPS:
            return lever(-1.0)
        return speed(soon, rate_mps2=later - soon)

    def _hear(self, heard: Heard | PublisherSeen, second: int) -> None:
        heard_ns = START_NS + second * S if second >= -10 else 0
        self._cab.hear(replace(heard, heard_ns=heard_ns))

    def _measured(self, state: PlantState, second: int) -> Iterator[Heard]:
        drawn, noise = self.drawn, self._random.standard_normal(4)
        self._wander_m = 0.967 * self._wander_m + 0.25 * 3.0 * float(noise[0])
        moves = state.speed_mps > 0
        stamp_ns = START_NS + round((second - drawn.clock_off_s) * S)
        yield PositionHeard(
            source="sensor",
            fix=PositionFix(
                time_ns=stamp_ns,
                s_m=state.s_m + (self._wander_m if moves else 0.0),
                speed_mps=max(state.speed_mps + SPEED_SD_MPS * float(noise[1]), 0.0) if moves else 0.0,
                uncertainty_m=3.0,
                speed_uncertainty_mps=SPEED_SD_MPS,
            ),
        )
        electric, friction = (drawn.gain * (1.0 + 0.02 * noise[2:])).tolist()
        yield EffortHeard(
            source="control",
            effort=Effort(
                time_ns=START_NS + round((second - drawn.force_clock_off_s) * S),
                force_el_n=electric * state.force_el_n,
                force_friction_n=min(friction * state.force_friction_n, 0.0),
            ),
        )

    def _operators(self, second: int) -> Iterator[Heard | PublisherSeen]:
        """What is said by whom at a second; keeps what truly holds."""
        kind, happens = self.drawn.operators, second == round(self.drawn.happens_s)
        if second == -10:
            for told in (Kind.JOURNEY, Kind.RESTRICTION):
                yield PublisherSeen(kind=told, source="a", there=True)
            yield self._journey()
        if not self._is_lost:
            for at_s, places in self.drawn.lists:
                if second == round(at_s):
                    self._in_force = places
                    yield self._list(second, places, "a")
        if not happens:
            return
        yield from self._incident(kind, second)

    def _incident(self, kind: Operators, second: int) -> Iterator[Heard | PublisherSeen]:
        """Operators come and go, or the node is started anew."""
        gone = PublisherSeen(kind=Kind.RESTRICTION, source="a", there=False)
        if kind is Operators.LOST:
            self._is_lost = True
            yield gone
        elif kind in (Operators.RIVAL_SAME, Operators.RIVAL_OTHER):
            yield PublisherSeen(kind=Kind.RESTRICTION, source="b", there=True)
            yield self._list(second, self._in_force if kind is Operators.RIVAL_SAME else self.drawn.rival, "b")
        elif kind is Operators.RIVAL_UNSTAMPED:
            yield self._list(second, self.drawn.rival, UNSTAMPED)
        elif kind is Operators.TAKEN_OVER:
            self._is_lost = True
            yield PublisherSeen(kind=Kind.RESTRICTION, source="b", there=True)
            yield self._list(second, self.drawn.rival, "b")
            yield gone
            self._in_force = self.drawn.rival
        elif kind in (Operators.NODE_RESTARTED, Operators.NODE_RESTARTED_ALONE):
            self._cab.close()
            self._cab = self._new_cab()
            yield self._journey()
            if kind is Operators.NODE_RESTARTED:
                yield self._list(second, self._in_force, "a")
            else:
                self._is_lost = True

    def _list(self, second: int, places: tuple[Place, ...], source: str) -> RestrictionsHeard:
        told = tuple(ToldRestriction(*one) for one in places)
        return RestrictionsHeard(source=source, time_ns=START_NS + second * S, restrictions=told)

    def _journey(self) -> JourneyHeard:
        arrivals = [0, *(START_NS + round(end_s * S) for _, end_s in self._times_s)]
        departures = [*(START_NS + round(start_s * S) for start_s, _ in self._times_s), 0]
        stops = [
            OrderedStop(stop.name, stop.position_m, arrival, departure)
            for stop, arrival, departure in zip(self.route.stops, arrivals, departures, strict=True)
        ]
        common: dict[str, Any] = {"route_id": self.route.id, "vehicle_id": self.vehicle.id, "stops": tuple(stops)}
        return JourneyHeard(source="a", time_ns=START_NS - 10 * S, **common)
