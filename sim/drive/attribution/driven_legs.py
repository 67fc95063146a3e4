"""A driven leg: its motion from stand to stand, and its energy as measured and by the planned train."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from das.bus import topics
from das.bus.recording import Recording
from das.domain.errors import DasError
from das.domain.losses import LossMap
from das.domain.route import Route
from das.domain.trajectory import Trajectory
from das.domain.units import NS
from das.solver.section import Section
from sim.drive.calls import KeptCall, knows_truth
from sim.recording.course import Floats, Times
from sim.trips.estimate import estimate_run
from sim.trips.profile import DrivenRun
from sim.trips.trip import recorded_trip

LEAST_WAY_M = 100.0
"""A way between two stands that is shorter than this (m) is no section: the train moved up."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivenMotion:
    """Samples of a drive, each array of shape (samples,).

    `input_j` is the energy at the current collector and `friction_j` that of the friction brake, both since the start;
    they are None where nobody measured them.
    """

    time_ns: Times
    s_m: Floats
    speed_mps: Floats
    input_j: Floats | None = None
    friction_j: Floats | None = None

    @classmethod
    def of_run(cls, run: DrivenRun) -> DrivenMotion:
        """The motion of a smoothed record, of which no energy was measured."""
        return cls(time_ns=run.start_time_ns + np.rint(run.time_s / NS).astype(np.int64), s_m=run.s_m,
                   speed_mps=run.speed_mps)  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivenLeg:
    """The motion from a stand at one stop to the stand at the next that was served.

    The first and the last sample stand, at the refined times of departure and arrival.
    """

    start: KeptCall
    end: KeptCall
    motion: DrivenMotion

    @property
    def time_s(self) -> Floats:
        """Time since the departure (s)."""
        since_s: Floats = (self.motion.time_ns - self.motion.time_ns[0]) * NS
        return since_s

    @property
    def trip_s(self) -> float:
        """Time from departure to arrival (s)."""
        return float(self.time_s[-1])

    @property
    def timetable_s(self) -> float | None:
        """Time that the timetable gives (s); None where it does not."""
        due_ns, leaves_ns = self.end.due_arrival_ns, self.start.due_departure_ns
        return (due_ns - leaves_ns) * NS if due_ns > leaves_ns > 0 else None

    @property
    def left_s(self) -> float | None:
        """Time from the departure as driven to the arrival of the timetable (s); None without a timetable."""
        due_ns = self.end.due_arrival_ns
        return (due_ns - int(self.motion.time_ns[0])) * NS if due_ns else None


def motion_of(recording: Recording, line: Callable[[], Route]) -> DrivenMotion:
    """The motion of a recorded drive: the truth of a simulation, else smoothed positions and measured brake forces.

    `line` gives the line as driven, on which positions are smoothed; it is asked for only without a simulator's truth.
    Energies count as measured only in the recording of a simulated run: those of a replay are estimates themselves.
    DasError where the recording has no positions that can be used.
    """
    fields = ("time_ns", "s_m", "speed_mps", "energy_input_j", "friction_brake_j")
    truth = recording.columns(topics.TRUTH, *fields)
    if len(truth["time_ns"]) > 1:
        measured = knows_truth(recording)
        return DrivenMotion(
            time_ns=truth["time_ns"],
            s_m=truth["s_m"],
            speed_mps=truth["speed_mps"],
            input_j=truth["energy_input_j"] if measured else None,
            friction_j=truth["friction_brake_j"] if measured else None,
        )
    motion = DrivenMotion.of_run(recorded_trip(recording, line()).run)
    return replace(motion, friction_j=_friction_j(recording, motion.time_ns, motion.speed_mps))


def _friction_j(recording: Recording, time_ns: Times, speed_mps: Floats) -> Floats | None:
    """Energy of the friction brake since the start (J), from the forces that the train measured; None without them."""
    effort = recording.columns(topics.EFFORT, "time_ns", "force_friction_n")
    if len(effort["time_ns"]) < 2:
        return None
    force_n = np.minimum(effort["force_friction_n"], 0.0)
    power_w = -np.interp(time_ns, effort["time_ns"], force_n, left=0.0, right=0.0) * speed_mps
    step_j = 0.5 * (power_w[:-1] + power_w[1:]) * np.diff(time_ns) * NS
    return np.concatenate(([0.0], np.cumsum(step_j)))


