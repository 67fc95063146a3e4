"""References of few phases on a flat line, and the scenes of the guide on them."""

from __future__ import annotations

import math

import numpy as np

from das.advice.advice import Replan, ReplanCause
from das.advice.braking import BrakingAhead
from das.advice.goal import SpeedsAllowed, TrainState
from das.advice.guide.guard import Sight
from das.advice.guide.keeping import Kept, StandingReference
from das.advice.guide.timeline import timeline
from das.domain.restriction import Restriction
from das.domain.units import KMH
from das.solver.guide.schedule import Phase, PhaseKind, Schedule, settled
from das.solver.section import Section, build_section
from tests.support.bundled_sections import BUNDLED, section_of
from tests.support.keeping import ns

FREE = SpeedsAllowed(math.inf, math.inf)
KINDS = {"T": PhaseKind.TRACTION, "H": PhaseKind.HOLD, "C": PhaseKind.COAST, "B": PhaseKind.BRAKE}


def flat(*limits: tuple[float, float, float]) -> Section:
    """A flat section of 6 km, with limits (from and to in m, km/h)."""
    section = section_of(BUNDLED[0])
    if not limits:
        return section
    boards = tuple(Restriction(start_m=start, end_m=end, limit_mps=kmh * KMH) for start, end, kmh in limits)
    return build_section(section.route.with_restrictions(boards), section.vehicle)


def reference(
    *phases: tuple[str, float, float, float], section: Section | None = None, at_kmh: float = 0.0
) -> Schedule:
    """A schedule of these phases (kind, share, from in m, to km/h), driven from a speed at the start."""
    section = section or flat()
    made = tuple(
        Phase(KINDS[kind], share, int(np.searchsorted(section.node_m, at_m)), kmh * KMH)
        for kind, share, at_m, kmh in phases
    )
    return settled(section, made, section.start_m, at_kmh * KMH)[0]


def kept(schedule: Schedule, state: TrainState, replan: Replan | None = None) -> Kept:
    """The reference with the forecast of a train in a state."""
    standing = StandingReference(
        schedule=schedule, lambda_w=1e6, arrival_ns=ns(400), point=None,
        replan=replan or Replan(cause=ReplanCause.NONE),
    )  # fmt: skip
    return Kept(standing, schedule.forecast(state.s_m, state.v_mps), 0.0)


def scene(schedule: Schedule, s_m: float, kmh: float, place: SpeedsAllowed = FREE, second: float = 100.0) -> Sight:
    """The guide's input for a train at a position and speed."""
    state = TrainState(ns(second), s_m, kmh * KMH)
    foreseen = schedule.forecast(state.s_m, state.v_mps)
    return Sight(schedule, timeline(schedule), foreseen, state, place, BrakingAhead(schedule.section))
