"""One drive with all its figures, whether it comes from a recording or from a run that was just driven.

Each figure is computed once, when it is first asked for. Tables, reports, pictures, comparisons and JSON read it here,
so that they cannot disagree.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, tzinfo
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from das.bus import topics
from das.bus.recording import Recording
from das.domain.errors import DasError
from das.domain.plotted import PlottedRun
from das.domain.summary import Summary
from das.domain.units import KM, NS, kwh
from sim.drive.above_optimum import (
    NOT_COMPARABLE,
    SAID_BY_THE_RECORDING,
    AboveOptimum,
    SectionEnergy,
    why_not_comparable,
)
from sim.drive.attribution.causes import ShownAdvice
from sim.drive.calls import AtStop, KeptCall, Travelled, at_stops, calls_of
from sim.drive.events.chronicle import LineAndTrain, events_of
from sim.drive.events.event import DriveEvent
from sim.drive.happenings import Signal, Span, signals, silences
from sim.drive.instructions import InstructionFigures, recorded_instructions
from sim.drive.limits import TemporaryLimit, Violations, limit_in_force, temporary_limits, violations_of
from sim.drive.stability import AdviceStability, recorded_stability
from sim.recording.course import DriveClock, DrivenCourse, Floats
from sim.recording.inputs import DriveInputs, inputs_of
from sim.recording.opening import open_recording

if TYPE_CHECKING:  # these import the solver, which events, notes and stops do not need
    from sim.drive.attribution import driven_legs
    from sim.drive.attribution.attribution import Attribution
    from sim.drive.attribution.driven_legs import ComparedLeg, DrivenLeg, DrivenMotion, LegEnergies, LikelyRange

_Found = TypeVar("_Found")


@dataclass(frozen=True, kw_only=True)
class RunFigures:
    """The figures of a run that was just driven: exact, while a recording gives figures from one state a second."""

    calls: tuple[KeptCall, ...]
    above: AboveOptimum
    violations: Violations
    stability: AdviceStability
    instructions: InstructionFigures


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class DrivenWay(Summary):
    """The course of a drive: when the train was where, how it kept its stops, and which limits held.

    `source` is the recording of the drive, None for a run that was not recorded. `run` holds the figures of a run that
    was just driven; they replace those of a recording. `given`: line and train, if the recording lacks them.
    """

    source: Recording | None = None
    run: RunFigures | None = None
    given: DriveInputs | None = None

    @property
    def recording(self) -> Recording:
        """The recording of the drive; DasError for a run that was not recorded."""
        if self.source is None:
            raise DasError("this run was not recorded, so that nothing but its figures is known")
        return self.source

    @property
    def name(self) -> str:
        """The name of the drive on a page: its file's name."""
        return self.recording.path.stem

    @cached_property
    def course(self) -> DrivenCourse:
        """Where the train was, and how fast; DasError for a recording without positions."""
        return DrivenCourse.of(self.recording)

    @cached_property
    def clock(self) -> DriveClock:
        """The clock of the drive, which shows 0 at the timetable's departure; its times of day are the line's."""
        return replace(DriveClock.of(self.recording, int(self.course.time_ns[0])), zone=self.zone)

    @cached_property
    def calls(self) -> tuple[KeptCall, ...]:
        """How each stop of the journey was kept; empty without a journey."""
        return calls_of(self.recording, self.course) if self.run is None else self.run.calls

    @property
    def served(self) -> tuple[KeptCall, ...]:
        """The stops at which the train stood."""
        return tuple(one for one in self.calls if one.served)

    @property
    def travelled(self) -> Travelled:
        """The first and the last moment and position of the drive, between its stops if it served two or more."""
        served, course = self.served, self.course
        if len(served) > 1 and served[0].departed_ns and served[-1].arrived_ns:
            first, last = served[0], served[-1]
            return Travelled(first.departed_ns, last.arrived_ns, first.s_m, last.s_m, between_stops=True)
        (start_ns, end_ns), (start_m, end_m) = course.time_ns[[0, -1]].tolist(), course.s_m[[0, -1]].tolist()
        return Travelled(start_ns, end_ns, start_m, end_m, between_stops=False)

    @cached_property
    def at_stops(self) -> tuple[AtStop, ...]:
        """When the train was at the stops at which it stood or which it passed, in order of time."""
        return at_stops(self.calls, self.course)

    @property
    def late_s(self) -> float:
        """How late the train arrived at the last stop (s; early < 0); NaN if not known or without a timetable."""
        return self.calls[-1].late_s if self.calls else math.nan

    @cached_property
    def _inputs(self) -> DriveInputs | DasError:
        return _or_error(lambda: inputs_of(self.recording)) if self.given is None else self.given

    @property
    def inputs(self) -> DriveInputs:
        """Line, train and level; DasError if they are neither attached to the recording nor bundled."""
        return _raised(self._inputs)

    @property
    def zone(self) -> tzinfo:
        """The time zone of the line; UTC where the line is not known."""
        return UTC if isinstance(self._inputs, DasError) else self._inputs.route.zone

    @cached_property
    def limit_mps(self) -> Floats:
        """The limit in force (m/s) at every position of the course, NaN where it is not known (`sim.drive.limits`)."""
        inputs = None if isinstance(self._inputs, DasError) else self._inputs
        return limit_in_force(self.recording, self.course, inputs, self.temporary_limits)

    @property
    def limit_known(self) -> bool:
        """Whether the limit in force is known at every position of the course."""
        return bool(np.isfinite(self.limit_mps).all())

    @cached_property
    def temporary_limits(self) -> tuple[TemporaryLimit, ...]:
        """The restrictions that the node received."""
        return temporary_limits(self.recording, self.course)

    @cached_property
    def violations(self) -> Violations:
        """Signals that were passed at danger, and speeds above the limit."""
        if self.run is not None:
            return self.run.violations
        return violations_of(self.course, self.limit_mps, self.signals)

    @cached_property
    def signals(self) -> tuple[Signal, ...]:
        """The signals at danger that the driver saw."""
        return signals(self.recording)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class DrivenEnergy(DrivenWay):
    """The energy of a drive, leg by leg, and how far it is above the optimum."""

    @cached_property
    def motion(self) -> DrivenMotion:
        """The motion, with its energy if that was measured; DasError if the motion is not known."""
        from sim.drive.attribution.driven_legs import motion_of

        return motion_of(self.recording, lambda: self.inputs.route)

    @cached_property
    def legs(self) -> tuple[DrivenLeg, ...]:
        """The motion between the stops that were served; DasError if the train served fewer than two.

        Stops of a replayed trip count even if its journey does not name them. If the replay compared a part between
        equal speeds, the legs are those of that part.
        """
        from sim.drive.attribution.open_part import legs_of_drive

        return legs_of_drive(self, self.motion)

    @property
    def smoothed(self) -> driven_legs.Smoothed | None:
        """How the legs change if the recorded positions are smoothed otherwise; None without usable positions."""
        from sim.drive.attribution.driven_legs import smoothed_motions
        from sim.drive.attribution.open_part import legs_of_drive

        motions = _or_error(lambda: smoothed_motions(self.recording, self.inputs.route))
        return None if isinstance(motions, DasError) else lambda jerk: legs_of_drive(self, motions(jerk))

    @cached_property
    def energies(self) -> tuple[LegEnergies, ...]:
        """The energies of each leg; DasError if fewer than two stops were served, or line or train are not known."""
        from sim.drive.attribution.driven_legs import leg_energies, section_of_leg

        return tuple(leg_energies(section_of_leg(self.inputs, leg), leg) for leg in self.legs)

    @cached_property
    def compared(self) -> tuple[ComparedLeg, ...]:
        """The legs beside the planned train's optimum; DasError as for `energies`."""
        from das.solver.solve import solve_front
        from sim.drive.attribution.driven_legs import ComparedLeg, section_of_leg

        pairs = zip(self.legs, self.energies, strict=True)
        return tuple(ComparedLeg.of(leg, solve_front(section_of_leg(self.inputs, leg)), one) for leg, one in pairs)

    @cached_property
    def driven_j(self) -> float | None:
        """Energy at the current collector (J), from each departure to the next arrival; None if not known.

        It is an estimate unless `measured`. If fewer than two stops were served, it is all the energy measured, or that
        of the part that a replay estimated.
        """
        if self._said_by_simulator is not None:
            return self._said_by_simulator.driven_j
        found = _or_error(lambda: self.legs)
        if self.measured:
            motions = [self.motion] if isinstance(found, DasError) else [leg.motion for leg in found]
            return math.fsum(one.drawn_j for one in motions)
        energies = found if isinstance(found, DasError) else _or_error(lambda: self.energies)
        if isinstance(energies, DasError):
            return None if self.said is None else self.said.driven_j
        return math.fsum(one.driven_j for one in energies)

    @property
    def measured(self) -> bool:
        """Whether a simulator measured the energy; otherwise it is estimated from positions."""
        if self.run is not None:
            return self.run.above.measured
        motion = _or_error(lambda: self.motion)
        return not isinstance(motion, DasError) and motion.input_j is not None

    @cached_property
    def said(self) -> AboveOptimum | None:
        """The energy above the optimum that simulator or replay recorded; None if neither did."""
        return AboveOptimum.recorded(self.recording)

    @cached_property
    def _said_by_simulator(self) -> AboveOptimum | None:
        """The energy above the optimum of the true train, which the simulator alone knows; None if it stated none.

        A part of a recording has the sections that it still holds.
        """
        if self.run is not None or self.said is None or not self.said.measured:
            return None if self.run is None else self.run.above
        legs = _or_error(lambda: self.legs)
        held = () if isinstance(legs, DasError) else [(one.start.name, one.end.name) for one in legs]
        sections = tuple(one for one in self.said.sections if (one.start, one.end) in held)
        return replace(self.said, sections=sections) if sections else self.said

    @cached_property
    def _above(self) -> AboveOptimum | DasError:
        if self._said_by_simulator is not None:
            return self._said_by_simulator
        found = _or_error(lambda: self._beside_planned([one.section_energy for one in self.compared]))
        return found if self.said is None or not isinstance(found, DasError) else self.said

    def _beside_planned(self, sections: list[SectionEnergy]) -> AboveOptimum:
        """The energy above the planned train's optimum; a replay knows more of its certainty, and of the trip."""
        why_not, said = why_not_comparable(sections), self.said
        above = AboveOptimum(sections=tuple(sections), measured=self.measured, why_not=why_not)
        if said is None or said.measured:
            return above
        known = said.why_not if said.why_not != SAID_BY_THE_RECORDING else why_not or said.why_not
        return replace(above, why_not=known or why_not, likely=said.likely, worst=said.worst)

    @property
    def above(self) -> AboveOptimum | None:
        """The energy above the optimum: of the true train for a simulated run, else of the planned train; None if it is
        not known, for the reason `not_comparable`."""
        return None if isinstance(self._above, DasError) else self._above

    @property
    def not_comparable(self) -> str:
        """Why the drive cannot be compared with its optimum; empty if it can."""
        if not isinstance(self._above, DasError):
            return self._above.why_not
        return self._told(self._above).removeprefix(f"{NOT_COMPARABLE}: ")

    def _told(self, error: DasError) -> str:
        """An error without the name of the recording, which the reader knows."""
        return str(error) if self.source is None else str(error).removeprefix(f"{self.source.path}: ")

    @cached_property
    def motors_first(self) -> AboveOptimum:
        """The energy above the optimum if the planned train had driven this motion, and its motors had braked first.

        Drives with other brakes can be compared by it. Raises DasError as `energies` does.
        """
        return replace(self._beside_planned([one.motors_first for one in self.compared]), likely=None, worst=None)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Drive(DrivenEnergy):
    """A drive with all its figures: its course, the advice, what happened, and where its energy went.

    It is made from any recording, or from the figures of a run that was just driven.
    """

    @classmethod
    def read(cls, path: Path) -> Drive:
        """The drive in a recording; DasError if the file cannot be used."""
        return cls(source=open_recording(path))

    def facts(self) -> dict[str, str]:
        """The file, between which stops, how long, how late, and the energy if the recording states it."""
        if self.source is None:
            return {"run": "not recorded", "late": f"{self.late_s:+.0f} s"}
        told, way = {"recording": self.name}, _or_error(lambda: self.travelled)
        if isinstance(way, DasError):
            return {**told, "unusable": self._told(way)}
        if way.between_stops:
            told["way"] = f"{self.served[0].name} – {self.served[-1].name}"
        told |= {"distance": f"{way.way_m / KM:.1f} km", "time": f"{way.time_s:.0f} s"}
        told |= {"late": f"{self.late_s:+.0f} s"} if self.calls and math.isfinite(self.late_s) else {}
        return told if self.said is None else {**told, "energy": f"{kwh(self.said.driven_j):.1f} kWh"}

    def plotted(self) -> PlottedRun:
        """The drive between its first departure and its last arrival, for a picture; DasError if it has no positions.

        Wheel forces are known of simulated drives alone; the energy of others is the estimate.
        """
        from sim.drive.attribution.driven_legs import since_departure_j

        way, course = self.travelled, self.course
        time_ns = course.between_ns(way.start_ns, way.end_ns)
        drawn_j = _or_error(lambda: since_departure_j(self.legs, self.energies, time_ns))
        truth = self.recording.columns(topics.TRUTH, "force_el_n", "force_friction_n") if self.measured else {}
        forces = {name: course.at(time_ns, force_n) for name, force_n in truth.items()}
        return PlottedRun(
            names=(self.name,),
            time_s=np.asarray((time_ns - self.clock.zero_ns) * NS, dtype=np.float64),
            s_m=course.at(time_ns, course.s_m),
            speed_mps=course.at(time_ns, course.speed_mps),
            limit_mps=course.at(time_ns, self.limit_mps),
            force_el_n=forces.get("force_el_n"),
            force_friction_n=forces.get("force_friction_n"),
            energy_j=None if isinstance(drawn_j, DasError) else drawn_j,
            route=None if isinstance(self._inputs, DasError) else self._inputs.route,
        )

    @cached_property
    def silences(self) -> tuple[Span, ...]:
        """The times without advice."""
        return silences(self.recording, self.course)

    @cached_property
    def shown(self) -> ShownAdvice:
        """What the driver was shown."""
        return ShownAdvice.of(self.recording)

    @cached_property
    def stability(self) -> AdviceStability:
        """How stable the displayed advice was."""
        return recorded_stability(self.recording) if self.run is None else self.run.stability

    @cached_property
    def instructions(self) -> InstructionFigures:
        """How well the guide's instructions kept to their grammar."""
        return recorded_instructions(self.recording) if self.run is None else self.run.instructions

    @cached_property
    def events(self) -> tuple[DriveEvent, ...]:
        """Everything that happened, in order of time."""
        top_mps = math.inf if isinstance(self._inputs, DasError) else self._inputs.vehicle.max_speed_mps
        known = LineAndTrain(self.limit_mps, top_mps, self.zone)
        return events_of(self.recording, self.course, self.calls, self.silences, known)

    @cached_property
    def _any_attribution(self) -> Attribution | DasError:
        from sim.drive.attribution.attribution import attribution_of

        return _or_error(
            lambda: attribution_of(self.recording, self.inputs, self.compared, _raised(self._above), self.shown)
        )

    @property
    def any_attribution(self) -> Attribution:
        """Where the energy went, by cause and place, even if drive and optimum cannot be compared.

        Raises DasError for a recording without journey or positions, or whose line or train is not known.
        """
        return _raised(self._any_attribution)

    @property
    def known_attribution(self) -> Attribution:
        """Where the energy went, by cause and by place.

        Raises DasError as `any_attribution` does, and if drive and optimum cannot be compared. The optimum is then that
        of the true train, or of the planned train, by which the causes are told.
        """
        if not isinstance(self._above, DasError) and self._above.why_not:
            raise DasError(f"{self.recording.path}: {NOT_COMPARABLE}: {self._above.why_not}")
        found = self.any_attribution
        why_not = why_not_comparable(leg.section_energy for leg in found.legs)
        if why_not:
            raise DasError(f"{self.recording.path}: {NOT_COMPARABLE}: {why_not}")
        return found

    @property
    def attribution(self) -> Attribution | None:
        """Where the energy went; None if that is not known (see `why_no_attribution`)."""
        found = _or_error(lambda: self.known_attribution)
        return None if isinstance(found, DasError) else found

    @property
    def why_no_attribution(self) -> str:
        """Why it is not known where the energy went; empty if it is known."""
        found = _or_error(lambda: self.known_attribution)
        return self._told(found) if isinstance(found, DasError) else ""

    @cached_property
    def likely(self) -> LikelyRange | None:
        """The likely range of an estimated energy above the optimum; None if the energy is measured or not known.

        The bounds that a replay recorded are kept.
        """
        from sim.drive.attribution.driven_legs import likely_range

        if self.above is None or self.above.measured or self.not_comparable:
            return None
        found = likely_range(self.compared, self.smoothed)
        if found is None or self.above.likely is None:
            return found
        return replace(found, low_j=self.above.likely.low_j, high_j=self.above.likely.high_j)


def _or_error(find: Callable[[], _Found]) -> _Found | DasError:
    """What `find` returns, or the DasError that it raises, so that a cached property keeps either."""
    try:
        return find()
    except DasError as error:
        return error


def _raised(found: _Found | DasError) -> _Found:
    if isinstance(found, DasError):
        raise found
    return found
