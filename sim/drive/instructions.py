"""Adherence of the guide's instructions to their grammar, second by second, in a run or in a recording.

`docs/explanation/guide.md` explains the instructions.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from das.advice.advice import Cause
from das.advice.regimes import KIND_OF, InstructionKind, Regime
from das.advice.shown import OVERSPEED_MPS, TARGET_STEP_MPS, step_below
from das.domain.units import KMH, NS
from sim.drive.table import HOLDS_S, DriveTable
from sim.drivers.presentations.presenter import EFFORT_STEP_RATIO

ANNOUNCED_S: Final = 8.0
"""Least notice (s) with which the announcement of a change of kind is in time."""
MOVED_S, MOVED_RATIO = 10.0, 0.35
"""Tolerance (s, or share) between the time announced for a change and the time at which it is due."""
LEAD_S: Final = 1.9
"""Least lead (s) of a brake: 2 s, less the rounding of one advice message a second."""
COAST_MISSES_MPS: Final = 5.5 * KMH
"""Largest difference (m/s) between the end speed of coasting and the announced one that does not count as missed."""
LEAST_COAST_S: Final = 5.0
"""Least coasting time (s) for coasting to be assessed; it must also be half of the time shown."""
ROLLS_N: Final = 2000.0
"""Wheel force (N) below which a train coasts."""
PROMISED_S: Final = 8.0
"""Time (s) up to which an announced next change counts as promised."""
OBEYED_S, OBEYED_RATIO = 5.0, 0.8
"""Time (s) and share of the effort that define an obedient driver: speeds kept for that time, brakes with that
share."""
BRIEF_S, GAINS_S = 30.0, 1.0
"""Least time (s) to a brake, and least gain (s) over holding; below both, an acceleration counts as useless."""
MOVING_MPS: Final = 0.3
"""Speed (m/s) below which a train stands."""
REMEMBERED: Final = 60
"""Time (s) for which announcements are remembered."""


_Task = tuple[InstructionKind, int]
"""A kind of instruction with its speed in whole km/h: "brake to 60" does not announce "brake to 0"."""


class _Told(NamedTuple):
    """An instruction with the time (s), place (m) and speed at which it was first shown, and the time (s) at which it
    was due.

    `by_eye`: it is a brake that shows no effort.
    """

    kind: InstructionKind
    to_mps: float
    effort: int
    by_eye: bool
    time_s: float
    s_m: float
    speed_mps: float
    due_s: float
    reference_ns: int

    @property
    def seen(self) -> tuple[InstructionKind, int, int]:
        """The text on the display: kind, speed in whole km/h, and effort in steps."""
        return *self.task, self.effort

    @property
    def task(self) -> _Task:
        """The part that is announced and remembered: kind, and speed in whole km/h (0 for coasting)."""
        return _task(self.kind, self.to_mps)


@dataclass(frozen=True, kw_only=True)
class RelianceFigures:
    """The reliability of the guide for a driver.

    Of the `promised` changes (announced as the next one, and nearly due) `kept` came at about that time.
    `above_limit_s` counts the seconds in which the train of a driver who obeys is faster than the limit by 0.5 m/s,
    `hidden_limits` the limits that began during an instruction to stop by eye and that a steady brake to the stop would
    exceed, `replaced` the parts of advice that the last word replaced. `advised_s` and `silent_s` are the seconds with
    advice and without; a display left blank because of the driver's own actions counts as neither.
    """

    promised: int = 0
    kept: int = 0
    above_limit_s: int = 0
    hidden_limits: int = 0
    replaced: int = 0
    advised_s: int = 0
    silent_s: int = 0


@dataclass(frozen=True, kw_only=True)
class InstructionFigures:
    """Counts of the guide's instructions for a moving train.

    `changes` is the number of changes of kind, `announced` the number of them announced in time, or implied by the
    previous instruction (holding the speed to which it leads). `brakes` begin after another kind; `led` of them were
    shown at least 2 s before they were due. `efforts_in_brakes` counts changes of the effort within brakes.
    `missed_coasts` end far from their speed though the train coasted, `vain_accelerations` soon end in a brake,
    `odd_speeds` are neither a whole step nor a limit on the way. `shortest_s` is the shortest time for which an
    instruction was shown, if neither it nor the next one is a brake; infinity if there is none. `standing_s` counts the
    seconds in which a train that stands is told to accelerate.
    """

    instructions: int = 0
    changes: int = 0
    announced: int = 0
    brakes: int = 0
    led: int = 0
    efforts_in_brakes: int = 0
    missed_coasts: int = 0
    vain_accelerations: int = 0
    odd_speeds: int = 0
    shortest_s: float = math.inf
    standing_s: int = 0
    reliance: RelianceFigures = RelianceFigures()

    @property
    def against_grammar(self) -> int:
        """Instructions that the grammar of the guide excludes."""
        return self.missed_coasts + self.vain_accelerations + self.odd_speeds + self.standing_s


class _ByEye(NamedTuple):
    """A brake by eye at its beginning: place (m), speed and limit (m/s), and place (m) where the train is to stand."""

    s_m: float
    speed_mps: float
    limit_mps: float
    stop_m: float

    @classmethod
    def begun(cls, told: _Told, advice: Any) -> _ByEye:
        """A brake by eye that begins with advice."""
        return cls(told.s_m, told.speed_mps, float(advice.limit_mps), told.s_m + advice.guide.target_m)

    def speed_at(self, s_m: float) -> float:
        """The speed (m/s) at a place if the train brakes steadily to the stop; 0 beyond it."""
        whole_m, left_m = self.stop_m - self.s_m, self.stop_m - s_m
        return self.speed_mps * math.sqrt(left_m / whole_m) if left_m > 0 else 0.0


class _RelianceWatch:
    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._at_s, self._obeyed_s = -math.inf, 0
        self._promise: tuple[_Task, float] | None = None
        self._stopping: _ByEye | None = None

    @property
    def found(self) -> RelianceFigures:
        """The figures so far."""
        return RelianceFigures(**self._counts)

    def look(self, told: _Told | None, advice: Any, force_n: float) -> None:
        """Receive advice, the instruction in it for a moving train, and the wheel force (N)."""
        time_s = advice.time_ns * NS
        self._count_time(advice, time_s)
        self._at_s = time_s
        self._judge_by_eye(told, advice)
        if told is None:
            self._promise, self._obeyed_s = None, 0
            return
        self._obeyed_s = self._obeyed_s + 1 if _obeys(told, advice, force_n) else 0
        too_fast = advice.speed_mps > advice.limit_mps + OVERSPEED_MPS
        self._counts["above_limit_s"] += too_fast and self._obeyed_s > OBEYED_S
        self._keep_promise(told, advice.guide.following, time_s)

    def _count_time(self, advice: Any, time_s: float) -> None:
        self._counts["replaced"] += int(advice.replaced_parts)
        if math.isfinite(self._at_s):
            self._counts["silent_s"] += max(round(time_s - self._at_s) - 1, 0)
        self._counts["advised_s"] += int(advice.mode) != Regime.NONE
        self._counts["silent_s"] += int(advice.mode) == Regime.NONE and not Cause(advice.cause).is_quiet

    def _judge_by_eye(self, told: _Told | None, advice: Any) -> None:
        """Count a limit before the stop during an instruction to stop by eye, if the brake by eye would exceed it."""
        if told is None or not told.by_eye or advice.guide.now.in_s > 0:
            self._stopping = None
            return
        begun = self._stopping = self._stopping or _ByEye.begun(told, advice)
        if advice.limit_mps < begun.limit_mps:
            self._counts["hidden_limits"] += begun.speed_at(advice.s_m) > advice.limit_mps + OVERSPEED_MPS
            self._stopping = begun._replace(limit_mps=float(advice.limit_mps))

    def _keep_promise(self, told: _Told, following: Sequence[Any], time_s: float) -> None:
        """Count the announcement of the next change once it is nearly due, and whether that change comes."""
        if self._promise is not None:
            promised, due_s = self._promise
            kept = told.task == promised and abs(told.due_s - due_s) <= MOVED_S
            if kept or time_s > due_s + MOVED_S:
                self._counts["kept"] += kept
                self._promise = None
        kind = KIND_OF.get(int(following[0].mode)) if following else None
        if self._promise is None and kind and kind is not told.kind and following[0].in_s <= PROMISED_S:
            self._counts["promised"] += 1
            self._promise = _task(kind, following[0].speed_mps), time_s + following[0].in_s


class InstructionWatch:
    """Checks every advice message of a run, once a second; call `look` in the order of time."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._perhaps_odd: Counter[float] = Counter()
        """Instructions by speed (m/s), if that is neither a whole step nor the limit for which they are shown."""
        self._limits_mps: set[float] = set()
        self._shortest_s = math.inf
        self._now: _Told | None = None
        self._at_s = -math.inf
        self._announced: deque[tuple[float, _Task, float]] = deque(maxlen=2 * REMEMBERED)
        self._coasted_s = 0
        self._ending: tuple[_Told, _Told, int] | None = None
        """Coasting that another instruction is about to end, and how long the train has coasted (s)."""
        self._led_mps, self._led_s = -math.inf, -math.inf
        """The speed shown last, and since when (s): coasting counts as one instruction even if its speed changes."""
        self._reliance = _RelianceWatch()

    @property
    def found(self) -> InstructionFigures:
        """The figures so far."""
        odd = sum(count for to_mps, count in self._perhaps_odd.items() if _is_odd(to_mps, self._limits_mps))
        shortest_s, reliance = self._shortest_s, self._reliance.found
        return InstructionFigures(**self._counts, odd_speeds=odd, shortest_s=shortest_s, reliance=reliance)

    def look(self, advice: Any, force_n: float) -> None:
        """Receive advice (`Advice`, or its message), and the train's wheel force (N) at that moment."""
        self._limits_mps.add(advice.limit_mps)
        told, time_s = _told(advice), advice.time_ns * NS
        if told is not None and advice.speed_mps < MOVING_MPS:
            self._counts["standing_s"] += told.kind is InstructionKind.TRACTION
            told = None
        before = self._now if time_s - self._at_s <= HOLDS_S else None
        self._at_s = time_s
        self._reliance.look(told, advice, force_n)
        if told is None:
            self._now = self._ending = None
            return
        if before is None or told.seen != before.seen:
            self._changed(before, told, advice)
        elif self._leads_elsewhere(told) and self._was_announced(told, before.time_s):
            self._ends(before, told)  # Coasting to this speed was announced while coasting: another instruction.
        if self._ending is not None and time_s >= self._ending[1].due_s - 0.5:
            self._counts["missed_coasts"] += _misses(*self._ending, advice.speed_mps)
            self._ending = None
        if self._leads_elsewhere(told):
            self._led_mps, self._led_s = told.to_mps, time_s
        self._coasted_s += told.kind is InstructionKind.COAST and abs(force_n) < ROLLS_N
        for one in advice.guide.following:
            kind = KIND_OF.get(int(one.mode))
            if kind is not None:
                self._announced.append((time_s, _task(kind, one.speed_mps), time_s + one.in_s))

    def _leads_elsewhere(self, told: _Told) -> bool:
        """Whether the speed shown is another one than before, in whole km/h as drivers see it."""
        return abs(told.to_mps - self._led_mps) > 0.5 * KMH

    def _changed(self, before: _Told | None, told: _Told, advice: Any) -> None:
        counts = self._counts
        counts["instructions"] += 1
        self._perhaps_odd[told.to_mps] += _is_odd(told.to_mps, (advice.guide.reason.speed_mps,))
        self._ends(before, told)
        if before is None:
            return
        if InstructionKind.BRAKE not in (told.kind, before.kind):
            self._shortest_s = min(self._shortest_s, told.time_s - before.time_s)
        if told.kind is before.kind:
            counts["efforts_in_brakes"] += told.kind is InstructionKind.BRAKE and told.effort != before.effort
            return
        counts["changes"] += 1
        counts["announced"] += _is_own_end(before._replace(to_mps=self._led_mps), told) or self._was_announced(told)
        counts["brakes"] += told.kind is InstructionKind.BRAKE
        counts["led"] += told.kind is InstructionKind.BRAKE and told.due_s - told.time_s >= LEAD_S
        counts["vain_accelerations"] += _is_vain(before, told)

    def _ends(self, before: _Told | None, told: _Told) -> None:
        if before is not None and before.kind is InstructionKind.COAST and self._coasted_s >= LEAST_COAST_S:
            stood = told.time_s - self._led_s >= ANNOUNCED_S
            self._ending = before._replace(to_mps=self._led_mps) if stood else before, told, self._coasted_s
        self._now, self._coasted_s = told, 0

    def _was_announced(self, told: _Told, since_s: float = -math.inf) -> bool:
        """Whether a change was announced in time, after `since_s`, for about the time at which it is due."""
        return any(
            task == told.task
            and since_s < time_s <= told.due_s - ANNOUNCED_S
            and abs(due_s - told.due_s) <= max(MOVED_S, MOVED_RATIO * (told.due_s - time_s))
            for time_s, task, due_s in self._announced
        )


