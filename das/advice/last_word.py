"""The last word: the check of every advice message before it is sent; unsafe parts are replaced.

The rule: a driver who does what is shown until the advice expires, and then brakes fully, wherever the train may be,
exceeds no limit by more than `LIMIT_TOLERANCE_MPS` and passes no stop by more than `STOP_TOLERANCE_M`. The model of
line and train shares no code with the solver, so that an error in the solver is not repeated here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.advice import last_word_kernels as kernels
from das.advice.advice import Advice, Cause, Guidance, Instruction, Source
from das.advice.reason import NO_REASON, Reason, ReasonCode
from das.advice.regimes import BRAKES, FULL_RATIO, Regime
from das.advice.shown import SAME_READING_MPS, step_below, target_below
from das.domain.conditions import Conditions
from das.domain.restriction import Restriction
from das.domain.route import Route
from das.domain.units import KMH, KN, NS, STANDARD_GRAVITY_MPS2
from das.domain.vehicle import BrakePolicy, Vehicle
from das.estimate.estimate import Estimate

Floats = NDArray[np.float64]
LIMIT_TOLERANCE_MPS = 0.5
"""Half of the 1 m/s by which no train may ever exceed a limit or braking curve; the other half is for the driver."""
STOP_TOLERANCE_M = 5.0
"""Half of the 10 m by which no train may ever pass a stop; the driver finds the mark by eye, from about 2 m/s on."""
STEP_M = 20.0
"""Longest step (m) of the braking curve, which also has a step wherever a limit or the supply changes."""
BEYOND_TOP_MPS = 20.0
"""Speed above the train's top speed (m/s) up to which forces are tabulated."""
BEHIND_M = 100.0
"""Distance before the section (m) at which the model begins: a train about to depart may still stand there."""
SDS_AHEAD = 2.0
"""Number of standard deviations by which the train is assumed to be ahead of its estimated position."""
BY_EYE_M = 10.0
"""Distance (m) from which the driver sees the mark: nearer to it, the estimated position counts."""
FORCE_RATIO = 1.02
"""Multiple of the largest force at a speed up to which a force counts as available: the difference is rounding."""
LONGEST_S = 30.0
"""Longest time (s) ahead for which announced braking is judged; later braking will be judged again."""
_STANDS = (Regime.STOP, Regime.DEPART)


class Part(StrEnum):
    """The parts of advice that the last word judges; the values are their names in events."""

    STATE = "position and speed"
    EFFORT = "advised effort"
    ADVISED_SPEED = "advised speed"
    DISPLAY_SPEED = "displayed speed"
    HORIZON = "horizon"
    LIMIT = "limit"
    GUIDE = "guide"
    GUIDE_SPEED = "speed of the guide"
    GUIDE_NEXT = "next instruction"


class Act(NamedTuple):
    """A replacement by the last word: the part, the speed it would have led to, and the highest safe speed (m/s).

    The part now shows the speed `instead_mps` or the wheel force `instead_n` (NaN: not applicable).
    """

    part: Part
    value_mps: float
    bound_mps: float
    instead_mps: float = math.nan
    instead_n: float = math.nan

    @property
    def words(self) -> str:
        """The replacement as text."""
        value = "not a number" if math.isnan(self.value_mps) else f"{self.value_mps / KMH:.1f} km/h"
        bound = "" if math.isnan(self.bound_mps) else f" where {self.bound_mps / KMH:.1f} km/h is the most"
        if math.isfinite(self.instead_n):
            instead = f"{self.instead_n / KN:.0f} kN is advised instead"
        elif math.isfinite(self.instead_mps):
            instead = f"{self.instead_mps / KMH:.1f} km/h is advised instead"
        else:
            instead = "it is omitted"
        return f"last word: {self.part}: {value}{bound}; {instead}"


