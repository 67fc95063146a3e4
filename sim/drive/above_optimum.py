"""The energy of a drive above its optimum, its certainty, and whether drive and optimum are comparable.

Above the optimum = energy driven − least energy of the same train for the same departures and arrivals, in % of that
optimum. It is not an achievable saving, because no one drove the optimum. Runs, replays, reports and recordings all use
this module, and the same words if the energy cannot be stated.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

from das.bus import das_pb2, topics
from das.bus.recording import Recording
from das.domain.units import KM, KMH, kwh, kwh_figure, kwh_words

if TYPE_CHECKING:
    from das.solver.solution import Solution

NOT_COMPARABLE: Final = "not comparable"
"""Text that every command prints if it cannot state the energy above the optimum."""
SAID_BY_THE_RECORDING: Final = "according to the recording, its trip and the optimum cannot be compared"
"""Reason given for a recording that is older than `Saving.not_comparable`."""
NOT_WHOLE: Final = "the trip does not run from standstill to standstill at the stops"
"""Reason given for a drive without a departure from one stop and an arrival at another."""
NO_PART: Final = f"{NOT_WHOLE}, nor does it have equal speeds 1 km apart"
"""Reason given for a trip that does not stand at both its stops and has no part that can be compared."""
IMPOSSIBLE_RATIO: Final = 0.05
"""Largest share of the time with more force than the assumed train has; above it, another train made the trip."""
RECORDED: Final = ("start", "end", "trip_s", "driven_j", "optimum_j")
"""The figures of a section that a recording states under the same names."""
_PASSING: Final = re.compile(r"km \d+\.\d at \d+ km/h")
"""The name of an end of a part between equal speeds."""


def passing_name(s_m: float, speed_mps: float) -> str:
    """The name of an end that is not a stop: its position on the route as driven, and the train's speed there."""
    return f"km {s_m / KM:.1f} at {speed_mps / KMH:.0f} km/h"


def part_between(start: str, end: str) -> str:
    """Words for the part of a trip between two ends with these names; empty if both are stops."""
    return f"{start} to {end}" if any(_PASSING.fullmatch(one) for one in (start, end)) else ""


class EnergyBand(NamedTuple):
    """The lower and the upper bound of an energy (J)."""

    low_j: float
    high_j: float

    @property
    def words(self) -> str:
        """The band in kWh, for tables."""
        return f"{kwh_figure(self.low_j, finer=-1)} to {kwh_words(self.high_j, finer=-1)}"


@dataclass(frozen=True, kw_only=True)
class SectionEnergy:
    """The energy of a section as driven, and the least energy of the same train in the same time (J).

    `late_s` is how much longer the fastest trajectory of the assumed train takes than the drive took (s): 0 if that
    train can drive as fast, NaN if it cannot and the recording does not state by how much. `beyond_s` is the time (s)
    in which the drive needed more force than that train has.
    """

    start: str
    end: str
    trip_s: float
    driven_j: float
    optimum_j: float
    late_s: float = 0.0
    beyond_s: float = 0.0

    @classmethod
    def of(cls, start: str, end: str, driven_j: float, best: Solution) -> SectionEnergy:
        """The energies of a section from the energy driven (J) and the optimum for the time that it took."""
        from das.solver.solution import Fit  # imports the solver, which reading a recording does not need

        return cls(
            start=start,
            end=end,
            trip_s=best.requested_s,
            driven_j=driven_j,
            optimum_j=best.balance.input,
            late_s=best.time_s - best.requested_s if best.fit is Fit.LATE else 0.0,
        )

    @property
    def too_fast(self) -> bool:
        """Whether the assumed train cannot drive the section that fast; its fastest trajectory is then the optimum."""
        return self.late_s != 0.0