class _AdviceRow(NamedTuple):
    time_ns: int
    s_m: float
    speed_mps: float
    limit_mps: float
    mode: int
    cause: int
    replaced_parts: int
    guide: Any


def instructions(table: DriveTable) -> InstructionFigures:
    """The figures of a recorded drive, from the advice of its node and the forces of the true train."""
    watch = InstructionWatch()
    true_ns, electric_n, friction_n = table.of_topic("truth", "force_el_n", "force_friction_n")
    forces_n = electric_n + friction_n
    for row in zip(*(one.tolist() for one in table.of_topic("advice", *_AdviceRow._fields[1:])), strict=True):
        at = int(np.searchsorted(true_ns, row[0], side="right")) - 1
        watch.look(_AdviceRow(*row), float(forces_n[at]) if at >= 0 else math.nan)
    return watch.found


def _told(advice: Any) -> _Told | None:
    """The guide's instruction in advice; None if there is none for a moving train."""
    guide = advice.guide
    kind = None if guide is None else KIND_OF.get(int(guide.now.mode))
    if kind is None or math.isnan(advice.speed_mps):
        return None
    now, time_s = guide.now, advice.time_ns * NS
    shows = not (math.isnan(now.effort_ratio) or math.isnan(guide.lever_ratio))
    effort = round(now.effort_ratio / EFFORT_STEP_RATIO) if shows else 0
    by_eye = kind is InstructionKind.BRAKE and math.isnan(now.effort_ratio)
    return _Told(
        kind, now.speed_mps, effort, by_eye, time_s, advice.s_m, advice.speed_mps, time_s + now.in_s,
        int(guide.replan.time_ns),
    )  # fmt: skip