class LastWord:
    """Checks each advice message by itself; only the braking model of the last section and train is remembered."""

    def __init__(self) -> None:
        self._model: BrakingModel | None = None

    def judge(self, advice: Advice, here: Estimate, basis: BrakingBasis) -> tuple[Advice, tuple[Act, ...]]:
        """The advice itself if it is safe, else a safe one, and the replacements made in it."""
        if advice.mode is Regime.NONE:
            return advice, ()
        if not _finite(here.s_m, here.speed_mps, here.position_sd_m):
            withdrawn = Advice(
                time_ns=advice.time_ns,
                position_time_ns=advice.position_time_ns,
                cause=Cause.POSITION_REJECTED,
                reason=Reason.of_text("no advice: position or speed unknown"),
                valid_until_ns=advice.time_ns,
            )
            return withdrawn, (Act(Part.STATE, here.speed_mps, math.nan),)
        if self._model is None or basis != self._model.basis:
            self._model = BrakingModel(basis)
        return _Judgement(advice, here, self._model).result()


class _Judgement:
    """The check of one advice message, part by part; it collects the replacements."""

    def __init__(self, advice: Advice, here: Estimate, model: BrakingModel) -> None:
        self._advice, self._model = advice, model
        self._v_mps, self._s_m = max(here.speed_mps, 0.0), here.s_m
        self._valid_s = min(max((advice.valid_until_ns - advice.time_ns) * NS, kernels.STEP_S), LONGEST_S)
        deviation_m = SDS_AHEAD * here.position_sd_m
        self._behind_m = here.s_m - deviation_m
        self._ahead_m = min(here.s_m + deviation_m, max(here.s_m, model.end_m - BY_EYE_M))
        """The furthest position (m) at which the train may be."""
        self._bound_mps = model.bound_mps(self._ahead_m)
        self._acts: list[Act] = []

    def result(self) -> tuple[Advice, tuple[Act, ...]]:
        """The advice that may be sent, and the replacements made in it."""
        self._judge_effort()
        self._judge_speeds()
        self._judge_horizon()
        self._judge_guide()
        return self._advice, tuple(self._acts)

    def _replace(self, act: Act, **changes: Any) -> None:
        self._acts.append(act)
        self._advice = replace(self._advice, **changes)

    # --- the full advice ---------------------------------------------------------------------------------------------

    def _judge_effort(self) -> None:
        advice = self._advice
        if advice.mode in _STANDS and self._v_mps < kernels.STOPPED_MPS:
            return
        shown = advice.advised_speed_mps, advice.advised_force_n, advice.advised_force_ratio
        if not _finite(*shown, *advice.horizon_speed_mps, *advice.horizon_force_n) or not advice.horizon_speed_mps:
            self._brake(Excess(self._v_mps, math.nan))
            return
        excess = self._unavailable(advice.advised_force_n, min(self._v_mps, advice.advised_speed_mps))
        excess = excess or self._excess(list(self._shown()), self._valid_s)
        if excess is not None:
            self._brake(excess)

    def _shown(self) -> Iterator[Doing]:
        """The driver's actions under the full advice: the advised force until the next change, then the horizon's.

        If the horizon shows a brake that becomes stronger, the driver follows it. The driver uses traction only up to
        the speeds shown, and stops where the speed shown is 0, whatever the force.
        """
        advice = self._advice
        speeds = (advice.advised_speed_mps, *advice.horizon_speed_mps)
        forces = (advice.advised_force_n, *advice.horizon_force_n)
        holds = advice.mode in (Regime.CRUISE, Regime.STOP)
        changes_s = advice.next_change_s if _finite(advice.next_change_s) else math.inf
        for k in range(min(math.ceil(self._valid_s) + 1, len(speeds) - 1)):
            to_mps, changed = speeds[k + 1], k > 0 and k + 0.5 > changes_s
            then_n = forces[min(k, len(forces) - 1)]
            kept_n = min(forces[0], then_n) if forces[0] < 0 else forces[0]
            force_n = (then_n if changed else kept_n) if to_mps > 0 else -math.inf
            speed_mps = max(speeds[k], to_mps) if force_n > 0 else 0.0
            until_s = k + 0.5 if changed or k + 0.5 < changes_s else changes_s
            yield Doing(until_s, force_n, to_mps if holds else speed_mps, holds)

    def _brake(self, excess: Excess) -> None:
        force_n, needed = self._braking()
        shown_mps = min(self._v_mps, self._model.allowed_mps(self._ahead_m))
        self._replace(
            Act(Part.EFFORT, excess.value_mps, excess.bound_mps, instead_n=force_n),
            mode=self._mode_of(force_n),
            next_mode=Regime.STOP,
            next_change_m=math.nan,
            next_change_s=math.nan,
            advised_speed_mps=shown_mps,
            display_speed_mps=step_below(shown_mps),
            advised_force_n=force_n,
            advised_force_ratio=self._lever_ratio(force_n),
            **self._braked_horizon(force_n, needed.speed_mps, max(len(self._advice.horizon_speed_mps), 1)),
            source=Source.FALLBACK,
            reason=self._reason(needed) if force_n < 0 else NO_REASON,
        )

    def _reason(self, needed: Needed) -> Reason:
        """Why the train must brake: it is too fast already, or the limit or stop that it must brake for."""
        if needed.at_m >= self._model.end_m:
            return Reason(code=ReasonCode.STOP, stop=self._model.basis.route.stop_name_at(self._model.end_m))
        if needed.speed_mps < self._model.limit_mps(self._ahead_m):
            return Reason(code=ReasonCode.LIMIT, speed_mps=needed.speed_mps, at_m=needed.at_m)
        excess_mps = self._v_mps - needed.speed_mps
        return Reason(code=ReasonCode.TOO_FAST, speed_mps=excess_mps) if excess_mps > 0 else NO_REASON

    def _judge_speeds(self) -> None:
        advice, allowed_mps = self._advice, self._model.allowed_mps(self._ahead_m)
        for part, name in ((Part.ADVISED_SPEED, "advised_speed_mps"), (Part.DISPLAY_SPEED, "display_speed_mps")):
            shown_mps = getattr(advice, name)
            if not shown_mps <= self._bound_mps + SAME_READING_MPS:
                instead_mps = allowed_mps if part is Part.ADVISED_SPEED else step_below(allowed_mps)
                self._replace(Act(part, shown_mps, self._bound_mps, instead_mps), **{name: instead_mps})
        limit_mps = self._model.highest_limit_mps(self._behind_m - 1.0, self._ahead_m + 1.0)
        if self._s_m < self._model.end_m and not advice.limit_mps <= limit_mps + SAME_READING_MPS:
            instead_mps = self._model.limit_mps(self._ahead_m)
            self._replace(Act(Part.LIMIT, advice.limit_mps, limit_mps, instead_mps), limit_mps=instead_mps)

    def _judge_horizon(self) -> None:
        """Lower each speed of the horizon that is above its bound to what is allowed at the place it leads to."""
        advice, (nodes_m, places, _) = self._advice, self._model.line
        speeds = np.array(advice.horizon_speed_mps, dtype=float)
        kept = np.empty(len(speeds))
        begin = self._s_m, advice.advised_speed_mps, SAME_READING_MPS
        first, bound_mps = kernels.keep_horizon(nodes_m, places, speeds, *begin, kept)
        if first >= 0:
            forces = tuple(n if k < first else min(n, 0.0) for k, n in enumerate(advice.horizon_force_n))
            act = Act(Part.HORIZON, float(speeds[first]), bound_mps, float(kept[first]))
            self._replace(act, horizon_speed_mps=tuple(kept.tolist()), horizon_force_n=forces)

    # --- the guide ---------------------------------------------------------------------------------------------------

    def _judge_guide(self) -> None:
        guide = self._advice.guide
        if guide is None or guide.now.mode in (Regime.NONE, *_STANDS):
            return
        excess = self._excess_of(guide)
        if excess is not None:
            guide = self._safe_guide(guide)
            self._replace(Act(Part.GUIDE, *excess, instead_n=guide.force_n), guide=guide)
        self._judge_following(self._with_safe_speed(guide))

    def _excess_of(self, guide: Guidance) -> Excess | None:
        """The excess of a driver who follows the guide, with the force shown or with the reference's, if any.

        If a brake is shown without an effort, the driver brakes by eye and stops at the mark, but may exceed a limit.
        """
        now = guide.now
        if not _finite(guide.force_n, guide.reference_force_n, now.speed_mps, now.way_m, now.in_s, guide.target_m):
            return Excess(self._v_mps, math.nan)
        by_eye = now.mode in BRAKES and math.isnan(guide.lever_ratio) and not self._sees_only_mark
        for force_n in {self._by_eye_n() if by_eye else guide.force_n, guide.reference_force_n}:
            excess = self._unavailable(force_n, self._v_mps)
            excess = excess or self._excess(self._led(guide, force_n), self._valid_s)
            if excess is not None:
                return excess
        return None

    def _led(self, guide: Guidance, force_n: float) -> list[Doing]:
        """The actions of a driver who follows the guide, until the next change and after it.

        Until an instruction is due, the driver keeps the present speed.
        """
        now, following = guide.now, guide.following
        after = following[0] if following and _finite(following[0].in_s, following[0].speed_mps) else None
        waiting = [Doing(now.in_s, 0.0, self._v_mps, True)] if now.in_s > 0 else []
        # The effort shown stays the same, so the braking force grows with that of the motors.
        of_n = self._model.force_n(kernels.ELECTRIC, self._v_mps)
        doing = _instructed(now, force_n, math.inf if after is None else after.in_s)
        doings = [*waiting, doing._replace(of_n=of_n)]
        if after is None:
            return doings
        if after.mode in BRAKES:
            then_n = self._brake_n(after.effort_ratio if _finite(after.effort_ratio) else -1.0)
        else:
            then_n = self._model.force_n(kernels.TRACTION, self._v_mps)
        return [*doings, _instructed(after, then_n, math.inf)]

    def _safe_guide(self, guide: Guidance) -> Guidance:
        """The guide's advice with the least change that is safe.

        The change drops what is announced, or limits the speed to what is allowed here, or brakes as needed.
        """
        held_mps = step_below(min(guide.now.speed_mps, self._model.allowed_mps(self._ahead_m)))
        now = Instruction(mode=Regime.CRUISE, speed_mps=held_mps)
        held = replace(guide, now=now, force_n=0.0, reference_force_n=0.0, lever_ratio=math.nan)
        choices = [replace(guide, following=()), held, replace(held, following=())]
        if guide.now.mode in BRAKES or not held_mps > kernels.STOPPED_MPS:
            choices = choices[:1]
        safe = (one for one in choices if self._excess_of(one) is None)
        return next(safe, None) or self._braked_guide(guide)

    def _braked_guide(self, guide: Guidance) -> Guidance:
        """The guide's advice to brake as strongly as needed; instructions announced for after this braking are kept."""
        force_n, needed = self._braking()
        way_m, scale_n = max(needed.at_m - self._s_m, 0.0), self._brake_n(1.0)
        now = Instruction(
            mode=self._mode_of(force_n),
            speed_mps=step_below(needed.speed_mps),
            effort_ratio=force_n / scale_n if scale_n > 0 else 0.0,
        )
        return replace(
            guide,
            now=now,
            following=tuple(one for one in guide.following if one.way_m > way_m),
            target_m=way_m,
            target_s=2.0 * way_m / max(self._v_mps + needed.speed_mps, kernels.STOPPED_MPS),
            force_n=force_n,
            reference_force_n=force_n,
            lever_ratio=self._lever_ratio(force_n),
            reason=self._reason(needed),
        )

    def _with_safe_speed(self, guide: Guidance) -> Guidance:
        """The guide's advice with the speed of its present instruction lowered to what is allowed.

        A speed to reach or to hold is judged here and where the instruction is due; a speed to brake or coast to, where
        the braking or coasting ends: at its goal, or where the next instruction begins.
        """
        now, model = guide.now, self._model
        ends_m = min([guide.target_m, *(one.way_m for one in guide.following[:1] if _finite(one.way_m))])
        leads = now.mode in (*BRAKES, Regime.COAST)
        at_m = self._advice.s_m + (ends_m if leads else now.way_m)
        here_m = at_m if leads else self._ahead_m
        bound_mps = max(model.bound_mps(at_m), model.bound_mps(here_m)) + SAME_READING_MPS
        if now.speed_mps <= bound_mps:
            return guide
        rounded = target_below if now.mode is Regime.COAST else step_below
        instead_mps = rounded(max(model.allowed_mps(at_m), model.allowed_mps(here_m)))
        guide = replace(guide, now=replace(now, speed_mps=instead_mps))
        self._replace(Act(Part.GUIDE_SPEED, now.speed_mps, bound_mps, instead_mps), guide=guide)
        return guide

    def _judge_following(self, guide: Guidance) -> None:
        """Lower announced speeds that are above the limit at their place, and drop a brake announced too late."""
        kept: list[Instruction] = []
        first: Act | None = None
        for k, one in enumerate(guide.following):
            excess = self._late(guide) if k == 0 and one.mode in BRAKES else None
            if excess is not None or not _finite(one.speed_mps, one.way_m, one.in_s):
                first = first or Act(Part.GUIDE_NEXT, *(excess or Excess(one.speed_mps, math.nan)))
                break  # The instructions after it no longer apply.
            at_m = self._advice.s_m + one.way_m
            # A speed to reach or to hold applies where the instruction begins; one to coast or brake to, at its end.
            ends = k + 1 < len(guide.following) and one.mode in (*BRAKES, Regime.COAST)
            to_m = self._advice.s_m + guide.following[k + 1].way_m if ends else at_m
            limit_mps = self._model.highest_limit_mps(at_m + 1.0, to_m + 1.0)
            if one.speed_mps > limit_mps + SAME_READING_MPS:
                first = first or Act(Part.GUIDE_NEXT, one.speed_mps, limit_mps, step_below(limit_mps))
                one = replace(one, speed_mps=step_below(limit_mps))  # noqa: PLW2901
            kept.append(one)
        if first is not None:
            self._replace(first, guide=replace(guide, following=tuple(kept)))

    def _late(self, guide: Guidance) -> Excess | None:
        """The excess of a driver who follows the present instruction until the announced brake is due; None if none."""
        in_s = guide.following[0].in_s
        if not in_s <= LONGEST_S:
            return None
        led, now = self._led(guide, guide.force_n)[:-1], guide.now
        if now.mode in (Regime.FULL_TRACTION, Regime.REDUCED_TRACTION):
            led[-1] = led[-1]._replace(holds=True)  # The driver accelerates to that speed and then holds it.
        excess = self._excess(led, in_s, in_s)
        if excess is None or now.mode is not Regime.COAST or now.speed_mps <= self._v_mps:
            return excess
        # The driver rolls up to that speed and is then told to hold it, so is no faster than one who holds it
        # immediately.
        return self._excess([*led[:-1], led[-1]._replace(speed_mps=now.speed_mps, holds=True)], in_s, in_s)

    # --- what happens to a train from the furthest place where it may be, if its driver does what is shown -----------

    def _excess(self, doings: Sequence[Doing], lasts_s: float, since_s: float = 0.0) -> Excess | None:
        """The first speed between `since_s` and `lasts_s` that is too high if the driver does `doings`, or None."""
        done = np.array(doings, dtype=float)
        found = kernels.first_excess(*self._model.train, done, self._ahead_m, self._v_mps, since_s, lasts_s)
        return Excess(*found) if found[0] >= 0 else None

    def _braking(self) -> tuple[float, Needed]:
        """The braking force (N, <= 0) needed from here, and the speed and place that need it.

        If the constant force computed from the needed deceleration does not suffice, all brakes are applied fully.
        """
        model, v_mps = self._model, self._v_mps
        needed = model.needed(self._ahead_m, v_mps, self._valid_s)
        wanted_n = needed.rate_mps2 * model.mass_kg - model.resisting_n(self._ahead_m, v_mps)
        most_n = model.force_n(kernels.MOST, v_mps)
        force_n = -min(max(wanted_n, 0.0), most_n)
        doing = Doing(math.inf, force_n, needed.speed_mps)
        return (force_n if self._excess([doing], self._valid_s) is None else -most_n), needed

    @property
    def _sees_only_mark(self) -> bool:
        """Whether no limit below the train's speed begins before the stop."""
        nodes_m, places, _ = self._model.line
        ahead = (nodes_m[:-1] > self._ahead_m) & (nodes_m[:-1] < self._model.end_m)
        return not (places[kernels.LIMIT][ahead] < self._v_mps).any()

    def _by_eye_n(self) -> float:
        """The wheel force (N, <= 0) of a driver who brakes evenly to the mark by eye."""
        model, v_mps = self._model, self._v_mps
        way_m = max(model.end_m - self._ahead_m, 0.5)
        wanted_n = model.mass_kg * v_mps**2 / (2.0 * way_m) - model.resisting_n(self._ahead_m, v_mps)
        return -min(max(wanted_n, 0.0), model.force_n(kernels.MOST, v_mps))

    def _mode_of(self, force_n: float) -> Regime:
        """The mode of a braking force (N, <= 0) here; the friction brake if the electric brake is not enough."""
        if force_n >= 0:
            return Regime.COAST
        nodes_m, places, _ = self._model.line
        has_motors = places[kernels.MOTORS, kernels.interval(nodes_m, self._ahead_m)] > 0
        electric_n = self._model.force_n(kernels.ELECTRIC, self._v_mps) if has_motors else 0.0
        if -force_n > electric_n * FORCE_RATIO:
            return Regime.FRICTION_BRAKE
        return Regime.FULL_BRAKE if -force_n >= FULL_RATIO * electric_n else Regime.REDUCED_BRAKE

    def _unavailable(self, force_n: float, v_mps: float) -> Excess | None:
        """An excess if the train does not have this force (N) at the speed `v_mps`, so that no driver can apply it.

        The forces are computed for this very speed: at a step of an effort curve, the table may be a tenth off.
        """
        vehicle = self._model.vehicle
        most_n = float(vehicle.traction_effort_n(v_mps) if force_n > 0 else vehicle.brake_effort_n(v_mps))
        return Excess(self._v_mps, math.nan) if abs(force_n) > FORCE_RATIO * most_n + 1.0 else None

    def _braked_horizon(self, force_n: float, to_mps: float, seconds: int) -> dict[str, tuple[float, ...]]:
        """The horizon fields of advice, by name, for braking with a force (N) to a speed, within what is allowed."""
        model, s_m, v_mps = self._model, self._ahead_m, self._v_mps
        doing = np.array(Doing(math.inf, force_n, to_mps), dtype=float)
        speeds: list[float] = []
        forces: list[float] = []
        for _ in range(seconds):
            for _ in range(round(1.0 / kernels.STEP_S)):
                after_mps = float(kernels.after_step(*model.line, model.mass_kg, doing, s_m, v_mps))
                s_m, v_mps = s_m + 0.5 * (v_mps + after_mps) * kernels.STEP_S, after_mps
            forces.append(force_n if v_mps > to_mps else 0.0)
            speeds.append(min(v_mps, model.allowed_mps(s_m), *speeds[-1:]))
        return {"horizon_speed_mps": tuple(speeds), "horizon_force_n": tuple(forces)}

    def _lever_ratio(self, force_n: float) -> float:
        """A braking force (N, <= 0) as a share of the force of all brakes at the train's speed."""
        most_n = self._model.force_n(kernels.MOST, self._v_mps)
        return force_n / most_n if most_n > 0 else 0.0

    def _brake_n(self, effort_ratio: float) -> float:
        """The braking force (N) of an effort: a share of the motors' brake now, or of all brakes if there is none."""
        electric_n = self._model.force_n(kernels.ELECTRIC, self._v_mps)
        return effort_ratio * (electric_n or self._model.force_n(kernels.MOST, self._v_mps))


