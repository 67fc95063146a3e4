"""The energy of a drive: the energy taken, its excess over the optimum, and this excess by place and cause."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, TypeVar

from das.domain.errors import DasError
from sim.drive.above_optimum import (
    NOT_COMPARABLE,
    SAID_BY_THE_RECORDING,
    AboveOptimum,
    SectionEnergy,
    why_not_comparable,
)
from sim.drive.attribution import Attribution, attribution_of
from sim.drive.calls import KeptCall
from sim.drive.causes import ShownAdvice
from sim.drive.legs import (
    ComparedLeg,
    DrivenLeg,
    DrivenMotion,
    LegEnergies,
    LikelyRange,
    Smoothed,
    beside_optima,
    leg_energies,
    legs_of_drive,
    likely_range,
    motion_of,
    section_of_leg,
    smoothed_motions,
)
from sim.drive.table import DriveTable

MOST_LEGS: Final = 3
"""Largest number of legs for which a report computes the likely range: each is solved twice for every unknown."""

_Found = TypeVar("_Found")


@dataclass(frozen=True, kw_only=True, eq=False)
class DriveEnergy:
    """The energy of a drive, leg by leg; `made` are the stops of its journey as served.

    Each figure is computed when it is first needed, because most of them solve the sections of the drive.
    """

    table: DriveTable
    made: tuple[KeptCall, ...]

    @cached_property
    def motion(self) -> DrivenMotion:
        """The motion, with its energy if that was measured; DasError if the motion is not known."""
        return motion_of(self.table)

    @cached_property
    def legs(self) -> tuple[DrivenLeg, ...]:
        """The motion between the stops that were served; DasError if the train served fewer than two.

        Stops of a replayed trip count even if its journey does not name them. If the replay compared a part between
        equal speeds, the legs cover that part.
        """
        return legs_of_drive(self.table, self.made, self.motion)

    @property
    def smoothed(self) -> Smoothed | None:
        """A function that returns the legs under another smoothing of the positions; None without usable positions."""
        motions = or_error(lambda: smoothed_motions(self.table))
        if isinstance(motions, DasError):
            return None
        return lambda jerk: legs_of_drive(self.table, self.made, motions(jerk))

    @cached_property
    def of_legs(self) -> tuple[LegEnergies, ...]:
        """The energies of each leg; DasError if fewer than two stops were served, or line or train are not known."""
        return tuple(leg_energies(section_of_leg(self.table.inputs, leg), leg) for leg in self.legs)

    @cached_property
    def compared(self) -> tuple[ComparedLeg, ...]:
        """The legs with the planned train's optimum; DasError as for `of_legs`."""
        return beside_optima(self.table.inputs, self.legs)

    @cached_property
    def driven_j(self) -> float | None:
        """Energy at the current collector (J), from each departure to the next arrival; None if not known.

        It is an estimate unless `measured`. If fewer than two stops were served, it is all the energy measured, or the
        energy of the part that a replay estimated.
        """
        if self._of_true_train is not None:
            return self._of_true_train.driven_j
        found = or_error(lambda: self.legs)
        if self.measured:
            motions = [self.motion] if isinstance(found, DasError) else [leg.motion for leg in found]
            return math.fsum(one.drawn_j for one in motions)
        energies = found if isinstance(found, DasError) else or_error(lambda: self.of_legs)
        if isinstance(energies, DasError):
            return None if self.table.said.saving is None else self.table.said.saving.driven_j
        return math.fsum(one.driven_j for one in energies)

    @property
    def measured(self) -> bool:
        """Whether a simulator measured the energy; otherwise it is estimated from positions."""
        motion = or_error(lambda: self.motion)
        return not isinstance(motion, DasError) and motion.input_j is not None

    @cached_property
    def _of_true_train(self) -> AboveOptimum | None:
        """The energy above the true train's optimum, which only a simulator can record; None if none was recorded.

        For a part of a recording, only the sections in it are included.
        """
        said = self.table.said.saving
        if said is None or not said.measured:
            return None
        legs = or_error(lambda: self.legs)
        held = () if isinstance(legs, DasError) else [(one.start.name, one.end.name) for one in legs]
        sections = tuple(one for one in said.sections if (one.start, one.end) in held)
        return replace(said, sections=sections) if sections else said

    @cached_property
    def _above(self) -> AboveOptimum | DasError:
        if self._of_true_train is not None:
            return self._of_true_train
        found = or_error(lambda: self._beside_planned([one.section_energy for one in self.compared]))
        said = self.table.said.saving
        return found if said is None or not isinstance(found, DasError) else said

    def _beside_planned(self, sections: list[SectionEnergy]) -> AboveOptimum:
        """The energy above the planned train's optimum; a replay adds its certainty and facts about the trip."""
        above, said = AboveOptimum.of(sections, measured=self.measured), self.table.said.saving
        if said is None or said.measured:
            return above
        known = said.why_not if said.why_not != SAID_BY_THE_RECORDING else above.why_not or said.why_not
        return replace(above, why_not=known or above.why_not, likely=said.likely)

    @property
    def above(self) -> AboveOptimum | None:
        """The energy above the optimum: of the true train for a simulated run, else of the planned train; None if it is
        not known, for the reason `not_comparable`."""
        return None if isinstance(self._above, DasError) else self._above

    @property
    def not_comparable(self) -> str:
        """The reason why the drive cannot be compared with its optimum; empty if it can."""
        if not isinstance(self._above, DasError):
            return self._above.why_not
        return self._told(self._above).removeprefix(f"{NOT_COMPARABLE}: ")

    def _told(self, error: DasError) -> str:
        return str(error).removeprefix(f"{self.table.recording.path}: ")

    @cached_property
    def motors_first(self) -> AboveOptimum:
        """The energy above the optimum if the planned train had driven this motion, and its motors had braked first.

        This energy makes drives with different brakes comparable. Raises DasError as `of_legs` does.
        """
        return replace(self._beside_planned([one.motors_first for one in self.compared]), likely=None)

    @cached_property
    def shown(self) -> ShownAdvice:
        """The advice that the driver was shown."""
        return ShownAdvice.of(self.table)

    @cached_property
    def _any_attribution(self) -> Attribution | DasError:
        def found() -> Attribution:
            _ = self.table.inputs  # without line or train, the error here is the reason
            return attribution_of(self.table, self.compared, _raised(self._above), self.shown)

        return or_error(found)

    @property
    def any_attribution(self) -> Attribution:
        """The energy attribution by cause and place, even if drive and optimum cannot be compared.

        Raises DasError for a recording without journey or positions, or whose line or train is not known.
        """
        return _raised(self._any_attribution)

    @property
    def known_attribution(self) -> Attribution:
        """The energy attribution by cause and by place.

        Raises DasError as `any_attribution` does, and if drive and optimum cannot be compared. The optimum is the true
        train's, else the planned train's; the causes are found with the planned train.
        """
        path = self.table.recording.path
        if not isinstance(self._above, DasError) and self._above.why_not:
            raise DasError(f"{path}: {NOT_COMPARABLE}: {self._above.why_not}")
        found = self.any_attribution
        why_not = why_not_comparable(leg.section_energy for leg in found.legs)
        if why_not:
            raise DasError(f"{path}: {NOT_COMPARABLE}: {why_not}")
        return found

    @property
    def attribution(self) -> Attribution | None:
        """The energy attribution; None if there is none (see `why_no_attribution`)."""
        found = or_error(lambda: self.known_attribution)
        return None if isinstance(found, DasError) else found

    @property
    def why_no_attribution(self) -> str:
        """The reason why there is no energy attribution; empty if there is one."""
        found = or_error(lambda: self.known_attribution)
        return self._told(found) if isinstance(found, DasError) else ""

    @cached_property
    def likely(self) -> LikelyRange | None:
        """The likely range of an estimated energy above the optimum.

        None if the energy is measured or not known, and for more than `MOST_LEGS` legs.
        """
        if self.above is None or self.above.measured or self.not_comparable or len(self.compared) > MOST_LEGS:
            return None
        return likely_range(self.compared, self.smoothed)


def or_error(find: Callable[[], _Found]) -> _Found | DasError:
    """The result of `find`, or the DasError that it raises, so that a cached property keeps either."""
    try:
        return find()
    except DasError as error:
        return error


def _raised(found: _Found | DasError) -> _Found:
    if isinstance(found, DasError):
        raise found
    return found
