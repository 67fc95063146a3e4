"""The memory of the guide from one second to the next, and the instructions that it gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import NamedTuple

from das.advice.advice import Instruction
from das.advice.braking import braking_mode
from das.advice.guide.timeline import SAME_MPS
from das.advice.regimes import KIND_OF, TRACTION, InstructionKind, Regime, departure_regime
from das.domain.units import NS
from das.solver.kernels.guide_policy import STANDS_S

SAME_CHANGE_S = 10.0
"""The shift (s) of the due time up to which an announced change is still the same, also after it was due."""
NOTHING = Instruction()


class Lead(Enum):
    """The behaviour of the guide in a second."""

    FOLLOW = auto()
    """The present step is shown."""
    BACK_UP = auto()
    """A train that is too slow is led back to the speed of the step."""
    BACK_DOWN = auto()
    """A train that is too fast is led back to the speed of the step."""
    CREEP = auto()
    """A train that would stop short of its mark holds a low speed."""
    GUARD = auto()
    """The instruction that limits or the stop require is shown."""
    SILENT = auto()
    """Nothing is shown."""


class Notice(NamedTuple):
    """An announced change: its kind and speed, when it was first announced, and when it is due (ns)."""

    kind: InstructionKind
    speed_mps: float
    since_ns: int
    due_ns: int

    def is_of(self, one: Instruction, due_ns: int) -> bool:
        """Whether the notice announces this instruction for about this time; for coasting, at any speed."""
        same = KIND_OF.get(one.mode) is self.kind
        same &= self.kind is InstructionKind.COAST or abs(one.speed_mps - self.speed_mps) < SAME_MPS
        return same and abs(due_ns - self.due_ns) * NS < SAME_CHANGE_S


@dataclass(frozen=True, kw_only=True)
class Memory:
    """The whole memory of the guide.

    `step` is the number of the present step; `reached`: its speed was reached, and is held. `mode` is the present
    behaviour, and `back` its instruction if that is not the step's. `shown` was first shown at `since_ns` and is due at
    `due_ns`. `efforts` are the braking efforts shown last, by the place (m) to brake for.
    """

    step: int = 0
    reached: bool = False
    mode: Lead = Lead.SILENT
    back: Instruction | None = None
    shown: Instruction = NOTHING
    since_ns: int = 0
    due_ns: int = 0
    announced: tuple[Notice, ...] = ()
    noted_ns: int = 0
    efforts: Mapping[float, float] = field(default_factory=dict)

    def lacks_s(self, one: Instruction, now_ns: int, in_s: float) -> float:
        """The time (s) for which an instruction due in `in_s` must still be announced; 0: no longer."""
        since_ns = self._since_ns(one, now_ns + round(in_s / NS), now_ns)
        return max(STANDS_S - in_s - (now_ns - since_ns) * NS, 0.0)

    def _since_ns(self, one: Instruction, due_ns: int, now_ns: int) -> int:
        """The time since which an instruction due at `due_ns` has been announced; now if it has not been."""
        return next((old.since_ns for old in self.announced if old.is_of(one, due_ns)), now_ns)

    def noted(self, following: tuple[Instruction, ...], now_ns: int) -> tuple[Notice, ...]:
        """The announcements with the new ones; an instruction that was dropped, or moved too far, counts from now."""
        said: list[Notice] = []
        for one in following:
            due_ns, kind = now_ns + round(one.in_s / NS), KIND_OF[one.mode]
            said.append(Notice(kind, one.speed_mps, self._since_ns(one, due_ns, now_ns), due_ns))
        kinds = {one.kind for one in said}
        due = (old for old in self.announced if 0.0 <= (now_ns - old.due_ns) * NS < SAME_CHANGE_S)
        return (*said, *(old for old in due if old.kind not in kinds))


def traction(share: float, to_mps: float) -> Instruction:
    """The instruction to accelerate to a speed with a share of the largest traction."""
    return Instruction(mode=departure_regime(share), speed_mps=to_mps, effort_ratio=share)


def hold(speed_mps: float) -> Instruction:
    """The instruction to hold a speed."""
    return Instruction(mode=Regime.CRUISE, speed_mps=speed_mps)


def coast(to_mps: float) -> Instruction:
    """The instruction to coast to a speed."""
    return Instruction(mode=Regime.COAST, speed_mps=to_mps, effort_ratio=0.0)


def brake(effort: float, to_mps: float) -> Instruction:
    """The instruction to brake to a speed with an effort; the mode follows from the effort."""
    return Instruction(mode=braking_mode(effort), speed_mps=to_mps, effort_ratio=-effort)


def alike(one: Instruction, other: Instruction) -> bool:
    """Whether two instructions are of the same kind and lead to the same speed."""
    same = KIND_OF.get(one.mode) is KIND_OF.get(other.mode) is not None
    return same and abs(one.speed_mps - other.speed_mps) < SAME_MPS


def repeats(one: Instruction, before: Instruction) -> bool:
    """Whether an instruction repeats the one before; traction with another effort does not."""
    return alike(one, before) and not (one.mode in TRACTION and one.effort_ratio != before.effort_ratio)


def is_own_end(one: Instruction, before: Instruction) -> bool:
    """Whether an instruction holds the speed to which the one before it leads."""
    return one.mode is Regime.CRUISE and abs(one.speed_mps - before.speed_mps) < SAME_MPS
