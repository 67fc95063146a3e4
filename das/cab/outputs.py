"""What the cab says: plain frozen values. The node turns them into messages; a simulation takes them as they are.

`Reporting` collects them: events in moderation, changes of mode, and plans every while.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from das.advice.advice import Advice
from das.advice.cause import Cause
from das.advice.plan import Plan
from das.advice.regimes import Regime
from das.cab import event_wording
from das.domain.units import NS
from das.estimate.estimate import Estimate

MOST_A_SECOND = 5
"""Complaints of one sort: the others are only counted."""
PLAN_EVERY_S = 10.0
LOSSES_EVERY_S = 1.0
"""Plans and losses are said no more often than this."""
CLOCKS_DIFFER_S = 0.5
CLOCKS_EVERY_S = 10.0
"""Clocks that differ by less than this are not spoken of, and others no more often than this."""


class Severity(IntEnum):
    """How bad an event is; the numbers are those of the log message on the bus."""

    INFO = 2
    WARNING = 3
    ERROR = 4


class NodeState(IntEnum):
    """How the on-board system is; the numbers are those of the bus message."""

    STARTING = 0
    WAITING = 1
    """No journey has been heard yet."""
    READY = 2
    """There is a journey, but no position yet."""
    ADVISING = 3
    WITHDRAWN = 4
    """There is no advice; cause and reason say why."""
    STOPPING = 5


@dataclass(frozen=True, kw_only=True)
class Event:
    """Something that happened, for people to read."""

    time_ns: int
    severity: Severity
    text: str


@dataclass(frozen=True, kw_only=True)
class Status:
    """How the on-board system is; `solve_s` and `last_advice_s` are what the last ones took by the stopwatch (s)."""

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
    """Mass and running resistance as found while driving, as ratios of the planned train's, with deviations."""

    time_ns: int
    mass_ratio: float
    mass_sd_ratio: float
    resistance_ratio: float
    resistance_sd_ratio: float
    samples: int
    usable: bool
    differs: bool
    doubt: str = ""
    """Why the measured forces are not trusted, or `far-mass`: they are, but the mass is strange; nothing: neither."""


Output = Advice | Status | Plan | Estimated | Event


class Moderation:
    """Lets through `MOST_A_SECOND` texts a second of a clock that may jump, and counts the others.

    Many faulty messages must not cause as many complaints.
    """

    def __init__(self) -> None:
        self._second_ns = 0
        self._said = 0
        self._unsaid = 0

    def allows(self, now_ns: int) -> bool:
        """Whether something may be said now; counted if not."""
        self._turn(now_ns)
        if self._said >= MOST_A_SECOND:
            self._unsaid += 1
            return False
        self._said += 1
        return True

    def unsaid(self, now_ns: int) -> int:
        """How many were not said, once their second is over; then counted anew."""
        self._turn(now_ns)
        if self._said >= MOST_A_SECOND or not self._unsaid:
            return 0
        count, self._unsaid = self._unsaid, 0
        return count

    def _turn(self, now_ns: int) -> None:
        if abs(now_ns - self._second_ns) * NS >= 1.0:
            self._second_ns, self._said = now_ns, 0


def is_fresh(said_ns: int | None, now_ns: int, every_s: float) -> bool:
    """Whether something was said less than a while ago by a clock that may jump."""
    return said_ns is not None and 0 <= (now_ns - said_ns) * NS < every_s


class Reporting:
    """Collects what there is to say until it is taken."""

    def __init__(self) -> None:
        self.advices = 0
        """So many advices were given or withdrawn."""
        self._said: list[Output] = []
        self._complaints, self._news = Moderation(), Moderation()
        self._shown: tuple[Regime, Cause] | None = None
        self._counted, self._rejecting = (0, 0), False
        self._plan: Plan | None = None
        self._plan_ns: int | None = None
        self._dropped, self._losses_ns = 0, 0
        self._clock_said: tuple[float, int | None] = (0.0, None)

    def take(self) -> list[Output]:
        """All that is to be said now, in order."""
        said, self._said = self._said, []
        return said

    def say(self, output: Output) -> None:
        """Say something."""
        self._said.append(output)

    def event(self, now_ns: int, severity: Severity, text: str) -> None:
        """Something happened."""
        self.say(Event(time_ns=now_ns, severity=severity, text=text))

    def may_tell(self, now_ns: int) -> bool:
        """Whether good news that comes with messages may be told now; many messages must not cause as many news."""
        return self._news.allows(now_ns)

    def complain(self, now_ns: int, text: str, severity: Severity = Severity.WARNING) -> None:
        """Something is not as it should be; left unsaid where there is too much of it."""
        if self._complaints.allows(now_ns):
            self.event(now_ns, severity, text)

    def losses(self, now_ns: int, dropped: int) -> None:
        """Say how many complaints were left unsaid, and how many messages a flood has cost (`dropped`: in all)."""
        if unsaid := self._complaints.unsaid(now_ns):
            self.event(now_ns, Severity.WARNING, event_wording.unsaid(unsaid))
        lost = dropped - self._dropped
        if lost and abs(now_ns - self._losses_ns) * NS >= LOSSES_EVERY_S:
            self.event(now_ns, Severity.WARNING, event_wording.dropped(lost))
            self._dropped, self._losses_ns = dropped, now_ns

    def changes(self, advice: Advice) -> None:
        """Say where the mode changes, or the cause of a withdrawal, with the reason."""
        if (advice.mode, advice.cause) != self._shown:
            severity = Severity.WARNING if advice.mode is Regime.NONE else Severity.INFO
            self.event(advice.time_ns, severity, event_wording.shown(advice.mode, advice.reason))
            self._shown = advice.mode, advice.cause

    def note_internal_error(self) -> None:
        """There was no advice because of an internal error, which has been said already."""
        self._shown = Regime.NONE, Cause.INTERNAL_ERROR

    def rejections(self, here: Estimate) -> None:
        """Say where positions begin to be rejected, and where they are taken up anew elsewhere."""
        rejected, restarts = self._counted
        if here.restarts > restarts:
            self.event(here.time_ns, Severity.WARNING, event_wording.position_restarted(here.s_m))
        rejecting = here.rejected > rejected
        if rejecting and not self._rejecting and here.rejection is not None:
            self.event(here.time_ns, Severity.WARNING, event_wording.position_rejected(here.rejection))
        self._counted, self._rejecting = (here.rejected, here.restarts), rejecting

    def clocks(self, here: Estimate) -> None:
        """Say where the time stamps of the positions and the clock begin to differ, and where they agree again."""
        off_s, (said_s, said_ns) = here.clock_off_s, self._clock_said
        if abs(off_s - said_s) < CLOCKS_DIFFER_S or is_fresh(said_ns, here.time_ns, CLOCKS_EVERY_S):
            return
        agree = abs(off_s) < CLOCKS_DIFFER_S
        self._clock_said = (0.0 if agree else off_s), here.time_ns
        severity = Severity.INFO if agree else Severity.WARNING
        text = event_wording.CLOCKS_AGREE if agree else event_wording.clocks_differ(off_s)
        self.complain(here.time_ns, text, severity)

    def plan(self, plan: Plan | None, now_ns: int) -> None:
        """Say the plan, when there is a new one and the last was said a while ago (or the clock jumped)."""
        if plan is None or plan is self._plan or is_fresh(self._plan_ns, now_ns, PLAN_EVERY_S):
            return
        self._plan, self._plan_ns = plan, now_ns
        self.say(plan)
