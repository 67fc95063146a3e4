"""What advice would have saved on a replayed trip: found before the replay, and recorded at its end."""

from __future__ import annotations

import math
from dataclasses import dataclass

from das.bus import das_pb2
from das.solver.solution import Fit, Solution
from sim.runs.replay.replay import ReplayJob
from sim.trips.estimate import EnergyRange, energy_range, estimate_run
from sim.trips.profile import to_profile
from sim.trips.saving import LikelySaving, likely_saving, saving_range, why_not_comparable
from sim.trips.sections import DrivenSection, driven_sections


@dataclass(frozen=True, kw_only=True, eq=False)
class TripSaving:
    """The energy of a trip as driven, and of the optimum with the same arrivals, section by section.

    `saved` is the saving in every case of the unknowns, None where trip and optimum cannot be compared; `why_not` says
    why.
    """

    sections: tuple[DrivenSection, ...]
    optima: tuple[Solution, ...]
    driven_j: tuple[float, ...]
    spread: EnergyRange
    saved: EnergyRange | None
    why_not: str

    @property
    def optimum_j(self) -> float:
        """Energy of the optimum (J)."""
        return math.fsum(one.ledger.input for one in self.optima)

    @property
    def whole_j(self) -> float:
        """Energy as driven (J)."""
        return math.fsum(self.driven_j)

    @property
    def late(self) -> bool:
        """Whether the train cannot drive a section in the time that it took."""
        return any(one.fit is Fit.LATE for one in self.optima)

    @property
    def likely(self) -> LikelySaving | None:
        """The likely range of the saving; None where it cannot be stated."""
        return None if self.saved is None else likely_saving(self.saved)


def trip_saving(job: ReplayJob) -> TripSaving:
    """What advice would have saved on the trip of a replay."""
    trip = job.trip
    sections = driven_sections(trip, job.front)
    optima = tuple(one.front.trajectory(one.trip_s) for one in sections)
    why_not = why_not_comparable(
        [(best, one.trip_s) for best, one in zip(optima, sections, strict=True)],
        whole=trip.whole,
        direction_known=trip.direction_known,
    )
    return TripSaving(
        sections=sections,
        optima=optima,
        driven_j=(job.driven.ledger.input,) if len(sections) == 1 else tuple(map(_driven_j, sections)),
        spread=energy_range(job.front.section, trip.matched),
        saved=None if why_not else saving_range(sections),
        why_not=why_not,
    )


def _driven_j(driven: DrivenSection) -> float:
    """Energy of a section as driven (J)."""
    run = to_profile(driven.matched)
    return estimate_run(driven.front.section, run.time_s, run.s_m, run.speed_mps).ledger.input


def saving_message(found: TripSaving, time_ns: int) -> das_pb2.Saving:
    """The saving as it is recorded."""
    saved, likely = found.saved, found.likely
    nan = math.nan
    return das_pb2.Saving(
        time_ns=time_ns,
        measured=False,
        comparable=saved is not None,
        driven_j=found.whole_j,
        optimum_j=found.optimum_j,
        likely_low_j=nan if likely is None else likely.low_j,
        likely_high_j=nan if likely is None else likely.high_j,
        worst_low_j=nan if saved is None else saved.low_j,
        worst_high_j=nan if saved is None else saved.high_j,
        sections=[
            das_pb2.Saving.Section(
                start=one.start,
                end=one.end,
                trip_s=one.trip_s,
                driven_j=driven_j,
                optimum_j=best.ledger.input,
                faster_than_possible=best.fit is Fit.LATE,
            )
            for one, best, driven_j in zip(found.sections, found.optima, found.driven_j, strict=True)
        ],
    )
