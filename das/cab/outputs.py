"""The answers of the cab as frozen values, and `Reporting`, which collects them and limits the number of events."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from das.advice import wording
from das.advice.advice import Advice, Cause
from das.advice.plan import Plan
from das.advice.regimes import Regime
from das.domain.units import NS
from das.estimate.estimate import Estimate

MOST_A_SECOND = 5
"""Largest number of texts that a `Moderation` reports each second; the others are only counted."""
PLAN_EVERY_S = 10.0
"""Least time (s) between reports of new plans."""
LOSSES_EVERY_S = 1.0
"""Least time (s) between reports of messages lost in floods."""
CLOCKS_DIFFER_S = 0.5
"""Difference (s) below which clocks are taken to agree."""
CLOCKS_EVERY_S = 10.0
"""Least time (s) between reports of a difference of the clocks."""


class Severity(IntEnum):
    """The severity of an event; the numbers are those of the log message on the bus."""

    INFO = 2
    WARNING = 3
    ERROR = 4


class NodeState(IntEnum):
    """The state of the on-board system; the numbers are those of the bus message."""

    STARTING = 0
    WAITING = 1
    """No journey has been received yet."""
    READY = 2
    """There is a journey, but no position yet."""
    ADVISING = 3
    WITHDRAWN = 4
    """There is no advice; cause and reason explain it."""
    STOPPING = 5


@dataclass(frozen=True, kw_only=True)
class Event:
    """An event as text for people."""

    time_ns: int
    severity: Severity
    text: str


@dataclass(frozen=True, kw_only=True)
class Status:
    """The status of the on-board system.

    `solve_s` and `last_advice_s` are the durations of the last search for a front and of the last advice (s).
    """

    time_ns: int
    state: NodeState
    reason: str = ""
    cause: Cause = Cause.NONE
    section: str = ""
    solve_s: float = 0.0
    last_advice_s: float = 0.0
    advices: int = 0


@dataclass(frozen=True, kw_only=True)
class Estimated:
    """The estimated mass and running resistance as ratios of the planned train's, each with a standard deviation."""

    time_ns: int
    mass_ratio: float
    mass_sd_ratio: float
    resistance_ratio: float
    resistance_sd_ratio: float
    samples: int
    usable: bool
    differs: bool
    doubt: str = ""
    """Why the measured forces are not trusted; `far-mass` if they are, but the mass is far from the planned one."""


Output = Advice | Status | Plan | Estimated | Event


class Moderation:
    """Lets through `MOST_A_SECOND` texts in each second, by a clock that may jump, and counts the others.

    Thus a flood of faulty messages does not cause a flood of reports.
    """

    def __init__(self) -> None:
        self._second_ns = 0
        self._reported = 0
        self._suppressed = 0

    def allows(self, now_ns: int) -> bool:
        """Whether one more text may be reported now; if not, it is counted."""
        self._turn(now_ns)
        if self._reported >= MOST_A_SECOND:
            self._suppressed += 1
            return False
        self._reported += 1
        return True

    def take_suppressed(self, now_ns: int) -> int:
        """The number of suppressed texts, once their second is over (0 before); then the count restarts."""
        self._turn(now_ns)
        if self._reported >= MOST_A_SECOND or not self._suppressed:
            return 0
        count, self._suppressed = self._suppressed, 0
        return count

    def _turn(self, now_ns: int) -> None:
        if abs(now_ns - self._second_ns) * NS >= 1.0:
            self._second_ns, self._reported = now_ns, 0


def is_fresh(reported_ns: int | None, now_ns: int, every_s: float) -> bool:
    """Whether something was reported less than `every_s` ago, by a clock that may jump; False if it never was."""
    return reported_ns is not None and 0 <= (now_ns - reported_ns) * NS < every_s