def _instructed(one: Instruction, force_n: float, until_s: float) -> Doing:
    if one.mode is Regime.CRUISE:
        return Doing(until_s, 0.0, one.speed_mps, True)
    return Doing(until_s, 0.0, 0.0) if one.mode is Regime.COAST else Doing(until_s, force_n, one.speed_mps)


def _finite(*values: float) -> bool:
    return all(map(math.isfinite, values))


# --- the model of line and train: the highest speeds from which full braking is still in time -------------------------


class BrakingBasis(NamedTuple):
    """The inputs of the braking model: line, train, brakes, restrictions, conditions, and the ends of the section."""

    route: Route
    vehicle: Vehicle
    brakes: BrakePolicy
    restrictions: tuple[Restriction, ...]
    conditions: Conditions
    start_m: float
    end_m: float
    point_mass: bool = False


class Needed(NamedTuple):
    """The deceleration (m/s²) that a train needs, the speed (m/s) that it must slow down to, and where (m)."""

    rate_mps2: float
    speed_mps: float
    at_m: float


class BrakingModel:
    """Limits, full braking and forces of one train on one section.

    The train uses the brakes of its policy, without the electric brake where the line does not accept its power; a
    friction brake that plans exclude counts up to the service deceleration, because it builds up slowly. Where mass or
    resistance were measured, the model is cautious: the train is never lighter, and never has more resistance, than in
    its file. Gradients and curves are averaged over the length of the train.
    """

    def __init__(self, basis: BrakingBasis) -> None:
        self.basis, measured = basis, basis.conditions
        careful = replace(
            measured, mass_ratio=max(measured.mass_ratio, 1.0), resistance_ratio=min(measured.resistance_ratio, 1.0)
        )
        train, self.end_m = careful.train(basis.vehicle), basis.end_m
        self.vehicle = train
        length_m = 0.0 if basis.point_mass else train.train_length_m
        nodes_m = _nodes(basis, length_m)
        limit_mps = np.minimum(_limits(basis, nodes_m, length_m), train.max_speed_mps)
        places = np.empty((kernels.PLACES, len(nodes_m) - 1))
        places[kernels.LIMIT] = np.where(nodes_m[:-1] < basis.end_m, limit_mps, 0.0)
        places[kernels.LINE] = _line_mps2(basis, nodes_m, length_m) * (train.mass_kg / train.inertial_mass_kg)
        supply = basis.route.supply().minimum(nodes_m[:-1], nodes_m[1:])
        places[kernels.MOTORS] = (supply >= 0) | (basis.brakes is BrakePolicy.FRICTION)
        places[kernels.ALLOWED + 2] = places[kernels.LIMIT] ** 2
        # The model ends where the tolerance beyond the stop ends; the train stands there at the latest.
        places[kernels.BOUND + 2] = (limit_mps + LIMIT_TOLERANCE_MPS) ** 2
        self.line = nodes_m, places, _forces_n(train)
        self.mass_kg = train.inertial_mass_kg
        """The inertial mass (kg) of the train, with its rotating parts."""
        self.train = *self.line, self.mass_kg, min(train.max_deceleration_mps2, 1e6)
        """The model for the kernels: the arrays of `line`, then the train's mass and largest deceleration."""
        for row in (kernels.ALLOWED, kernels.BOUND):
            kernels.fill_curve(*self.train, row)

    def limit_mps(self, s_m: float) -> float:
        """The limit over the train (m/s) with its head at a position; 0 beyond the end of the section."""
        nodes_m, places, _ = self.line
        return float(places[kernels.LIMIT, kernels.interval(nodes_m, s_m)])

    def highest_limit_mps(self, from_m: float, to_m: float) -> float:
        """The highest limit over the train (m/s) with its head anywhere between two positions."""
        nodes_m, places, _ = self.line
        return float(kernels.highest_limit(nodes_m, places, from_m, to_m))

    def allowed_mps(self, s_m: float) -> float:
        """The highest speed (m/s) at a position from which full braking keeps every limit and the stop."""
        return float(kernels.speed_at(*self.line[:2], kernels.ALLOWED, s_m))

    def bound_mps(self, s_m: float) -> float:
        """The highest speed (m/s) at a position from which full braking keeps limits and stop within the tolerances."""
        return float(kernels.speed_at(*self.line[:2], kernels.BOUND, s_m))

    def force_n(self, row: int, v_mps: float) -> float:
        """The force (N, >= 0) at a speed in a row of the table of forces, as `TRACTION`, `ELECTRIC` or `MOST`."""
        return float(kernels.force_at(self.line[2], row, v_mps))

    def resisting_n(self, s_m: float, v_mps: float) -> float:
        """The resistance (N) at a position and speed: running resistance, gradient and curves."""
        return float(kernels.resisting(*self.line, self.mass_kg, s_m, v_mps))

    def needed(self, s_m: float, v_mps: float, within_s: float) -> Needed:
        """The least constant deceleration from here that keeps every limit ahead and the stop.

        A train above the limit at its position also comes down to that limit within `within_s`.
        """
        nodes_m, places, _ = self.line
        i, here_mps = int(kernels.interval(nodes_m, s_m)), self.limit_mps(s_m)
        found = Needed(max((v_mps - here_mps) / within_s, 0.0), here_mps, s_m)
        limits_mps, begins_m = places[kernels.LIMIT, i + 1 :], nodes_m[i + 1 : -1]
        if len(begins_m):
            rates = (v_mps**2 - limits_mps**2) / (2.0 * np.maximum(begins_m - s_m, 0.1))
            k = int(np.argmax(rates))
            if rates[k] > found.rate_mps2:
                found = Needed(float(rates[k]), float(limits_mps[k]), float(begins_m[k]))
        return found


