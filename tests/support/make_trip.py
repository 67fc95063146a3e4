"""Generator of the recording of a trip (MCAP): a simulated train and driver without advice, with a GPS receiver.

`python -m tests.support.make_trip` writes the messages of the bundled recording again, to the named file.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from das.bus import codec
from das.bus.recorder import RecordingFile
from das.bus.topics import LOCATION
from das.cab.heard import DelayHeard, Heard, JourneyHeard, PositionHeard
from das.domain.errors import DasError
from das.domain.files.load import load_route, load_vehicle
from das.domain.journey import OrderedStop
from das.domain.levels import Level
from das.domain.route import Route, Stop, section_stops
from das.domain.units import NS
from das.domain.vehicle import Vehicle
from das.estimate.estimate import PositionFix, Quality
from das.solver.section import build_section
from das.solver.solve import solve_front
from sim.bundled.recorded_driver import HurriedDriver
from sim.world.lockstep import location
from tests.support.hurried_plant import HurriedPlant, HurriedState

POSITION_SIGMA_M, POSITION_CORRELATION_S = 3.0, 20.0
SPEED_SIGMA_MPS = 0.08
"""Noise of the receiver (assumed; typical of a good GPS receiver)."""
FIX_EVERY_S = 1.0
STANDING_S = 5
"""Seconds of standing recorded before departure and after arrival."""
LONGEST_S = 4 * 3600.0
AT_STOP_M = 1.5


@dataclass(frozen=True, kw_only=True)
class TripPlan:
    """The trip to make: a section, its timetable, and the delay of the departure."""

    route: Route
    vehicle: Vehicle
    level: Level
    start: Stop
    end: Stop
    reversed: bool
    departure_ns: int
    running_time_s: float
    delay_s: float
    seed: int
    train: str


def drive(plan: TripPlan) -> list[HurriedState]:
    """The true states of the trip, once a second from departure to standstill at the stop."""
    plant = HurriedPlant(plan.route, plan.vehicle, plan.vehicle.loss_model(plan.level))
    driver = HurriedDriver(plan.route, plan.vehicle, plan.end.position_m, plan.seed)
    state = HurriedState(time_s=0.0, s_m=plan.start.position_m, speed_mps=0.0)
    states = [state]
    per_fix = round(FIX_EVERY_S / plant.step_s)
    while state.s_m < plan.end.position_m - AT_STOP_M or state.speed_mps > 0.0:
        if state.s_m >= plan.end.position_m - AT_STOP_M and state.speed_mps < 0.2:
            state = HurriedState(time_s=state.time_s, s_m=state.s_m, speed_mps=0.0, energy_input_j=state.energy_input_j)
            break
        for _ in range(per_fix):
            state = plant.step(state, driver.wanted_force_n(state.s_m, state.speed_mps, plant.step_s))
        states.append(state)
        if state.time_s > LONGEST_S:
            raise DasError(f"the simulated train did not arrive within {LONGEST_S:.0f} s (at {state.s_m:.0f} m)")
    return [*states, state]


def write_trip(path: Path, plan: TripPlan, states: list[HurriedState], command: str) -> None:
    """Write a recording of a trip, with the messages of a receiver and the operator."""
    random = np.random.default_rng(plan.seed + 1)
    file = RecordingFile(path)

    def tell(value: Heard, time_ns: int) -> None:
        topic, message = codec.encode_input(value)
        file.add(topic, topic.key(plan.train), message, time_ns)

    try:
        file.add_metadata("run", {"kind": "simulated trip", "command": command, "seed": str(plan.seed)})
        start_ns = plan.departure_ns + round(plan.delay_s / NS)
        first_ns = start_ns - round(STANDING_S / NS)
        tell(_journey(plan, first_ns), first_ns)
        tell(DelayHeard(time_ns=first_ns, delay_s=plan.delay_s), first_ns)
        offset = 0.0
        decay = math.exp(-FIX_EVERY_S / POSITION_CORRELATION_S)
        standing = [states[0]] * STANDING_S
        for i, state in enumerate([*standing, *states, *[states[-1]] * STANDING_S]):
            time_ns = first_ns + round(i * FIX_EVERY_S / NS)
            offset = decay * offset + POSITION_SIGMA_M * math.sqrt(1 - decay**2) * random.standard_normal()
            moving = state.speed_mps > 0
            speed = max(state.speed_mps + SPEED_SIGMA_MPS * random.standard_normal(), 0.0) if moving else 0.0
            s_m = state.s_m + (offset if moving else 0.0)
            fix = PositionFix(
                time_ns=time_ns,
                s_m=s_m,
                speed_mps=speed,
                uncertainty_m=POSITION_SIGMA_M,
                speed_uncertainty_mps=0.0,
                quality=Quality.GOOD,
            )
            tell(PositionHeard(fix=fix), time_ns)
            place = plan.route.location_deg(s_m)
            if place is not None:
                on_map = location(time_ns, float(place[0]), float(place[1]))
                file.add(LOCATION, LOCATION.key(plan.train), on_map, time_ns)
    finally:
        file.close()


def _journey(plan: TripPlan, time_ns: int) -> JourneyHeard:
    arrival_ns = plan.departure_ns + round(plan.running_time_s / NS)
    return JourneyHeard(
        time_ns=time_ns,
        train=plan.train,
        route_id=plan.route.id,
        vehicle_id=plan.vehicle.id,
        reversed=plan.reversed,
        stops=(
            OrderedStop(plan.start.name, plan.start.position_m, departure_ns=plan.departure_ns),
            OrderedStop(plan.end.name, plan.end.position_m, arrival_ns=arrival_ns),
        ),
    )


BUFFER_RATIO = 0.15
TIMETABLE_STEP_S = 6.0
"""Step (s) of the times of a timetable, a tenth of a minute."""
DEPARTURE = datetime(2026, 11, 21, 8, 4, tzinfo=UTC)


def made_trip(
    out: Path,
    route: str = "flat-6km",
    *,
    between: tuple[str | None, str | None] = (None, None),
    reverse: bool = False,
    delay_s: float = 0.0,
) -> list[HurriedState]:
    """Make the trip of a bundled Re 460 train on a bundled line between two stops, and return its true states."""
    vehicle = load_vehicle("re460-ic")
    line = load_route(route).reversed() if reverse else load_route(route)
    start, end = section_stops(line, *between)
    section = build_section(line, vehicle, start_m=start.position_m, end_m=end.position_m)
    wanted_s = solve_front(section).fastest().time_s * (1 + BUFFER_RATIO)
    plan = TripPlan(
        route=line, vehicle=vehicle, level=section.level, start=start, end=end, reversed=reverse,
        departure_ns=round(DEPARTURE.timestamp() / NS),
        running_time_s=math.ceil(wanted_s / TIMETABLE_STEP_S) * TIMETABLE_STEP_S,
        delay_s=delay_s, seed=1, train="train-1",
    )  # fmt: skip
    states = drive(plan)
    write_trip(out, plan, states, "python -m tests.support.make_trip")
    return states


if __name__ == "__main__":
    made_trip(Path(sys.argv[1]), "zurich-luzern", between=("Zürich HB", "Zug"), delay_s=90.0)
