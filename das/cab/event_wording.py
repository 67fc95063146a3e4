"""The texts of the cab's events, and of the refusals and faults that events repeat. No program depends on them.

The words of advice and of withdrawals are in `das.advice.wording`; an event that says the same takes them from there.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import UTC, datetime, tzinfo
from typing import Final

from das.advice import wording
from das.advice.advice import Cause, Withdrawal
from das.advice.regimes import Regime
from das.cab.heard import Kind, Target
from das.domain.conditions import Conditions
from das.domain.levels import Level
from das.domain.restriction import LONGEST_TEXT, Restriction
from das.domain.units import KM, NS
from das.estimate.estimate import Problem
from das.estimate.ratios import ForceDoubt

MOST_NAMED = 3
"""At most this many of the accepted targets are named."""

# --- messages that are ignored ---------------------------------------------------------------------------------------


def ignored(kind: Kind, what: str) -> str:
    """A message that the guard rejected; `what` names it by its fault."""
    return about(kind, f"{what} was ignored")


def about(kind: Kind, what: str) -> str:
    """Something that concerns messages of one kind."""
    return f"{kind}: {what}"


def failed(error: Exception) -> str:
    """A message whose figures the program could not compute with."""
    return f"a message was ignored ({error})"


def restrictions_unheeded(why: str) -> str:
    """Restrictions that were not taken over, so that there is no advice either."""
    return wording.withdrawal(Withdrawal(Cause.RESTRICTIONS_UNHEEDED, why))


def suppressed(count: int) -> str:
    """Complaints that were held back because there were too many."""
    return f"{count} more messages were ignored"


def dropped(count: int) -> str:
    """Messages that were lost in a flood."""
    return f"{count} messages were dropped: too many at once"


# --- faults of a message ---------------------------------------------------------------------------------------------

NOT_OF_ITS_KIND: Final = "a message that cannot be read"


def unreadable(error: Exception) -> str:
    """A message of the right type with an impossible value."""
    return f"one that cannot be read ({error})"


def ahead_of_clock(ahead_s: float) -> str:
    """A message that states a time too far ahead."""
    return f"one from {ahead_s:.0f} s ahead of the clock"


def older_than_last(behind_s: float) -> str:
    """A message that is older than the one that holds."""
    return f"one {behind_s:.0f} s older than the last"


def older_and_different(older: str) -> str:
    """An older list of restrictions that is not the one in force; `older`: the words of `older_than_last`."""
    return f"{older}, which said otherwise"


def too_many_restrictions(count: int, most: int) -> str:
    """A list of restrictions that is too long to make sense."""
    return f"{count} of them, more than {most}"


def too_many(count: int, what: str, most: int) -> str:
    """A message with more targets or stops than make sense; `what` names them."""
    return f"one of {count} {what}, more than {most}"


def name_too_long(letters: int) -> str:
    """A message with a name that is too long to make sense."""
    return f"one with a name of {letters} letters"


def impossible_restriction(one: Restriction) -> str:
    """A restriction with impossible ends, limit or window, or with a text that is too long to make sense."""
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
    """A state without its sender's time stamp, and what its publisher has to do."""
    return f"{ignored(kind, NOT_STAMPED)}: {wording.STAMP_CURE}"


def no_token(kind: Kind, source: str | None) -> str:
    """A publisher of a state without a liveliness token, and what it has to do."""
    return about(
        kind,
        f"{_named(source)} has no liveliness token: nobody can tell when it is gone, and a newer order of another "
        "publisher replaces its own; publish with das.bus.session.Bus, or with zenoh.ext.declare_advanced_publisher "
        "and publisher_detection=True",
    )


def second_publisher(source: str) -> str:
    """A measurement from another publisher than the one that counts."""
    return f"one of a second publisher ({source or 'unnamed'})"


def two_publishers(source: str | None, rival: str) -> str:
    """The two publishers that both state the position of the train."""
    return f"{source or 'unnamed'} and {rival}"


def two_operators(source: str | None, rival: str, *, one_is_gone: bool) -> str:
    """The two publishers that state different restrictions, and what has to be done if one of them is gone."""
    cure = "; one of them is gone, the other has to send its list again" if one_is_gone else ""
    return f"{_named(source)} and {_named(rival)}{cure}"


def takes_over(kind: Kind, source: str | None, before: str, *, overtaken: bool) -> str:
    """A publisher that counts now that the previous one is gone.

    `overtaken`: nobody knows that it is gone, but it has no liveliness token and this order is newer.
    """
    why = "has no liveliness token and its order is older" if overtaken else "is gone"
    return about(kind, f"{_named(source)} counts from now on, {_named(before)} {why}")


