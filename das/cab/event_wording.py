"""Texts of the cab's events that consist of several parts. No program depends on them.

The words of advice and of withdrawals are in `das.advice.wording`; events with the same content use those.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime, tzinfo
from typing import Final

from das.advice import wording
from das.advice.advice import Cause, Withdrawal
from das.cab.heard import Kind, Target
from das.domain.restriction import LONGEST_TEXT, Restriction
from das.domain.units import KM, NS
from das.estimate.ratios import ForceDoubt

MOST_NAMED = 3
"""Largest number of accepted targets that are named."""

# --- messages that are ignored ---------------------------------------------------------------------------------------


def ignored(kind: Kind, what: str) -> str:
    """A message that the guard rejected; `what` describes it by its fault."""
    return about(kind, f"{what} was ignored")


def about(kind: Kind, what: str) -> str:
    """A text about messages of one kind."""
    return f"{kind}: {what}"


def restrictions_unheeded(why: str) -> str:
    """Restrictions that were not accepted; there is therefore no advice."""
    return wording.withdrawal(Withdrawal(Cause.RESTRICTIONS_UNHEEDED, why))


def impossible_restriction(one: Restriction) -> str:
    """A restriction with impossible ends, limit or window, or with an implausibly long text."""
    window = f", valid from {one.valid_from_ns} to {one.valid_until_ns} ns" if one.has_window else ""
    long = "".join(f", {key} of {len(x)} letters" for key, x in one.texts.items() if len(x) > LONGEST_TEXT)
    return f"one of {one.limit_mps:g} m/s from {one.start_m:g} to {one.end_m:g} m{window}{long}"


def off_route(received: Sequence[Restriction], length_m: float) -> str:
    """Restrictions wholly off a route of this length: their sender may have another zero point. Empty if none."""
    astray = [one for one in received if one.end_m <= 0 or one.start_m >= length_m]
    if not astray:
        return ""
    more = f" and {len(astray) - 1} more" if len(astray) > 1 else ""
    return about(
        Kind.RESTRICTION, f"{impossible_restriction(astray[0])}{more} is off the route (0 to {length_m:.0f} m)"
    )


# --- publishers ------------------------------------------------------------------------------------------------------


NOT_STAMPED: Final = "one without its sender's time stamp (or with one ahead of the clock)"


def unstamped(kind: Kind) -> str:
    """A state without its sender's time stamp, and the remedy for its publisher."""
    return f"{ignored(kind, NOT_STAMPED)}: {wording.STAMP_CURE}"


def no_token(kind: Kind, source: str | None) -> str:
    """A publisher of a state without a liveliness token, and the remedy."""
    return about(
        kind,
        f"{_named(source)} has no liveliness token: nobody can tell when it is gone, and a newer order of another "
        "publisher replaces its own; publish with das.bus.session.Bus, or with zenoh.ext.declare_advanced_publisher "
        "and publisher_detection=True",
    )


def two_operators(source: str | None, rival: str, *, one_is_gone: bool) -> str:
    """The two publishers that state different restrictions, and the remedy if one of them has disconnected."""
    cure = "; one of them is gone, the other has to send its list again" if one_is_gone else ""
    return f"{_named(source)} and {_named(rival)}{cure}"


def takes_over(kind: Kind, source: str | None, before: str, *, overtaken: bool) -> str:
    """A publisher that is used now that the previous one has disconnected. `overtaken`: that one may still be
    connected, but it has no liveliness token and this order is newer.
    """
    why = "has no liveliness token and its order is older" if overtaken else "is gone"
    return about(kind, f"{_named(source)} counts from now on, {_named(before)} {why}")


def not_heeded(kind: Kind, source: str, before: str | None) -> str:
    """A publisher that is ignored while the previous one is connected."""
    return about(kind, f"two publishers: what {_named(source)} says is not heeded while {_named(before)} is there")


def _named(source: str | None) -> str:
    """The name of a session; words for one without a name."""
    return source or "one without a name"


# --- the journey -----------------------------------------------------------------------------------------------------


def journey_refused(why: str) -> str:
    """A journey that was not accepted; there is therefore no advice."""
    return wording.withdrawal(Withdrawal(Cause.JOURNEY_REFUSED, why))


def other_direction(*, ordered_reverse: bool, own_reverse: bool) -> str:
    """A journey in the other direction of the route."""
    way = ("forwards", "in reverse")
    return f"it drives the route {way[ordered_reverse]}, this node has it {way[own_reverse]}"


def other_day(departure_ns: int, now_ns: int) -> str:
    """A journey of another day than that of the clock."""
    departs, now = (f"{datetime.fromtimestamp(at_ns * NS, UTC):%Y-%m-%d %H:%M} UTC" for at_ns in (departure_ns, now_ns))
    return f"it departs on {departs}, more than a day from the node's clock ({now})"


# --- targets of traffic management -----------------------------------------------------------------------------------


def targets(accepted: Sequence[Target], zone: tzinfo = UTC) -> str:
    """The targets that apply from now on, with times of day in a time zone; the first few are named."""
    more = [f"{len(accepted) - MOST_NAMED} more"] if len(accepted) > MOST_NAMED else []
    return "targets: " + ("; ".join([*(_target(one, zone) for one in accepted[:MOST_NAMED]), *more]) or "none any more")


def _target(target: Target, zone: tzinfo) -> str:
    words = (("at", target.arrival_ns), ("not before", target.earliest_ns), ("not after", target.latest_ns))
    times = (f"{word} {datetime.fromtimestamp(at_ns * NS, zone):%H:%M:%S}" for word, at_ns in words if at_ns > 0)
    why = f" ({target.reason})" if target.reason else ""
    return " ".join([target.stop or f"km {target.s_m / KM:.1f}", *times]) + why


# --- calibration -----------------------------------------------------------------------------------------------------

_FORCE_DOUBTS: Final = {
    ForceDoubt.TWO_PUBLISHERS: "two publishers of the efforts",
    ForceDoubt.CLOCKS: "the clocks of efforts and positions differ",
    ForceDoubt.TOO_STRONG: "the measured forces are above those that the train has",
    ForceDoubt.COASTING: "a coasting train moves otherwise than the measured forces say",
    ForceDoubt.GAIN: "mass and resistance are off by the same factor, as a wrong gain of the force sensor makes them",
}


def calibration_off(doubt: ForceDoubt) -> str:
    """Measured forces that are not trusted and not used in plans."""
    return f"calibration off: {_FORCE_DOUBTS[doubt]}"


def far_mass(ratio: float) -> str:
    """An estimated mass that is used, but differs suspiciously from the planned one."""
    return (
        f"calibration: the mass found is {ratio:.2f} of the file's: either another train than planned runs, or "
        "the force sensor is wrong"
    )


CALIBRATION_ON: Final = "calibration on again: nothing speaks against the measured forces any more"


# --- advice, position and faults -------------------------------------------------------------------------------------


def clocks_differ(off_s: float) -> str:
    """Time stamps of positions that differ from the clock here (> 0: they are behind, or come late)."""
    what = "are heard late, or their clock is behind:" if off_s > 0 else "are ahead of the clock:"
    return f"position: its time stamps {what} {abs(off_s):.1f} s; the train may be anywhere on the way of that time"


def clock_set(step_s: float) -> str:
    """The clock of the node was set (> 0: forward)."""
    way = "forward" if step_s > 0 else "back"
    return f"the clock was set {way} by {abs(step_s):.1f} s; until the next position, the train may be as far off"
