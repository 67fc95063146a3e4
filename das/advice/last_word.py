"""The last word: it judges every advice once more before the advice is sent, and replaces what is not safe.

The rule: assume that the driver does what is shown until the advice expires, and then brakes fully, wherever the train
may really be. Then the train exceeds no limit by more than `LIMIT_TOLERANCE_MPS` and passes no stop by more than
`STOP_TOLERANCE_M`. Speeds shown for places further ahead are no higher than allowed there. The judgement uses its own
model, `das.advice.braking_model`, and shares nothing with the planner, the guide or the display.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from das.advice import last_word_kernels as kernels
from das.advice import wording
from das.advice.advice import Advice, Cause, Guidance, Instruction, Source, Withdrawal
from das.advice.braking_model import (
    LONGEST_S,
    STOPPED_MPS,
    BrakingBasis,
    BrakingModel,
    Consequences,
    Doing,
    Excess,
    Needed,
)
from das.advice.reason import NO_REASON, Reason, ReasonCode
from das.advice.regimes import BRAKES, Regime
from das.advice.shown import SAME_READING_MPS, step_below, target_below
from das.domain.units import NS
from das.estimate.estimate import Estimate

MAY_BE_UNKNOWN = (
    "next_change_m",
    "next_change_s",
    "predicted_deviation_s",
    "buffer_ratio",
    "energy_to_go_j",
)
"""Figures of advice that may be unknown (NaN), but never infinite."""

_STANDS = (Regime.STOP, Regime.DEPART)


class Part(StrEnum):
    """The parts of advice that the last word judges; the values are their names in events."""

    STATE = "position and speed"
    EFFORT = "advised effort"
    ADVISED_SPEED = "advised speed"
    DISPLAY_SPEED = "displayed speed"
    HORIZON = "horizon"
    LIMIT = "limit"
    FIGURES = "infinite figures"
    GUIDE = "guide"
    GUIDE_SPEED = "speed of the guide"
    GUIDE_NEXT = "next instruction"


class Act(NamedTuple):
    """One replacement by the last word: which part, the speed it would have led to, and the highest safe speed (m/s).

    The part now shows the speed `instead_mps` or the wheel force `instead_n` (NaN: not applicable).
    """

    part: Part
    value_mps: float
    bound_mps: float
    instead_mps: float = math.nan
    instead_n: float = math.nan


class LastWord:
    """Judges each advice by itself. All it remembers is the braking model of the last section and train."""

    def __init__(self) -> None:
        self._basis: BrakingBasis | None = None
        self._model: BrakingModel | None = None

    def judge(self, advice: Advice, here: Estimate, basis: BrakingBasis) -> tuple[Advice, tuple[Act, ...]]:
        """The advice itself if it is safe, else a safe one, and the replacements made in it."""
        if advice.mode is Regime.NONE:
            return advice, ()
        if not _finite(here.s_m, here.speed_mps, here.position_sd_m):
            return _withdrawn(advice), (Act(Part.STATE, here.speed_mps, math.nan),)
        if self._model is None or basis != self._basis:
            self._basis, self._model = basis, BrakingModel(basis)
        return _Judgement(advice, here, self._model).result()


class _Judgement:
    """The judgement of one advice, part by part; it collects the replacements."""

    def __init__(self, advice: Advice, here: Estimate, model: BrakingModel) -> None:
        self._advice, self._model = advice, model
        self._train = Consequences(model, here, (advice.valid_until_ns - advice.time_ns) * NS)
        self._told_from_m = advice.s_m
        """Distances in the advice count from here: the start of the section for a train just before it."""
        self._bound_mps = model.bound_mps(self._train.ahead_m)
        self._acts: list[Act] = []

    def result(self) -> tuple[Advice, tuple[Act, ...]]:
        """The advice as it may be sent, and the replacements made in it."""
        self._judge_figures()
        self._judge_effort()
        self._judge_speeds()
        self._judge_horizon()
        self._judge_guide()
        return self._advice, tuple(self._acts)

    def _replace(self, act: Act, **changes: Any) -> None:
        self._acts.append(act)
        self._advice = replace(self._advice, **changes)

    def _judge_figures(self) -> None:
        """Replace infinite figures by NaN: not known."""
        infinite = [name for name in MAY_BE_UNKNOWN if math.isinf(getattr(self._advice, name))]
        if infinite:
            self._replace(Act(Part.FIGURES, math.inf, math.nan), **dict.fromkeys(infinite, math.nan))

    # --- the full advice ---------------------------------------------------------------------------------------------

    def _judge_effort(self) -> None:
        """Judge the advised force, together with the speeds and forces shown for the next seconds."""
        advice = self._advice
        if advice.mode in _STANDS and self._train.v_mps < STOPPED_MPS:
            return
        shown = advice.advised_speed_mps, advice.advised_force_n, advice.advised_force_ratio
        if not _finite(*shown, *advice.horizon_speed_mps, *advice.horizon_force_n) or not advice.horizon_speed_mps:
            self._brake(Excess(self._train.v_mps, math.nan))
            return
        excess = self._train.unavailable(advice.advised_force_n, min(self._train.v_mps, advice.advised_speed_mps))
        excess = excess or self._train.excess(list(self._shown()), self._train.valid_s)
        if excess is not None:
            self._brake(excess)

    def _shown(self) -> Iterator[Doing]:
        """What the full advice tells the driver to do: the advised force until the next change, then the horizon's.

        If the horizon shows a brake becoming stronger, the driver follows it. He uses traction only up to the speeds
        shown, and stops where the speed shown is 0, whatever the force.
        """
        advice = self._advice
        speeds = (advice.advised_speed_mps, *advice.horizon_speed_mps)
        forces = (advice.advised_force_n, *advice.horizon_force_n)
        holds = advice.mode in (Regime.CRUISE, Regime.STOP)
        changes_s = advice.next_change_s if _finite(advice.next_change_s) else math.inf
        for k in range(min(math.ceil(self._train.valid_s) + 1, len(speeds) - 1)):
            to_mps, changed = speeds[k + 1], k > 0 and k + 0.5 > changes_s
            then_n = forces[min(k, len(forces) - 1)]
            kept_n = min(forces[0], then_n) if forces[0] < 0 else forces[0]
            force_n = (then_n if changed else kept_n) if to_mps > 0 else -math.inf
            speed_mps = max(speeds[k], to_mps) if force_n > 0 else 0.0
            until_s = k + 0.5 if changed or k + 0.5 < changes_s else changes_s
            yield Doing(until_s, force_n, to_mps if holds else speed_mps, holds)

    def _brake(self, excess: Excess) -> None:
        """Replace the whole advice by braking as strong as needed."""
        force_n, needed = self._train.braking()
        allowed_mps, v_mps = self._model.allowed_mps(self._train.ahead_m), self._train.v_mps
        seconds = max(len(self._advice.horizon_speed_mps), 1)
        mode = self._train.mode_of(force_n)
        most_n = self._model.most_brake_n(v_mps)
        self._replace(
            Act(Part.EFFORT, excess.value_mps, excess.bound_mps, instead_n=force_n),
            mode=mode,
            next_mode=Regime.STOP,
            next_change_m=math.nan,
            next_change_s=math.nan,
            advised_speed_mps=min(v_mps, allowed_mps),
            display_speed_mps=step_below(min(v_mps, allowed_mps)),
            advised_force_n=force_n,
            advised_force_ratio=force_n / most_n if most_n > 0 else 0.0,
            **self._train.braked_horizon(force_n, needed.speed_mps, seconds),
            source=Source.FALLBACK,
            reason=self._reason(needed) if force_n < 0 else NO_REASON,
        )

    def _reason(self, needed: Needed) -> Reason:
        """Why the train must brake: it is too fast already, or for the limit or the stop that needs it."""
        if needed.at_m >= self._model.end_m:
            return Reason(code=ReasonCode.STOP, stop=self._model.end_stop)
        if needed.speed_mps < self._model.limit_mps(self._train.ahead_m):
            return Reason(code=ReasonCode.LIMIT, speed_mps=needed.speed_mps, at_m=needed.at_m)
        excess_mps = self._train.v_mps - needed.speed_mps
        return Reason(code=ReasonCode.TOO_FAST, speed_mps=excess_mps) if excess_mps > 0 else NO_REASON

    def _judge_speeds(self) -> None:
        """Judge the speeds shown for the present position, and the limit."""
        advice, allowed_mps = self._advice, self._model.allowed_mps(self._train.ahead_m)
        for part, name, shown_mps in (
            (Part.ADVISED_SPEED, "advised_speed_mps", advice.advised_speed_mps),
            (Part.DISPLAY_SPEED, "display_speed_mps", advice.display_speed_mps),
        ):
            if math.isnan(shown_mps) and part is not Part.ADVISED_SPEED:
                continue  # This speed is not shown.
            if not shown_mps <= self._bound_mps + SAME_READING_MPS:
                instead_mps = allowed_mps if part is Part.ADVISED_SPEED else step_below(allowed_mps)
                self._replace(Act(part, shown_mps, self._bound_mps, instead_mps), **{name: instead_mps})
        limit_mps = self._model.highest_limit_mps(self._train.behind_m - 1.0, self._train.ahead_m + 1.0)
        if self._train.s_m < self._model.end_m and not advice.limit_mps <= limit_mps + SAME_READING_MPS:
            instead_mps = self._model.limit_mps(self._train.ahead_m)
            self._replace(Act(Part.LIMIT, advice.limit_mps, limit_mps, instead_mps), limit_mps=instead_mps)

    def _judge_horizon(self) -> None:
        """Lower each speed of the horizon that is above what is allowed at the place it leads to."""
        advice, (nodes_m, places, _) = self._advice, self._model.line
        speeds = np.array(advice.horizon_speed_mps, dtype=float)
        kept = np.empty(len(speeds))
        begin = self._train.s_m, advice.advised_speed_mps, SAME_READING_MPS
        first, bound_mps = kernels.keep_horizon(nodes_m, places, speeds, *begin, kept)
        if first >= 0:
            forces = tuple(n if k < first else min(n, 0.0) for k, n in enumerate(advice.horizon_force_n))
            act = Act(Part.HORIZON, float(speeds[first]), bound_mps, float(kept[first]))
            self._replace(act, horizon_speed_mps=tuple(kept.tolist()), horizon_force_n=forces)

    # --- the guide ---------------------------------------------------------------------------------------------------

    def _judge_guide(self) -> None:
        """Judge the guide's present instruction, with its force and the reference's, and those that it announces."""
        guide = self._advice.guide
        if guide is None or guide.now.mode in (Regime.NONE, *_STANDS):
            return
        excess = self._excess_of(guide)
        if excess is not None:
            guide = self._safe_guide(guide)
            self._replace(Act(Part.GUIDE, *excess, instead_n=guide.force_n), guide=guide)
        self._judge_speed_of(guide.now)
        self._judge_following()

    def _excess_of(self, guide: Guidance) -> Excess | None:
        """The excess of a driver who does what the guide says, with the force shown or with the reference's, if any.

        Where a brake is shown without an effort, he brakes by eye to the mark, and finds it; a limit before it he may
        miss.
        """
        now = guide.now
        if not _finite(guide.force_n, guide.reference_force_n, now.speed_mps, now.way_m, now.in_s, guide.target_m):
            return Excess(self._train.v_mps, math.nan)
        by_eye = now.mode in BRAKES and math.isnan(guide.lever_ratio) and not self._train.sees_only_mark
        for force_n in {self._train.by_eye_n() if by_eye else guide.force_n, guide.reference_force_n}:
            excess = self._train.unavailable(force_n, self._train.v_mps)
            excess = excess or self._train.excess(self._led(guide, force_n), self._train.valid_s)
            if excess is not None:
                return excess
        return None

    def _led(self, guide: Guidance, force_n: float) -> list[Doing]:
        """What a driver who follows the guide does until the next change and after it.

        Until an instruction is due, he keeps his speed.
        """
        now, following = guide.now, guide.following
        after = following[0] if following and _finite(following[0].in_s, following[0].speed_mps) else None
        waiting = [Doing(now.in_s, 0.0, self._train.v_mps, True)] if now.in_s > 0 else []
        # The effort shown stays the same, so the braking force grows with that of the motors.
        of_n = self._model.electric_n(self._train.v_mps)
        doing = _instructed(now, force_n, math.inf if after is None else after.in_s)
        doings = [*waiting, doing._replace(of_n=of_n)]
        if after is None:
            return doings
        most_n = self._train.brake_n(-1.0) if after.mode in BRAKES else self._model.traction_n(self._train.v_mps)
        brakes = after.mode in BRAKES and _finite(after.effort_ratio)
        return [*doings, _instructed(after, self._train.brake_n(after.effort_ratio) if brakes else most_n, math.inf)]

    def _safe_guide(self, guide: Guidance) -> Guidance:
        """The guide's advice with the least change that is safe.

        That is without what it announces; or to go no faster than is allowed here, for an instruction that would only
        become unsafe because the train speeds up; or to brake as strongly as needed.
        """
        held_mps = step_below(min(guide.now.speed_mps, self._model.allowed_mps(self._train.ahead_m)))
        now = Instruction(mode=Regime.CRUISE, speed_mps=held_mps)
        held = replace(guide, now=now, force_n=0.0, reference_force_n=0.0, lever_ratio=math.nan)
        choices = [replace(guide, following=()), held, replace(held, following=())]
        if guide.now.mode in BRAKES or not held_mps > STOPPED_MPS:
            choices = choices[:1]
        safe = (one for one in choices if self._excess_of(one) is None)
        return next(safe, None) or self._braked_guide(guide)

    def _braked_guide(self, guide: Guidance) -> Guidance:
        """The guide's advice, replaced by an instruction to brake as strongly as needed.

        The announced instructions that come after this braking are kept.
        """
        force_n, needed = self._train.braking()
        way_m, scale_n = max(needed.at_m - self._train.s_m, 0.0), self._train.brake_n(1.0)
        most_n = self._model.most_brake_n(self._train.v_mps)
        now = Instruction(
            mode=self._train.mode_of(force_n),
            speed_mps=step_below(needed.speed_mps),
            effort_ratio=force_n / scale_n if scale_n > 0 else 0.0,
        )
        return replace(
            guide,
            now=now,
            following=tuple(one for one in guide.following if one.way_m > way_m),
            target_m=way_m,
            target_s=2.0 * way_m / max(self._train.v_mps + needed.speed_mps, STOPPED_MPS),
            force_n=force_n,
            reference_force_n=force_n,
            lever_ratio=force_n / most_n if most_n > 0 else 0.0,
            reason=self._reason(needed),
        )

    def _judge_speed_of(self, now: Instruction) -> None:
        """Lower the speed of the present instruction to what is allowed.

        A speed to reach or to hold is judged here and where the instruction is due; a speed to brake or coast to, where
        the braking or coasting ends: at its goal, or where the next instruction begins.
        """
        guide, model = self._advice.guide, self._model
        assert guide is not None
        leads = now.mode in (*BRAKES, Regime.COAST)
        ahead_m = self._train.ahead_m, self._told_from_m + now.way_m
        ends_m = min([guide.target_m, *(one.way_m for one in guide.following[:1] if _finite(one.way_m))])
        places_m = (self._told_from_m + ends_m,) if leads else ahead_m
        bound_mps = max(model.bound_mps(place_m) for place_m in places_m) + SAME_READING_MPS
        if not now.speed_mps <= bound_mps:
            rounded = target_below if now.mode is Regime.COAST else step_below
            instead_mps = rounded(max(model.allowed_mps(place_m) for place_m in places_m))
            act = Act(Part.GUIDE_SPEED, now.speed_mps, bound_mps, instead_mps)
            self._replace(act, guide=replace(guide, now=replace(now, speed_mps=instead_mps)))

    def _judge_following(self) -> None:
        """Lower announced speeds that are above the limit at their place, and drop a brake announced too late."""
        guide = self._advice.guide
        assert guide is not None
        kept: list[Instruction] = []
        first: Act | None = None
        for k, one in enumerate(guide.following):
            excess = self._late(guide) if k == 0 and one.mode in BRAKES else None
            if excess is not None or not _finite(one.speed_mps, one.way_m, one.in_s):
                first = first or Act(Part.GUIDE_NEXT, *(excess or Excess(one.speed_mps, math.nan)))
                break  # The instructions after it no longer apply.
            at_m = self._told_from_m + one.way_m
            # A speed to reach or to hold applies where it begins; a speed to coast or brake to, at the end of that.
            ends = k + 1 < len(guide.following) and one.mode in (*BRAKES, Regime.COAST)
            to_m = self._told_from_m + guide.following[k + 1].way_m if ends else at_m
            limit_mps = self._model.highest_limit_mps(at_m + 1.0, to_m + 1.0)
            if one.speed_mps > limit_mps + SAME_READING_MPS:
                first = first or Act(Part.GUIDE_NEXT, one.speed_mps, limit_mps, step_below(limit_mps))
                one = replace(one, speed_mps=step_below(limit_mps))  # noqa: PLW2901
            kept.append(one)
        if first is not None:
            self._replace(first, guide=replace(guide, following=tuple(kept)))

    def _late(self, guide: Guidance) -> Excess | None:
        """The excess of a driver who does what is shown now until the announced brake is due; None if none."""
        in_s = guide.following[0].in_s
        if not in_s <= LONGEST_S:
            return None
        led, now = self._led(guide, guide.force_n)[:-1], guide.now
        if now.mode in (Regime.FULL_TRACTION, Regime.REDUCED_TRACTION):
            led[-1] = led[-1]._replace(holds=True)  # He accelerates to that speed and then holds it.
        excess = self._train.excess(led, in_s, in_s)
        if excess is None or now.mode is not Regime.COAST or now.speed_mps <= self._train.v_mps:
            return excess
        # He rolls up to that speed and is then told to hold it: he is no faster than one who holds it at once.
        return self._train.excess([*led[:-1], led[-1]._replace(speed_mps=now.speed_mps, holds=True)], in_s, in_s)


def _instructed(one: Instruction, force_n: float, until_s: float) -> Doing:
    """What a driver does who follows an instruction with a wheel force (N) until a time (s)."""
    if one.mode is Regime.CRUISE:
        return Doing(until_s, 0.0, one.speed_mps, True)
    return Doing(until_s, 0.0, 0.0) if one.mode is Regime.COAST else Doing(until_s, force_n, one.speed_mps)


def _withdrawn(advice: Advice) -> Advice:
    """No advice: without position and speed the advice cannot be judged."""
    why = Withdrawal(Cause.POSITION_REJECTED, wording.NOTHING_TO_JUDGE_BY)
    return Advice(
        time_ns=advice.time_ns,
        position_time_ns=advice.position_time_ns,
        cause=why.cause,
        reason=Reason.of_text(wording.withdrawal(why)),
        valid_until_ns=advice.time_ns,
    )


def _finite(*values: float) -> bool:
    return all(map(math.isfinite, values))