class Reporting:
    """Collects outputs until they are taken."""

    def __init__(self) -> None:
        self.advices = 0
        """Number of advice messages so far, including withdrawals."""
        self._outputs: list[Output] = []
        self.add = self._outputs.append
        """Add an output."""
        self._complaints, self._news = Moderation(), Moderation()
        self._shown: tuple[Regime, Cause] | None = None
        self._counted, self._rejecting = (0, 0), False
        self._plan: Plan | None = None
        self._plan_ns: int | None = None
        self._dropped, self._losses_ns = 0, 0
        self._clock_reported: tuple[float, int | None] = (0.0, None)

    def take(self) -> list[Output]:
        """All outputs since the last call, in order."""
        outputs = self._outputs.copy()
        self._outputs.clear()
        return outputs

    def event(self, now_ns: int, severity: Severity, text: str) -> None:
        """Add an event."""
        self.add(Event(time_ns=now_ns, severity=severity, text=text))

    def may_report(self, now_ns: int) -> bool:
        """Whether the report that a message was accepted may be sent now; too many such reports are dropped."""
        return self._news.allows(now_ns)

    def complain(self, now_ns: int, text: str, severity: Severity = Severity.WARNING) -> None:
        """Add an event about a fault, unless there are too many such events."""
        if self._complaints.allows(now_ns):
            self.event(now_ns, severity, text)

    def losses(self, now_ns: int, dropped: int) -> None:
        """Report the number of suppressed faults, and of messages lost in floods (`dropped`: in total)."""
        if suppressed := self._complaints.take_suppressed(now_ns):
            self.event(now_ns, Severity.WARNING, f"{suppressed} further warnings were suppressed")
        lost = dropped - self._dropped
        if lost and abs(now_ns - self._losses_ns) * NS >= LOSSES_EVERY_S:
            self.event(now_ns, Severity.WARNING, f"{lost} messages were dropped: too many at once")
            self._dropped, self._losses_ns = dropped, now_ns

    def changes(self, advice: Advice, reason: str) -> None:
        """Report a change of the driving regime, or of the cause of a withdrawal, with the reason in words."""
        if (advice.mode, advice.cause) != self._shown:
            wrong = advice.mode is Regime.NONE and not advice.cause.is_quiet
            severity = Severity.WARNING if wrong else Severity.INFO
            self.event(advice.time_ns, severity, ": ".join(filter(None, (wording.mode_words(advice.mode), reason))))
            self._shown = advice.mode, advice.cause

    def note_internal_error(self) -> None:
        """Record that advice was withdrawn because of an internal error, which has already been reported."""
        self._shown = Regime.NONE, Cause.INTERNAL_ERROR

    def rejections(self, here: Estimate) -> None:
        """Report that positions begin to be rejected, or that the estimate has restarted elsewhere."""
        rejected, restarts = self._counted
        if here.restarts > restarts:
            self.event(here.time_ns, Severity.WARNING, f"position: estimate restarted at {here.s_m:.0f} m")
        rejecting = here.rejected > rejected
        if rejecting and not self._rejecting and here.rejection is not None:
            self.event(here.time_ns, Severity.WARNING, f"position: rejected, {wording.problem(here.rejection)}")
        self._counted, self._rejecting = (here.rejected, here.restarts), rejecting

    def clocks(self, here: Estimate) -> None:
        """Report that the clock and the time stamps of the positions begin to differ, or agree again."""
        off_s, (reported_s, reported_ns) = here.clock_off_s, self._clock_reported
        if abs(off_s - reported_s) < CLOCKS_DIFFER_S or is_fresh(reported_ns, here.time_ns, CLOCKS_EVERY_S):
            return
        agree = abs(off_s) < CLOCKS_DIFFER_S
        self._clock_reported = (0.0 if agree else off_s), here.time_ns
        severity = Severity.INFO if agree else Severity.WARNING
        side = "behind our clock (messages or their clock are late)" if off_s > 0 else "ahead of our clock"
        way = f"are {abs(off_s):.1f} s {side}; the position is uncertain by the distance run in that time"
        text = f"position: time stamps {'agree with our clock again' if agree else way}"
        self.complain(here.time_ns, text, severity)

    def plan(self, plan: Plan | None, now_ns: int) -> None:
        """Report a new plan, unless the last one was reported less than `PLAN_EVERY_S` ago."""
        if plan is None or plan is self._plan or is_fresh(self._plan_ns, now_ns, PLAN_EVERY_S):
            return
        self._plan, self._plan_ns = plan, now_ns
        self.add(plan)