def _forces_n(train: Vehicle) -> Floats:
    """The forces (N) of a train at speeds 0.1 m/s apart, in the rows that the kernels name."""
    speeds = np.arange(0.0, train.max_speed_mps + BEYOND_TOP_MPS, 1.0 / kernels.STEPS_PER_MPS)
    electric_n, both_n = train.electric_brake_effort_n(speeds), train.brake_effort_n(speeds)
    friction_n = np.minimum(train.friction_brake_force_n, both_n)
    blends = train.brake_policy is not BrakePolicy.ELECTRIC
    service_n = train.service_brake.deceleration_mps2 * train.inertial_mass_kg
    rows = {
        kernels.TRACTION: train.traction_effort_n(speeds),
        kernels.ELECTRIC: electric_n,
        kernels.MOST: both_n,
        kernels.BRAKE: both_n if blends else np.maximum(electric_n, np.minimum(both_n, service_n)),
        kernels.BRAKE_WITHOUT_MOTORS: friction_n if blends else np.minimum(friction_n, service_n),
        kernels.RUNNING: train.resistance.force_n(speeds),
    }
    return np.array([rows[row] for row in range(len(rows))])


def _nodes(basis: BrakingBasis, length_m: float) -> Floats:
    """The nodes (m): every place where a limit or the supply changes, and more in between."""
    route, last_m = basis.route, basis.end_m + STOP_TOLERANCE_M
    begins_m = basis.start_m - BEHIND_M
    rising_m = np.append(route.limits_mps.start_m, [x.end_m for x in basis.restrictions])
    zones = (*route.neutral_sections, *route.no_regeneration)
    found = np.concatenate(
        (
            rising_m,
            rising_m + length_m,
            [x.start_m for x in basis.restrictions],
            [edge_m for zone in zones for edge_m in (zone.start_m, zone.start_m + zone.length_m)],
            np.arange(begins_m, last_m, STEP_M),
            [basis.end_m, last_m],
        )
    )
    found = np.unique(found[(found >= begins_m) & (found <= last_m)])
    apart = np.concatenate((np.diff(found) > 1e-3, [True]))
    return np.asarray(found[apart])


