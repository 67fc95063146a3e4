"""The guide in the cab: the present instruction, its speed, and the next changes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from das.advice import wording
from das.advice.advice import Instruction
from das.advice.reason import Reason
from das.advice.regimes import BRAKES, TRACTION, Regime, departure_regime
from das.advice.wording import Language
from das.domain.units import KMH
from sim.drivers.cab import AdviceView
from sim.drivers.presentations.presenter import EFFORT_STEP_RATIO, Presenter, Shown, ShownRegime, SpeedIs, known_mode

if TYPE_CHECKING:
    from sim.drivers.tracking import GuideFollower


class GuidePresenter(Presenter):
    """A display of the guide's present instruction with speed, effort and reason, and of the next two changes."""

    number = 4
    phrase = "the guide in the cab (what to do now, up to which speed, and what comes next)"
    meaning = "what to do now, up to which speed and with what effort, and the next two changes; it changes seldom"
    needs_guide = True

    def show(self, blank: AdviceView, advice: Any, deviation_s: float) -> AdviceView | None:
        guide = advice.guide
        if guide is None or int(guide.now.mode) == Regime.NONE:
            return None
        mode = int(guide.now.mode)
        return replace(
            blank,
            mode=mode,
            speed_mps=guide.now.speed_mps,
            display_speed_mps=guide.now.speed_mps,
            lever_ratio=guide.lever_ratio,
            force_n=guide.reference_force_n,
            **_changes([_departure(guide.now)] if mode == Regime.DEPART else guide.following),
            due_s=guide.now.in_s,
            target_way_m=guide.target_m,
            reason=Reason.read(guide.reason),
        )

    def shown_mode(self, advice: Any) -> ShownRegime:
        if not advice.HasField("guide"):
            return super().shown_mode(advice)
        now = advice.guide.now
        return ShownRegime(known_mode(now.mode), float(now.speed_mps), Reason.read(advice.guide.reason))

    def speed_is(self, mode: int) -> SpeedIs:
        return SpeedIs.TO_HAVE if mode == Regime.CRUISE else SpeedIs.TO_REACH

    def read(self, view: AdviceView) -> Shown:
        return super().read(view)._replace(effort=None if math.isnan(view.lever_ratio) else _effort_steps(view))

    def item(self, view: AdviceView) -> tuple[int, ...]:
        return (
            view.mode,
            round(view.speed_mps / KMH),
            _effort_steps(view),
        )

    def mode_words(self, number: int, language: Language = Language.EN) -> str:
        return wording.instruction_words(known_mode(number), language)

    def words_before_speed(self, number: int, language: Language = Language.EN) -> str:
        return wording.words_before_speed(known_mode(number), language)

    def instruction(self, number: int, speed: str, language: Language = Language.EN) -> str:
        return f"{self.words_before_speed(number, language)} {speed}" if speed else self.mode_words(number, language)

    def follower(self) -> GuideFollower:
        from sim.drivers.tracking import GuideFollower  # of drivers alone: a report on a recorded display needs none

        return GuideFollower()


def _changes(ahead: Sequence[Any]) -> dict[str, Any]:
    """The fields of the first two changes ahead."""
    found: dict[str, Any] = {}
    for which, change in zip(("next", "second"), ahead, strict=False):
        found |= {
            f"{which}_mode": int(change.mode),
            f"{which}_change_s": change.in_s,
            f"{which}_change_m": change.way_m,
            f"{which}_speed_mps": change.speed_mps,
            f"{which}_effort_ratio": change.effort_ratio,
        }
    return found


def _effort_steps(view: AdviceView) -> int:
    """The effort in steps of the display (< 0: brake); an instruction to accelerate or brake shows at least one."""
    if math.isnan(view.lever_ratio):
        return 0
    steps = round(view.lever_ratio / EFFORT_STEP_RATIO)
    return steps or int(view.mode in TRACTION) - int(view.mode in BRAKES)


def _departure(now: Any) -> Instruction:
    """The instruction for a train that the guide advises to depart; due as soon as the train is cleared."""
    mode = departure_regime(now.effort_ratio)
    return Instruction(mode=mode, speed_mps=now.speed_mps, effort_ratio=now.effort_ratio, way_m=math.nan, in_s=math.nan)


PRESENTER: Final = GuidePresenter()
