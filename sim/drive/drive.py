"""A recorded drive: its table, and all that is computed from it.

Each result is computed once, when it is first needed. Reports, tables, pictures, comparisons and JSON read these
results, so that they cannot disagree.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from das.bus.recording import Recording
from das.domain.errors import DasError
from das.domain.summary import Summary
from das.domain.units import KM, NS, kwh_words
from sim.drive.calls import KeptCall, Travelled, calls, travelled
from sim.drive.events import DriveEvent, Span, events, silences
from sim.drive.limits import (
    Signal,
    TemporaryLimit,
    Violations,
    limit_in_force,
    signals,
    temporary_limits,
    violations_of,
)
from sim.drive.table import DriveTable
from sim.recording.course import Floats
from sim.recording.opening import DriveInputs, open_recording

if TYPE_CHECKING:
    from das.drawing.plotted import PlottedRun
    from sim.drive.energy import DriveEnergy
    from sim.drive.figures import DriveFigures
    from sim.drive.series import Found


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Drive(Summary):
    """A recorded drive. `given`: line and train, if the recording lacks them."""

    recording: Recording
    given: DriveInputs | None = None

    @classmethod
    def read(cls, path: Path) -> Drive:
        """The drive in a recording; DasError if the file cannot be used."""
        return cls(recording=open_recording(path))

    @property
    def name(self) -> str:
        """The name of the drive on a page: its file's name."""
        return self.recording.path.stem

    @cached_property
    def table(self) -> DriveTable:
        """Everything that was recorded, as columns."""
        return DriveTable.of(self.recording, self.given)

    @cached_property
    def calls(self) -> tuple[KeptCall, ...]:
        """The stops of the journey as served; empty without a journey."""
        return calls(self.table)

    @property
    def served(self) -> tuple[KeptCall, ...]:
        """The stops at which the train stood."""
        return tuple(one for one in self.calls if one.served)

    @property
    def travelled(self) -> Travelled:
        """The first and the last moment and position of the drive, between its stops if it served two or more."""
        return travelled(self.calls, self.table.course)

    @property
    def late_s(self) -> float:
        """Lateness at the last stop (s; early < 0); NaN if not known or without a timetable."""
        return self.calls[-1].late_s if self.calls else math.nan

    @cached_property
    def events(self) -> tuple[DriveEvent, ...]:
        """Everything that happened, in order of time."""
        return events(self.table, self.calls, self.limit_mps)

    @cached_property
    def energy(self) -> DriveEnergy:
        """The energy of the drive, also by place and cause."""
        from sim.drive.energy import DriveEnergy  # imports the solver, which events and stops do not need

        return DriveEnergy(table=self.table, made=self.calls)

    @cached_property
    def series(self) -> Found:
        """The series of the drive over time, by the names of `sim.drive.series.STYLES`."""
        from sim.drive.series import series  # with the colours, which only pictures need

        return series(self.table)

    @cached_property
    def limit_mps(self) -> Floats:
        """The limit in force (m/s) at every position of the course, NaN where it is not known (`sim.drive.limits`)."""
        return limit_in_force(self.table, self.temporary_limits)

    @property
    def limit_known(self) -> bool:
        """Whether the limit in force is known at every position of the course."""
        return bool(np.isfinite(self.limit_mps).all())

    @cached_property
    def temporary_limits(self) -> tuple[TemporaryLimit, ...]:
        """The restrictions that the node received."""
        return temporary_limits(self.table)

    @cached_property
    def signals(self) -> tuple[Signal, ...]:
        """The signals at danger that the driver saw."""
        return signals(self.table)

    @cached_property
    def silences(self) -> tuple[Span, ...]:
        """The times without advice."""
        return silences(self.table)

    @cached_property
    def violations(self) -> Violations:
        """Signals that were passed at danger, and speeds above the limit."""
        return violations_of(self.table.course, self.limit_mps, self.signals)

    @cached_property
    def figures(self) -> DriveFigures:
        """Figures on compliance with signals, limits, stops and advice, and on the stability of the advice."""
        from sim.drive.figures import figures  # which a report in words does not need

        return figures(self.table, self.violations, self.calls)

    def facts(self) -> dict[str, str]:
        """A heading: file, first and last stop, duration, lateness, and the energy if the recording states it."""
        told = {"recording": self.name}
        try:
            way = self.travelled
        except DasError as error:
            return {**told, "unusable": str(error).removeprefix(f"{self.recording.path}: ")}
        if way.between_stops:
            told["way"] = f"{self.served[0].name} – {self.served[-1].name}"
        told |= {"distance": f"{way.way_m / KM:.1f} km", "time": f"{way.time_s:.0f} s"}
        told |= {"late": f"{self.late_s:+.0f} s"} if self.calls and math.isfinite(self.late_s) else {}
        said = self.table.said.saving
        return told if said is None else {**told, "energy": kwh_words(said.driven_j)}

    def plotted(self) -> PlottedRun:
        """The drive between its first departure and its last arrival, for a picture; DasError if it has no positions.

        Wheel forces are known only for simulated drives; for others, the energy is estimated.
        """
        from das.drawing.plotted import PlottedRun
        from sim.drive.legs import since_departure_j

        way, course, energy = self.travelled, self.table.course, self.energy
        time_ns = course.between_ns(way.start_ns, way.end_ns)
        try:
            drawn_j = since_departure_j(energy.legs, energy.of_legs, time_ns)
        except DasError:
            drawn_j = None
        forces: dict[str, Floats] = {}
        if energy.measured:
            _, *columns = self.table.of_topic("truth", "force_el_n", "force_friction_n")
            forces = {name: course.at(time_ns, one) for name, one in zip(("el", "friction"), columns, strict=True)}
        inputs = self.table.known_inputs
        return PlottedRun(
            names=(self.name,),
            time_s=np.asarray((time_ns - self.table.clock.zero_ns) * NS, dtype=np.float64),
            s_m=course.at(time_ns, course.s_m),
            speed_mps=course.at(time_ns, course.speed_mps),
            limit_mps=course.at(time_ns, self.limit_mps),
            force_el_n=forces.get("el"),
            force_friction_n=forces.get("friction"),
            energy_j=drawn_j,
            route=None if inputs is None else inputs.route,
        )