def _task(kind: InstructionKind, to_mps: float) -> _Task:
    """The action that the driver must take; for coasting it does not depend on the speed named."""
    return kind, 0 if kind is InstructionKind.COAST else round(to_mps / KMH)


def _is_odd(to_mps: float, limits_mps: Collection[float]) -> bool:
    """Whether the speed of an instruction is neither a whole step nor one of the limits."""
    known = round(to_mps / TARGET_STEP_MPS) * TARGET_STEP_MPS, *limits_mps
    return not any(abs(to_mps - step_below(one)) < 0.5 * KMH for one in known if math.isfinite(one))


def _is_own_end(before: _Told, told: _Told) -> bool:
    reached = before.kind is not InstructionKind.HOLD and told.kind is InstructionKind.HOLD
    return reached and abs(told.to_mps - before.to_mps) < KMH


def _obeys(told: _Told, advice: Any, force_n: float) -> bool:
    if told.by_eye:  # The force is not known: a driver without traction follows the advice.
        return bool(advice.guide.now.in_s > 0 or force_n <= 0)
    if told.kind is InstructionKind.BRAKE:
        return bool(advice.guide.now.in_s > 0 or force_n <= OBEYED_RATIO * advice.guide.force_n)
    if told.kind is InstructionKind.COAST:
        return bool(force_n <= 0 or advice.guide.now.in_s > 0)
    slows = force_n <= OBEYED_RATIO * min(advice.guide.force_n, 0.0)  # Downhill, a speed is held by braking.
    return bool(slows or told.speed_mps <= told.to_mps + OVERSPEED_MPS)


