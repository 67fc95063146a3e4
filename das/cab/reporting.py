"""What the cab says beside advice: events in moderation, changes of mode, and plans every while."""

from __future__ import annotations

from das.advice.advice import Advice
from das.advice.cause import Cause
from das.advice.modes import Mode
from das.advice.plan import Plan
from das.cab import event_wording
from das.cab.learning import is_fresh
from das.cab.moderation import Moderation
from das.cab.outputs import Event, Output, Severity
from das.domain.units import NS
from das.estimate.estimate import Estimate

PLAN_EVERY_S = 10.0
LOSSES_EVERY_S = 1.0
"""Plans and losses are said no more often than this."""
CLOCKS_DIFFER_S = 0.5
CLOCKS_EVERY_S = 10.0
"""Clocks that differ by less than this are not spoken of, and others no more often than this."""


class Reporting:
    """Collects what there is to say until it is taken."""

    def __init__(self) -> None:
        self.advices = 0
        """So many advices were given or withdrawn."""
        self._said: list[Output] = []
        self._complaints, self._news = Moderation(), Moderation()
        self._shown: tuple[Mode, Cause] | None = None
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
        """Whether good news that comes with messages may be told now; a flood of messages must not become one of it."""
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
            severity = Severity.WARNING if advice.mode is Mode.NONE else Severity.INFO
            self.event(advice.time_ns, severity, event_wording.shown(advice.mode, advice.reason))
            self._shown = advice.mode, advice.cause

    def note_internal_error(self) -> None:
        """There was no advice because of an internal error, which has been said already."""
        self._shown = Mode.NONE, Cause.INTERNAL_ERROR

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
