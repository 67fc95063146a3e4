"""The situation in which a section is planned: line, train, level, restrictions, and what differs from the files."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from das.domain.braking import USUAL, SiteBraking
from das.domain.conditions import Conditions
from das.domain.errors import DasError, RunawayError
from das.domain.levels import Level
from das.domain.restriction import Restriction
from das.domain.route import Route
from das.domain.vehicle import Vehicle
from das.solver.section import Section, SectionOptions, build_section, capped

AS_PLANNED = Conditions()
SAME_W = 1e-6
"""Difference (m²/s²) below which squares of speeds count as equal."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Situation:
    """The inputs of a front except the two ends of the section."""

    route: Route
    vehicle: Vehicle
    level: Level | None = None
    point_mass: bool = False
    restrictions: tuple[Restriction, ...] = ()
    conditions: Conditions = AS_PLANNED
    braking: SiteBraking = USUAL
    """Braking of the site's drivers."""

    def at(self, now_ns: int) -> Situation:
        """The situation at a moment (ns since 1970; 0: not known), with only the restrictions that count then.

        Their time windows are removed. If the time is unknown, all restrictions count.
        """
        counting = tuple(one.unlimited for one in self.restrictions if not now_ns or one.counts_at(now_ns))
        return self if counting == self.restrictions else replace(self, restrictions=counting)

    def between(self, start_m: float, end_m: float) -> Situation:
        """The situation with only the restrictions that the train meets between two positions (m).

        A restriction counts until the tail of the train has left it.
        """
        length_m = 0.0 if self.point_mass else self.vehicle.train_length_m
        met = (one for one in self.restrictions if one.is_under(start_m, end_m, length_m))
        return replace(self, restrictions=tuple(sorted(met)))

    def is_like(self, other: Situation) -> bool:
        """Whether both give the same sections."""
        return (
            self.route is other.route
            and self.vehicle is other.vehicle
            and (self.level, self.point_mass, self.restrictions, self.conditions, self.braking)
            == (other.level, other.point_mass, other.restrictions, other.conditions, other.braking)
        )

    def section(self, start_m: float, end_m: float) -> Section:
        """A section in this situation, planned with the service braking; raises as `build_section` does.

        Estimated mass and resistance may lower the braking curves but never raise them: if forces are measured too
        small, the train appears lighter and its brakes better than they are.
        """
        section = self._section(self.conditions, start_m, end_m)
        careful = replace(
            self.conditions,
            mass_ratio=max(self.conditions.mass_ratio, AS_PLANNED.mass_ratio),
            resistance_ratio=min(self.conditions.resistance_ratio, AS_PLANNED.resistance_ratio),
        )
        if careful == self.conditions:
            return section
        braked = self._section(careful, start_m, end_m)
        allowed_w, lower_w, guarded_w = (
            np.interp(section.node_m, braked.node_m, speeds_mps**2)
            for speeds_mps in (braked.allowed_mps, braked.envelope_mps, braked.guarded_mps)
        )
        bounded = capped(section, np.sqrt(lower_w))
        if np.any(bounded.envelope_mps**2 > allowed_w + SAME_W):
            raise DasError("a hill would have to be taken faster than the brakes of the train as planned allow")
        guarded = np.maximum(np.minimum(section.guarded_mps, np.sqrt(guarded_w)), bounded.envelope_mps)
        allowed = np.minimum(section.allowed_mps, np.sqrt(allowed_w))
        return replace(bounded, guarded_mps=guarded, allowed_mps=allowed)

    def section_ahead(self, start_m: float, end_m: float, s_m: float) -> Section:
        """A section for a train that has come as far as `s_m` (m); raises as `build_section` does.

        If the train has passed a descent on which its brakes would not hold it, the section begins after that descent.
        """
        while True:
            try:
                return self.section(start_m, end_m)
            except RunawayError as error:
                if not start_m < error.held_from_m < end_m or error.held_from_m > s_m:
                    raise
                start_m = error.held_from_m

    def _section(self, conditions: Conditions, start_m: float, end_m: float) -> Section:
        return build_section(
            conditions.line(self.route.with_restrictions(self.restrictions)),
            conditions.train(self.vehicle),
            level=self.level,
            start_m=start_m,
            end_m=end_m,
            options=SectionOptions(point_mass=self.point_mass, braking=self.braking.of(self.vehicle)),
        )


def difference(before: Situation, after: Situation) -> str:
    """The first difference between two situations, in words."""
    if before.vehicle is not after.vehicle:
        return "another train or load"
    if before.level != after.level:
        return "another level"
    if before.restrictions != after.restrictions:
        gone = len(set(before.restrictions) - set(after.restrictions))
        lifted = gone and len(after.restrictions) < len(before.restrictions)
        return "restriction lifted" if lifted else "restriction set"
    now = after.conditions
    return f"mass × {now.mass_ratio:.2f} and resistance × {now.resistance_ratio:.2f} of the plan's"
