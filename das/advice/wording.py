"""The texts of advice and withdrawals, for people. Programs must read the causes and modes, never these texts."""

from __future__ import annotations

from typing import Final, NamedTuple

from das.advice.advice import Cause, Withdrawal
from das.advice.goal import DEVIATION_NAMED_S, PassingTarget
from das.advice.regimes import Regime
from das.domain.units import KM, KMH, NS
from das.estimate.estimate import Problem, ProblemKind

RESTRICTIONS_UNTOLD: Final = (
    "no list of restrictions received yet (if there are none, start das-node with --no-restrictions)"
)

UNSTAMPED: Final = (
    "positions come without their sender's time stamp, or with one ahead of the clock: it cannot be told whether one "
    "or two publishers send them"
)


def withdrawal(why: Withdrawal) -> str:
    """The text on why there is no advice."""
    if why.problem is not None:
        return problem(why.problem)
    texts = {
        Cause.TWO_PUBLISHERS: f"two publishers of the position: {why.text}" if why.text else UNSTAMPED,
        Cause.TWO_OPERATORS: f"two publishers send different restrictions: {why.text}",
        Cause.RESTRICTIONS_UNHEEDED: f"restrictions cannot be applied: {why.text}",
        Cause.RESTRICTIONS_UNTOLD: RESTRICTIONS_UNTOLD,
        Cause.JOURNEY_REFUSED: f"journey refused: {why.text}",
        Cause.NO_JOURNEY: "no journey yet",
        Cause.OUTSIDE_SECTION: f"position {why.position_m:.0f} m is outside the section "
        f"{why.section_m[0]:.0f} … {why.section_m[1]:.0f} m",
        Cause.MOVING_UP: "moving up to the stop",
        Cause.TWO_NODES: f"another node advises this train as well: {why.text}",
        Cause.PAST_STOP: f"ran {why.position_m:.0f} m past the stop",
        Cause.STANDS_ON_LINE: "the train stands on the line",
        Cause.DRIVER_BRAKES: "the driver brakes against the advice",
    }
    return texts.get(why.cause, why.text)


def problem(what: Problem) -> str:
    """The text on what is wrong with a position."""
    kind, value = what
    texts = {
        ProblemKind.NO_POSITION: "no position yet",
        ProblemKind.MARKED_UNUSABLE: "the position is marked unusable",
        ProblemKind.NOT_A_NUMBER: "the position is not a number",
        ProblemKind.SPEED_IMPOSSIBLE: f"a speed of {value / KMH:.4g} km/h is impossible",
        ProblemKind.POSITION_IMPOSSIBLE: f"a position of {value:.4g} m is impossible",
        ProblemKind.TOO_UNCERTAIN: f"the position is too uncertain: {value:.4g} m",
        ProblemKind.UNCERTAINTY_IMPOSSIBLE: f"an uncertainty of {value:.4g} is impossible",
        ProblemKind.SPEED_JUMPED: f"the speed jumped by {value / KMH:.0f} km/h",
        ProblemKind.JUMPED: f"the position jumped by {value:.0f} m",
        ProblemKind.JUMPED_BACK: f"the position jumped back by {value:.0f} m",
        ProblemKind.FROZEN: f"the position is frozen at {value:.0f} m",
        ProblemKind.STALE: f"the position is {value:.1f} s old",
        ProblemKind.RARE: f"positions come only every {value:.1f} s",
        ProblemKind.AHEAD_OF_CLOCK: f"the position is {value:.1f} s ahead of the clock",
        ProblemKind.POSITION_UNCERTAIN: f"the position is uncertain by {value:.0f} m",
        ProblemKind.SPEED_UNCERTAIN: f"the speed is uncertain by {value / KMH:.0f} km/h",
    }
    return texts[kind]


def deviation(late_s: float) -> str:
    """The text on how late (> 0) or early (< 0) a train is (s)."""
    if abs(late_s) < 1.0:
        return "on time"
    return f"{abs(late_s):.0f} s {'late' if late_s > 0 else 'early'}"


def arrived(late_s: float) -> str:
    """The reason for a train that stands at its stop."""
    return f"arrived, {deviation(late_s)}"


def departs_in(seconds: float) -> str:
    """The reason for a train that waits for its departure."""
    return f"depart in {seconds:.0f} s"


def departs_when_cleared(then: str) -> str:
    """The reason for a standing train that is due to depart; `then` is the reason for what it does after departing."""
    return f"depart when cleared: {then}"


STOP_HERE: Final = "stop here"