@dataclass(frozen=True, kw_only=True)
class AboveOptimum:
    """The energies of a drive and of its optimum, section by section.

    `measured`: the energy was measured; otherwise it is estimated from positions. `why_not` is the reason why drive and
    optimum cannot be compared; it is empty if they can. If the energy is estimated, `likely` is the band in which the
    energy above the optimum probably lies.
    """

    sections: tuple[SectionEnergy, ...]
    measured: bool
    why_not: str = ""
    likely: EnergyBand | None = None

    @classmethod
    def of(cls, sections: Iterable[SectionEnergy], *, measured: bool, direction_known: bool = True) -> AboveOptimum:
        """The energies of these sections, with the reason why they cannot be compared, if there is one."""
        sections = tuple(sections)
        why_not = why_not_comparable(sections, direction_known=direction_known)
        return cls(sections=sections, measured=measured, why_not=why_not)

    @classmethod
    def recorded(cls, recording: Recording) -> AboveOptimum | None:
        """The energies stated at the end of a recording; None if there are none, as in a recording of a node alone."""
        for entry in recording.of(topics.SAVING)[-1:]:
            found = entry.message
            band = EnergyBand(found.likely_low_j, found.likely_high_j)
            return cls(
                sections=tuple(
                    SectionEnergy(
                        **{name: getattr(one, name) for name in RECORDED},
                        late_s=math.nan if one.faster_than_possible else 0.0,
                    )
                    for one in found.sections
                ),
                measured=found.measured,
                why_not="" if found.comparable else found.not_comparable or SAID_BY_THE_RECORDING,
                likely=None if math.isnan(band.low_j + band.high_j) else band,
            )
        return None

    @property
    def driven_j(self) -> float:
        """Energy as driven, from departures to arrivals (J)."""
        return math.fsum(one.driven_j for one in self.sections)

    @property
    def optimum_j(self) -> float:
        """Least energy of the same train for the same departures and arrivals (J)."""
        return math.fsum(one.optimum_j for one in self.sections)

    @property
    def difference_j(self) -> float:
        """Energy as driven minus the optimum's (J), even if the two cannot be compared."""
        return self.driven_j - self.optimum_j

    @property
    def above_j(self) -> float | None:
        """Energy above the optimum (J); None if the two cannot be compared."""
        return None if self.why_not else self.difference_j

    @property
    def ratio(self) -> float | None:
        """Energy above the optimum as a share of the optimum; None if that cannot be stated.

        The optimum does not depend on the driver, so a kWh is the same share for every driver.
        """
        above_j, optimum_j = self.above_j, self.optimum_j
        return above_j / optimum_j if above_j is not None and optimum_j > 0 else None

    @property
    def part(self) -> str:
        """Words for the part of a trip that was compared; empty if it ran from a standstill at a stop to another."""
        return part_between(self.sections[0].start, self.sections[-1].end) if self.sections else ""

    @property
    def too_fast(self) -> bool:
        """Whether a section was driven faster than the assumed train can drive it."""
        return any(one.too_fast for one in self.sections)

    @property
    def words(self) -> str:
        """The energy above the optimum in kWh and in % of the optimum, or `NOT_COMPARABLE`."""
        above_j = self.above_j
        return NOT_COMPARABLE if above_j is None else energy_words(above_j, self.ratio)

    def as_dict(self) -> dict[str, float | str | None]:
        """The figures by their names in the JSON of every command: kWh, and the share of the optimum."""
        above_j = self.above_j
        return {
            "energy_kwh": kwh(self.driven_j),
            "energy_optimum_kwh": kwh(self.optimum_j),
            "above_optimum_kwh": known_kwh(above_j),
            "above_optimum_ratio": self.ratio,
            "not_comparable": self.why_not or None,
        }

    def rows(self) -> list[tuple[str, str]]:
        """Names and texts for a table: the energy above the optimum, its band, and this energy for each section."""
        name = "above the optimum" if self.measured else "above the optimum (estimated)"
        if self.why_not:
            return [(name, f"{NOT_COMPARABLE}: {self.why_not}")]
        rows = [(name, self.words)]
        if self.part:
            rows.append((f"{name}, compared part", self.part))
        if not self.measured:
            rows.append((f"{name}, likely", "not known" if self.likely is None else self.likely.words))
        for one in self.sections if len(self.sections) > 1 else ():
            words = f"{kwh_figure(one.driven_j - one.optimum_j, signed=True)} of {kwh_words(one.driven_j)}"
            rows.append((f"{name}, {one.start} – {one.end}", words))
        return rows

    def message(self, time_ns: int) -> das_pb2.Saving:
        """The message that is recorded at the end of a drive; the band of a measured drive has no width."""
        point_j = self.difference_j if self.measured else math.nan
        likely = self.likely or EnergyBand(point_j, point_j)
        return das_pb2.Saving(
            time_ns=time_ns,
            measured=self.measured,
            comparable=not self.why_not,
            not_comparable=self.why_not,
            driven_j=self.driven_j,
            optimum_j=self.optimum_j,
            likely_low_j=likely.low_j,
            likely_high_j=likely.high_j,
            sections=[
                das_pb2.Saving.Section(
                    **{name: getattr(one, name) for name in RECORDED}, faster_than_possible=one.too_fast
                )
                for one in self.sections
            ],
        )


def known_kwh(energy_j: float | None) -> float | None:
    """An energy (J) in kWh; None, which stands for one that is not known, stays None."""
    return None if energy_j is None else kwh(energy_j)


def energy_words(energy_j: float, ratio: float | None) -> str:
    """An energy above the optimum, or one that advice saved, in kWh and in % of the optimum (None: not known)."""
    return kwh_words(energy_j, signed=True) + ("" if ratio is None else f" ({percent_of_optimum(ratio)})")


def percent_of_optimum(ratio: float) -> str:
    """A share of the optimum in words, "4.8 % of the optimum"."""
    return f"{100 * ratio:.1f} % of the optimum"


def why_not_comparable(sections: Iterable[SectionEnergy], *, direction_known: bool = True) -> str:
    """The reason why the sections of a drive cannot be compared with their optima; empty if they can.

    They cannot if the drive was faster than the assumed train can be, needed more force than it has for more than
    `IMPOSSIBLE_RATIO` of the time, or ran in an unknown direction.
    """
    sections = tuple(sections)
    late_s = [one.late_s for one in sections if one.too_fast]
    if late_s:
        by_s = math.fsum(late_s)
        return f"this train cannot arrive as early as the trip did: the optimum is its fastest run, {by_s:.1f} s later"
    beyond_s, trip_s = math.fsum(one.beyond_s for one in sections), math.fsum(one.trip_s for one in sections)
    if beyond_s > IMPOSSIBLE_RATIO * trip_s:
        return f"in {100 * beyond_s / trip_s:.0f} % of the time the trip needs more force than this train has"
    return "" if direction_known else "the direction of the trip is not known"
