"""The only place that decides whether there is advice, in a fixed order; the last word then checks each message."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from das.advice import wording
from das.advice.advice import OF_PROBLEM, Cause, Withdrawal
from das.advice.goal import AT_END_M, AT_STOP_M
from das.cab.leg import Leg
from das.estimate.estimate import Estimate
from das.estimate.plausibility import STANDSTILL_MPS

LOST_BEYOND_M: Final = 500.0
"""Largest distance (m) beyond the end of a section at which a train counts as past its stop, not as off the section."""


@dataclass(frozen=True, kw_only=True)
class Trust:
    """Reasons for the cab to distrust its messages on any leg; by default there are none."""

    two_publishers: str | None = None
    """The two publishers of the train's position; None if there is only one; empty if positions come without their
    sender's time stamp, so that two senders cannot be distinguished."""
    two_operators: str = ""
    """The two publishers that state different restrictions; empty if they agree."""
    unheeded: str | None = None
    """Why the restrictions received last cannot be used; None if they can."""
    two_nodes: str = ""
    """Name of another node that advises the train as well; empty if there is none."""
    restrictions_received: bool = True
    """Whether a list of restrictions was received, possibly an empty one."""
    journey_refused: str = ""
    """Why the last journey was refused; empty if it was not."""
    internal_error: str = ""
    """The unforeseen error that withdraws the next advice; empty if there is none."""


def decide(
    here: Estimate,
    trust: Trust,
    leg: Leg | None,
    *,
    no_plan: str = "",
    quiet: Cause = Cause.NONE,
) -> Withdrawal | None:
    """Why there is no advice; None if there is advice. The first of these causes that applies decides:

    1. two publishers of the position, or one that may be two; 2. two publishers that state different restrictions; 3.
    restrictions that cannot be used; 4. the journey was refused; 5. an internal error; 6. no journey; 7. no list of
    restrictions received; 8. the section cannot be driven; 9. the position: none, rejected, stale, ahead of the clock
    or uncertain; 10. the train is outside the section; 11. it moves up to the stop before its departure; 12. it has run
    past its stop; 13. no plan finishes the section from its state (`no_plan`: the planner's message); 14. another node
    advises the train as well; 15. the train stands where it has no stop, or the driver brakes against the advice
    (`quiet`: which of the two). The numbers of `Cause` rise in this order.
    """
    distrust = _distrust(trust)
    if distrust is not None:
        return distrust
    if leg is None or leg.goal.due_ns <= 0:
        return Withdrawal(Cause.NO_JOURNEY)
    if not trust.restrictions_received:
        return Withdrawal(Cause.RESTRICTIONS_UNTOLD)
    found = _of_leg(here, leg)
    if found is not None:
        return found
    if no_plan:
        return Withdrawal(Cause.NO_PLAN, no_plan)
    if trust.two_nodes:
        return Withdrawal(Cause.TWO_NODES, trust.two_nodes)
    return Withdrawal(quiet) if quiet else None


def _distrust(trust: Trust) -> Withdrawal | None:
    if trust.two_publishers is not None:
        return Withdrawal(Cause.TWO_PUBLISHERS, trust.two_publishers)
    if trust.two_operators:
        return Withdrawal(Cause.TWO_OPERATORS, trust.two_operators)
    if trust.unheeded is not None:
        return Withdrawal(Cause.RESTRICTIONS_UNHEEDED, trust.unheeded)
    if trust.journey_refused:
        return Withdrawal(Cause.JOURNEY_REFUSED, trust.journey_refused)
    if trust.internal_error:
        return Withdrawal(Cause.INTERNAL_ERROR, trust.internal_error)
    return None


def _of_leg(here: Estimate, leg: Leg) -> Withdrawal | None:
    if leg.refusal:
        return Withdrawal(Cause.SECTION_IMPOSSIBLE, leg.refusal)
    if here.problem is not None:
        return Withdrawal(OF_PROBLEM[here.problem.kind], wording.problem(here.problem))
    start_m, end_m = leg.section.start_m, leg.section.end_m
    if not start_m - AT_STOP_M <= here.s_m <= end_m + LOST_BEYOND_M:
        place = f"position {here.s_m:.0f} m is outside the section {start_m:.0f} … {end_m:.0f} m"
        return Withdrawal(Cause.OUTSIDE_SECTION, place)
    creeps = here.speed_mps >= STANDSTILL_MPS and here.s_m < start_m - AT_END_M
    if creeps and (leg.stood_short or here.time_ns < leg.goal.departure_ns):
        return Withdrawal(Cause.MOVING_UP)
    if here.s_m - end_m > AT_STOP_M:
        return Withdrawal(Cause.PAST_STOP, f"ran {here.s_m - end_m:.0f} m past the stop")
    return None