def _misses(coast: _Told, told: _Told, coasted_s: int, ends_mps: float) -> bool:
    """Whether a train that has coasted (s) ended far from the speed, though the reference stayed the same. Coasting
    ends at `ends_mps` (m/s), where the instruction `told` next is due.
    """
    if coasted_s < 0.5 * (told.time_s - coast.due_s):
        return False
    replaced = told.reference_ns * NS > coast.time_s
    if told.kind is InstructionKind.BRAKE:
        interrupted = told.to_mps > coast.to_mps  # A limit on the way requires it.
        return not (interrupted or replaced) and ends_mps > coast.to_mps + COAST_MISSES_MPS
    passed = coast.speed_mps < coast.to_mps < ends_mps  # The train accelerated on a descent.
    return not (passed or replaced) and abs(ends_mps - coast.to_mps) > COAST_MISSES_MPS


def _is_vain(accelerated: _Told, told: _Told) -> bool:
    """Whether an acceleration soon ended in a brake and gained hardly any time over holding its first speed."""
    if accelerated.kind is not InstructionKind.TRACTION or told.kind is not InstructionKind.BRAKE:
        return False
    lasted_s = told.time_s - accelerated.time_s
    gained_s = (told.s_m - accelerated.s_m) / max(accelerated.speed_mps, MOVING_MPS) - lasted_s
    return lasted_s < BRIEF_S and gained_s < GAINS_S