def _limits(basis: BrakingBasis, nodes_m: Floats, length_m: float) -> Floats:
    """The lowest limit (m/s) over the whole train in each interval, with the restrictions in force."""
    from_m, to_m = nodes_m[:-1], nodes_m[1:]
    limit = basis.route.limits_mps.minimum(from_m - length_m, to_m)
    middle_m = 0.5 * (from_m + to_m)
    for one in basis.restrictions:
        inside = (middle_m > one.start_m) & (middle_m < one.end_m + length_m)
        limit = np.where(inside, np.minimum(limit, one.limit_mps), limit)
    return limit


def _line_mps2(basis: BrakingBasis, nodes_m: Floats, length_m: float) -> Floats:
    """The deceleration (m/s², uphill > 0) of a train by gradient and curves, averaged over its length."""
    found, middle_m = np.zeros(len(nodes_m) - 1), 0.5 * (nodes_m[:-1] + nodes_m[1:])
    resistance = basis.vehicle.line_resistance_mps2(basis.route)
    for stretches, factor in ((basis.route.gradients_ratio, STANDARD_GRAVITY_MPS2), (resistance, 1.0)):
        over = stretches.mean(middle_m - length_m, middle_m) if length_m > 0 else stretches.at(middle_m)
        found += factor * over
    return found


class Doing(NamedTuple):
    """The driver's action until a time (s): to apply a wheel force (N) in order to reach a speed (m/s). `holds`: then
    to hold the speed, with whatever force that takes. `of_n` is the force (N) of the electric brake at the start; if it
    is > 0, the braking force grows in proportion to that brake as the train slows down; if 0, it is constant.
    """

    until_s: float
    force_n: float
    speed_mps: float
    holds: bool = False
    of_n: float = 0.0


class Excess(NamedTuple):
    """A speed (m/s) that is too high, and the highest safe speed (m/s) there (NaN: it could not be judged)."""

    value_mps: float
    bound_mps: float
