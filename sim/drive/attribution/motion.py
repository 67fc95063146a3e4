"""The motion of a recorded drive between two stands, with the energy that was measured where it was."""

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
from das.domain.route import Route
from das.domain.units import NS
from sim.drive.calls import KeptCall, knows_truth
from sim.trips.opening import recorded_trip
from sim.trips.profile import DrivenRun

Floats = NDArray[np.float64]
Times = NDArray[np.int64]

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