def legs_of(path: Path, motion: DrivenMotion, made: Sequence[KeptCall]) -> tuple[DrivenLeg, ...]:
    """The legs of a drive between the stops that were served; DasError where the train served no two stops."""
    found = tuple(_legs(motion, [call for call in made if call.served]))
    if not found:
        raise DasError(f"{path}: the train did not drive from one stop of its journey to another")
    return found


def _legs(motion: DrivenMotion, served: list[KeptCall]) -> Iterator[DrivenLeg]:
    for start, end in pairwise(served):
        if not start.departed_ns or not end.arrived_ns or end.stood_m - start.stood_m < LEAST_WAY_M:
            continue
        leaving = int(np.searchsorted(motion.time_ns, start.departed_ns, side="right")) - 1
        arrived = int(np.searchsorted(motion.time_ns, end.arrived_ns))
        cut = _part(motion, slice(max(leaving, 0), arrived + 1))
        time_ns, speed_mps = cut.time_ns.copy(), cut.speed_mps.copy()
        # From rest to rest: a leg takes as long as punctuality says, and its optimum has all of that time.
        time_ns[0], time_ns[-1] = start.departed_ns, end.arrived_ns
        speed_mps[0] = speed_mps[-1] = 0.0
        s_m = np.clip(np.maximum.accumulate(cut.s_m), cut.s_m[0], cut.s_m[-1])
        yield DrivenLeg(start=start, end=end, motion=replace(cut, time_ns=time_ns, speed_mps=speed_mps, s_m=s_m))


def _part(motion: DrivenMotion, part: slice) -> DrivenMotion:
    arrays = {name: None if array is None else array[part] for name, array in vars(motion).items()}
    return DrivenMotion(**arrays)  # type: ignore[arg-type]


@dataclass(frozen=True, kw_only=True, eq=False)
class LegEnergies:
    """Energies at the current collector up to every sample of a leg (J), arrays of shape (samples,), 0 at the start.

    `balance_j`: as measured; where nobody measured, `blended_j`. `blended_j`: the same motion with the planned train,
    motors and friction brake sharing the braking as recorded. `motors_j`: likewise, the motors braking first.
    `trajectory` is that last run; `index[i]` is the sample at its node i. `measured` tells whether `balance_j` was.
    """

    balance_j: Floats
    blended_j: Floats
    motors_j: Floats
    trajectory: Trajectory
    index: NDArray[np.intp]
    measured: bool


def leg_energies(section: Section, leg: DrivenLeg) -> LegEnergies:
    """The energies of a driven leg by inverse dynamics, and as measured."""
    motion = leg.motion
    driven = estimate_run(section, leg.time_s, motion.s_m, motion.speed_mps)
    nodes, index = np.arange(len(motion.s_m)), driven.index
    motors_j = np.interp(nodes, index, driven.energy_input_j)
    blended_j = motors_j
    if motion.friction_j is not None:
        extra_j = _blended_input_j(section, driven.trajectory, np.diff(motion.friction_j[index]))
        blended_j = np.interp(nodes, index, np.concatenate(([0.0], np.cumsum(extra_j))))
    measured = motion.input_j is not None
    balance_j = blended_j if motion.input_j is None else motion.input_j - motion.input_j[0]
    return LegEnergies(
        balance_j=balance_j,
        blended_j=blended_j,
        motors_j=motors_j,
        trajectory=driven.trajectory,
        index=index,
        measured=measured,
    )


def _blended_input_j(section: Section, run: Trajectory, friction_j: Floats) -> Floats:
    """Energy of each interval (J) where the friction brake took `friction_j` of it and the motors the rest.

    The friction brake takes no more than the motion of the planned train asks of all brakes.
    """
    total_n = run.force_el_n + run.force_friction_n
    friction_n = np.maximum(-friction_j / np.diff(run.s_m), np.minimum(total_n, 0.0))
    electric_n, mean_mps = total_n - friction_n, run.mean_speed_mps()
    if isinstance(section.loss, LossMap):
        mean_mps = np.minimum(mean_mps, section.loss.speed_mps[-1])
        low_n = np.interp(mean_mps, section.loss.speed_mps, section.loss.force_low_n)
        high_n = np.interp(mean_mps, section.loss.speed_mps, section.loss.force_high_n)
        loss_j = section.loss.loss_w(np.clip(electric_n, low_n, high_n), mean_mps) * run.interval_s()
    else:
        loss_j = section.loss.loss_w(electric_n, mean_mps) * run.interval_s()
    gross_j = electric_n * np.diff(run.s_m) + loss_j
    return np.where(gross_j > 0, gross_j, np.clip(run.supply, 0.0, 1.0) * gross_j)