def not_heeded(kind: Kind, source: str, before: str | None) -> str:
    """A publisher that does not count while the one before is present."""
    return about(kind, f"two publishers: what {_named(source)} says is not heeded while {_named(before)} is there")


def _named(source: str | None) -> str:
    """The name of a session; words for one without a name."""
    return source or "one without a name"


# --- the journey -----------------------------------------------------------------------------------------------------


def journey(stops: Iterable[str]) -> str:
    """A journey that was taken over, by the names of its stops."""
    return f"journey {_way(stops)}"


def ready(stops: Iterable[str]) -> str:
    """The status that goes with a journey that was taken over."""
    return f"ready for {_way(stops)}"


def _way(stops: Iterable[str]) -> str:
    return " – ".join(stops)


def journey_refused(why: str) -> str:
    """A journey that was not taken over, so that there is no advice either."""
    return wording.withdrawal(Withdrawal(Cause.JOURNEY_REFUSED, why))


def other_route(ordered: str, own: str) -> str:
    """A journey for another line."""
    return f"it is for route {ordered!r}, this node has {own!r}"


def other_train(ordered: str, own: str) -> str:
    """A journey for another train."""
    return f"it is for train {ordered!r}, this node is for {own!r}"


def other_direction(*, ordered_reverse: bool, own_reverse: bool) -> str:
    """A journey in the other direction of the route."""
    way = ("forwards", "in reverse")
    return f"it drives the route {way[ordered_reverse]}, this node has it {way[own_reverse]}"


def other_day(departure_ns: int, now_ns: int) -> str:
    """A journey of another day than that of the clock."""
    departs, now = (f"{datetime.fromtimestamp(at_ns * NS, UTC):%Y-%m-%d %H:%M} UTC" for at_ns in (departure_ns, now_ns))
    return f"it departs on {departs}, more than a day from the node's clock ({now})"


def unknown_vehicle(ordered: str, known: Iterable[str]) -> str:
    """A journey for a vehicle of which this node has no file."""
    return f"it is for vehicle {ordered!r}, this node knows {', '.join(known)}"


def too_few_stops(count: int) -> str:
    """A journey with fewer than two stops."""
    return f"it has {count} stops, expected at least 2"


def unknown_level(ordered: str) -> str:
    """A journey with an unknown level of loss modelling."""
    return f"level {ordered!r}: expected one of {', '.join(Level)}"


def time_before_1970(stop: int, name: str, time_ns: int) -> str:
    """A journey with an impossible time; `name`: arrival or departure at the stop of this number."""
    return f"stop {stop} has the {name} {time_ns} ns, expected nanoseconds since 1970"


NO_DEPARTURE: Final = "the first stop has no departure"
NO_ARRIVAL: Final = "the last stop has no arrival"


def departs_before_arrival(stop: int) -> str:
    """A journey that leaves the stop of this number before it arrives there."""
    return f"timetable: the departure from stop {stop} is before the arrival there"


# --- targets of traffic management -----------------------------------------------------------------------------------


def targets(accepted: Sequence[Target], zone: tzinfo = UTC) -> str:
    """The targets that hold from now on, with times of day in a time zone; the first few are named."""
    more = [f"{len(accepted) - MOST_NAMED} more"] if len(accepted) > MOST_NAMED else []
    return "targets: " + ("; ".join([*(_target(one, zone) for one in accepted[:MOST_NAMED]), *more]) or "none any more")


def _target(target: Target, zone: tzinfo) -> str:
    words = (("at", target.arrival_ns), ("not before", target.earliest_ns), ("not after", target.latest_ns))
    times = (f"{word} {datetime.fromtimestamp(at_ns * NS, zone):%H:%M:%S}" for word, at_ns in words if at_ns > 0)
    why = f" ({target.reason})" if target.reason else ""
    return " ".join([target.stop or f"km {target.s_m / KM:.1f}", *times]) + why


def target_ignored(why: str) -> str:
    """A target that was not accepted."""
    return f"target ignored: {why}"


def target_unsolved(why: str) -> str:
    """A target for whose point no front was found."""
    return f"target: {why}"


def no_arrival_given(stop: str) -> str:
    """A target at a stop without an arrival time."""
    return f"{stop}: no arrival is given"


def not_on_the_way(target: Target) -> str:
    """A target at a stop or point that the journey does not reach."""
    return f"{target.stop or f'{target.s_m:.0f} m'} is not on the way to a stop of this journey"


# --- fronts, and why they are searched for anew ----------------------------------------------------------------------