NOTHING_TO_JUDGE_BY: Final = "no advice: position or speed unknown"


def brake_for(speed_mps: float, at_m: float, *, stops: bool) -> str:
    """The reason for a train that must brake at once, for a limit or for the stop."""
    return "brake for the stop" if stops else f"brake to {speed_mps / KMH:.0f} km/h by km {at_m / KM:.2f}"


def no_plan_too_fast(why: str) -> str:
    """The reason for a train that is too fast for any plan and must brake."""
    return f"too fast; no plan from here ({why})"


def too_fast(excess_mps: float) -> str:
    """The reason for a train that is faster than limits and the stop allow."""
    return f"{excess_mps / KMH:.0f} km/h too fast"


def meanwhile(why: str, *, follows_plan: bool) -> str:
    """The reason for advice without an optimum; `why` says why there is none (yet)."""
    how = "as before, no faster than is allowed now" if follows_plan else "the fastest safe run"
    return f"{why}: {how}"


def fastest(late_s: float) -> str:
    """The reason for a train that is as fast as possible but late."""
    return f"fastest, {deviation(late_s)}"


def least_energy(late_s: float) -> str:
    """The reason for a train that saves energy, with how late (s) it arrives."""
    return f"least energy, {deviation(late_s)}"


def wait_at(late_s: float, stop: str) -> str:
    """The reason for a train that arrives early and then waits at the stop."""
    return f"least energy, {deviation(late_s)}: wait at {stop}"


def on_time(operator_delay_s: float | None) -> str:
    """The reason for a train that arrives on time, with the delay (s) that the operator stated (None: no delay)."""
    late = operator_delay_s is not None and operator_delay_s >= 1
    return "least energy on time" + (f", operator says {deviation(operator_delay_s)}" if late else "")  # type: ignore[arg-type]


def wait_for_point(point: PassingTarget, now_ns: int) -> str:
    """The reason for a train with a point ahead that it must not pass before a time."""
    assert point.earliest_ns is not None
    return f"{_pass(point)} in {(point.earliest_ns - now_ns) * NS:.0f} s or later{_because(point)}"


def point_missed(point: PassingTarget, missed_s: float) -> str:
    """The reason for a train that passes a point `missed_s` after the end of its window."""
    return f"{_pass(point)} as soon as possible, {missed_s:.0f} s too late{_because(point)}"


def _pass(point: PassingTarget) -> str:
    return f"pass km {point.s_m / KM:.1f}"


def _because(point: PassingTarget) -> str:
    return f" ({point.reason})" if point.reason else ""


class Aim(NamedTuple):
    """What an instruction leads to: a speed (m/s; 0: a stop), where it is reached (m), and the name of the stop."""

    speed_mps: float
    at_m: float
    stop: str = ""


def instructed(mode: Regime, speed_mps: float, ahead: Aim | None, late_s: float) -> str:
    """The reason of a coach's instruction; `ahead` is the limit or stop that it leads to, None if none is near."""
    place = "" if ahead is None else f" for {_named(ahead)}"
    if mode is Regime.COAST:
        return f"coast{place}{_spare(late_s)}"
    if mode in (Regime.REDUCED_BRAKE, Regime.FULL_BRAKE, Regime.FRICTION_BRAKE):
        return f"brake{place}"
    if mode is Regime.CRUISE:
        return f"hold {speed_mps / KMH:.0f}{_spare(late_s)}"
    return f"accelerate to {speed_mps / KMH:.0f}{_spare(late_s)}"


def slow_for_point(point: PassingTarget, now_ns: int, clock: str) -> str:
    """The reason of the coach for a train that must not pass a point before a time; `clock` is that time of day."""
    why = f"{point.reason}: " if point.reason else ""
    seconds = (point.earliest_ns - now_ns) * NS if point.earliest_ns is not None else 0.0
    return f"slow: {why}km {point.s_m / KM:.1f} not before {clock}, in {seconds:.0f} s"


def _named(ahead: Aim) -> str:
    if ahead.speed_mps < 0.5 and ahead.stop:
        return ahead.stop
    return f"the {ahead.speed_mps / KMH:.0f} at km {ahead.at_m / KM:.1f}"


def _spare(late_s: float) -> str:
    """How early or late the train is; empty if it is nearly on time."""
    if late_s <= -DEVIATION_NAMED_S:
        return f", {-late_s:.0f} s spare"
    return f", {deviation(late_s)}" if late_s >= DEVIATION_NAMED_S else ""