OTHER_TRAIN: Final = "another train or load"
OTHER_LEVEL: Final = "another level"
RESTRICTION_LIFTED: Final = "restriction lifted"
RESTRICTION_SET: Final = "restriction set"


def other_conditions(found: Conditions) -> str:
    """The estimated mass and resistance."""
    return f"mass × {found.mass_ratio:.2f} and resistance × {found.resistance_ratio:.2f} of the plan's"


HILL_NEEDS_BRAKES: Final = "a hill would have to be taken faster than the brakes of the train as planned allow"

_FORCE_DOUBTS: Final = {
    ForceDoubt.TWO_PUBLISHERS: "two publishers of the efforts",
    ForceDoubt.CLOCKS: "the clocks of efforts and positions differ",
    ForceDoubt.TOO_STRONG: "the measured forces are above those that the train has",
    ForceDoubt.COASTING: "a coasting train moves otherwise than the measured forces say",
    ForceDoubt.GAIN: "mass and resistance are off by the same factor, as a wrong gain of the force sensor makes them",
}


def calibration_off(doubt: ForceDoubt) -> str:
    """Measured forces that are not trusted, so that plans do not use them."""
    return f"calibration off: {_FORCE_DOUBTS[doubt]}"


def far_mass(ratio: float) -> str:
    """An estimated mass that is used, but is so far from the planned one that something may be wrong."""
    return (
        f"calibration: the mass found is {ratio:.2f} of the file's: either another train than planned runs, or "
        "the force sensor is wrong"
    )


CALIBRATION_ON: Final = "calibration on again: nothing speaks against the measured forces any more"


def calibration_ignored(error: Exception) -> str:
    """An estimate of mass and resistance with which the train could not drive."""
    return f"calibration ignored: {error}"


def front_found(start: str, end: str, why: str) -> str:
    """A leg whose front was solved, and why it was solved again (empty: the first time)."""
    return f"{start} – {end}: solved" + (f" ({why})" if why else "")


def references_found(start: str, end: str) -> str:
    """A leg for which a table has finished references."""
    return f"{start} – {end}: references from a table"


def no_front(section: str, why: str) -> str:
    """A section for which no front was found."""
    return f"{section}: no plan: {why}"


def solving_failed(error: Exception) -> str:
    """A search for a front that failed for an unforeseen reason."""
    return f"solving failed ({type(error).__name__}: {error})"


def no_guide(why: str) -> str:
    """A section on which there is advice but no guide."""
    return f"no guide: {why}"


def impossible_now(why: str, error: Exception) -> str:
    """A section that cannot be driven after a change (`why`)."""
    return f"{why}: {error}"


def table_unfit(error: Exception) -> str:
    """A table that cannot be read, or is not for the section."""
    return f"{error}; references are solved instead"


def no_table(folder: object, section: str) -> str:
    """A section that no table of the folder is for."""
    return f"{folder}: no table of {section}; references are solved instead"


def no_tables(folder: object) -> str:
    """A folder that holds no table at all."""
    return f"{folder}: no table in this folder"


def old_tables(folder: object) -> str:
    """A folder with tables of earlier releases, which were folders."""
    return f"{folder}: holds tables of an earlier release, which no longer serve; build them again"


# --- advice, position and faults -------------------------------------------------------------------------------------


def shown(regime: Regime, reason: str) -> str:
    """Advice of another driving regime than before, or withdrawn for another cause, with its reason in words."""
    return ": ".join(filter(None, (wording.mode_words(regime), reason)))


def position_restarted(s_m: float) -> str:
    """A position at which the estimate begins anew, because rejected fixes agree on it."""
    return f"position: taken up anew at {s_m:.0f} m"


def clocks_differ(off_s: float) -> str:
    """Time stamps of positions that differ from the clock here (> 0: they are behind, or come late)."""
    what = "are heard late, or their clock is behind:" if off_s > 0 else "are ahead of the clock:"
    return f"position: its time stamps {what} {abs(off_s):.1f} s; the train may be anywhere on the way of that time"


CLOCKS_AGREE: Final = "position: its time stamps agree with the clock again"


def clock_set(step_s: float) -> str:
    """The clock of the node was set (> 0: forward)."""
    way = "forward" if step_s > 0 else "back"
    return f"the clock was set {way} by {abs(step_s):.1f} s; until the next position, the train may be as far off"


def position_rejected(what: Problem) -> str:
    """The first rejected position after an accepted one."""
    return f"position: rejected, {wording.problem(what)}"


def internal_error(what: str, file: str, line: int | None) -> str:
    """An unforeseen error, and the line of the program where it occurred."""
    return f"internal error: {what} ({file}:{line})"
