"""The display, which builds each advice message on a section from the plan and from what was shown before."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np

from das.advice import kernels, wording
from das.advice.advice import Advice, Guidance, Instruction, Source, Withdrawal
from das.advice.braking import BRAKED_MORE, SPEED_SLACK_MPS, braking_mode
from das.advice.goal import DEVIATION_NAMED_S, Goal, SpeedsAllowed, TrainState, is_too_fast
from das.advice.plan import HOLD_S, Floats, Place, Plan
from das.advice.planner import PASSED_M, Planner, passed_s
from das.advice.reason import NO_REASON, Reason, ReasonCode
from das.advice.regimes import BRAKES, Regime, departure_regime
from das.advice.shown import OVERSPEED_MPS, REACTS_S, lever_ratio, steady_step, step_below
from das.domain.units import NS
from das.estimate.estimate import Estimate
from das.solver.solution import Fit
from das.solver.state import least_time_s

VALID_FOR_S: Final = 3.0
"""Time (s) for which advice is valid."""
HORIZON_S: Final = 30
"""Length (s) of the horizon of advice, in steps of 1 s."""
MISSED_NAMED_S: Final = 1.0
"""Delay after a point's window (s) from which the reason mentions it."""
LEAST_FOR_BUFFER_S: Final = 10.0
"""Shortest remaining driving time (s) for which a buffer ratio is given; for a shorter one it is meaningless."""
NEXT_S = 1.0
"""Time (s) until the next advice; a brake that is due by then is shown now."""
GAINS_MPS2 = 0.1
"""Acceleration (m/s²) below which the speed gained until the driver acts is negligible."""
STANDING: Final[dict[str, Any]] = {
    **dict.fromkeys(("display_speed_mps", "advised_speed_mps", "advised_force_n", "advised_force_ratio"), 0.0),
    **dict.fromkeys(("horizon_speed_mps", "horizon_force_n"), (0.0,) * HORIZON_S),
}
"""Fields of advice to a standing train: speed, force and horizon."""


class Scene(NamedTuple):
    """The inputs of advice: state, estimated position and speed, planner, goal, bounds, and the guide's advice.

    `late_s` is how late the train will be with the guide (s; NaN: as planned).
    """

    state: TrainState
    here: Estimate
    planner: Planner
    goal: Goal
    allowed: SpeedsAllowed
    guide: Guidance | None = None
    late_s: float = math.nan

    @property
    def excess_mps(self) -> float:
        """The excess (m/s) of the train over the allowed speed; < 0 if it is slower."""
        return self.state.v_mps - self.allowed.allowed_mps

    @property
    def too_fast(self) -> bool:
        """Whether the excess is too large for traction; the warning in `allowed` may last longer."""
        return is_too_fast(self.excess_mps)


class Display:
    """Builds each advice message and keeps modes and speeds on the display long enough to be read."""

    def __init__(self) -> None:
        self._mode, self._mode_since_ns, self._force_n = Regime.NONE, 0, 0.0
        self._shown_mps = math.nan

    def withdrawn(self, here: Estimate, why: Withdrawal) -> Advice:
        """The message that there is no advice, with the cause and the reason as a text."""
        self._show(Regime.NONE, here.time_ns)
        return Advice(
            time_ns=here.time_ns,
            position_time_ns=here.fix_time_ns,
            s_m=here.s_m,
            speed_mps=here.speed_mps,
            cause=why.cause,
            reason=Reason.of_text(wording.withdrawal(why)),
            valid_until_ns=here.time_ns,
            position_sd_m=here.position_sd_m,
        )

    def standing(self, scene: Scene, reason: Reason) -> Advice:
        """The advice for a train that stands at a stop and is to stay there."""
        self._show(Regime.STOP, scene.state.now_ns)
        return self._advice(scene, mode=Regime.STOP, reason=reason, **STANDING)

    def departing(self, scene: Scene, plan: Plan) -> Advice:
        """The advice for a train due to depart: speed, force and horizon for standing, and then how to depart."""
        self._show(Regime.STOP, scene.state.now_ns)  # Modes from before the stop are no longer shown.
        moving = self.following(scene, plan)
        self._show(Regime.DEPART, scene.state.now_ns)
        guide, change = scene.guide, plan.next_change[plan.at(scene.state.s_m).interval]
        mode, effort_ratio = moving.mode, moving.advised_force_ratio
        speed_mps = step_below(float(plan.solution.trajectory.v_mps[change]))
        if guide is not None and math.isfinite(guide.now.effort_ratio):
            speed_mps, effort_ratio = guide.now.speed_mps, guide.now.effort_ratio
            mode = departure_regime(effort_ratio)
        return replace(
            moving,
            mode=Regime.DEPART,
            next_mode=mode,
            next_change_m=math.nan,
            next_change_s=math.nan,
            departure_speed_mps=speed_mps,
            departure_force_ratio=effort_ratio,
            **STANDING,
        )

    def braking(self, scene: Scene, reason: Reason) -> Advice:
        """The advice to brake fully, without a plan: to the stop at the section's end, or down to what is allowed."""
        state, planner = scene.state, scene.planner
        train, ahead, v_mps = planner.section.train, planner.ahead, state.v_mps
        most_n = -ahead.force_n(ahead.full(state.s_m, v_mps), state.s_m, v_mps)
        self._show(Regime.FRICTION_BRAKE if train.friction_force_n > 0 else Regime.FULL_BRAKE, state.now_ns)
        allowed = planner.allowed_mps(state.s_m)
        speeds = np.maximum(v_mps - most_n / train.inertial_mass_kg * np.arange(1, HORIZON_S + 1), 0.0)
        # The lowest speed allowed on the way to each point, so that the horizon never rises again.
        way_m = np.cumsum(0.5 * (np.append(v_mps, speeds[:-1]) + speeds))
        lowest = [planner.lowest_allowed_mps(state.s_m, state.s_m + one) for one in way_m]
        there = np.minimum(np.minimum.accumulate(lowest), allowed)
        return self._advice(
            scene,
            mode=self._mode,
            display_speed_mps=self.displayed(min(v_mps, allowed), allowed),
            advised_speed_mps=min(v_mps, allowed),
            advised_force_n=-most_n,
            advised_force_ratio=lever_ratio(-most_n, planner.section.largest_n(v_mps)),
            horizon_speed_mps=tuple(np.minimum(speeds, there).tolist()),
            horizon_force_n=tuple(np.where(speeds > there, -most_n, 0.0).tolist()),
            next_mode=Regime.STOP,
            source=Source.FALLBACK,
            reason=reason,
        )

    def following(self, scene: Scene, plan: Plan) -> Advice:
        """The advice for a moving train, from its plan and the guide's advice."""
        state, planner, goal, late_s = scene.state, scene.planner, scene.goal, scene.late_s
        place, allowed = plan.at(state.s_m), scene.allowed.allowed_mps
        mode, following = self._instructed(plan, place, scene)
        advised = min(place.speed_mps, allowed)
        speeds, forces = self._horizon(plan, place, scene, advised)
        arrival_ns = state.now_ns + round((plan.solution.time_s - place.time_s) / NS)
        if math.isfinite(late_s):
            arrival_ns = goal.arrival_ns + round(late_s / NS)
        deviation_s = (arrival_ns - goal.arrival_ns) * NS
        # A train whose largest effort rises with its speed cannot yet exert the plan's force.
        force_n = min(self._force_n, planner.section.largest_n(min(state.v_mps, advised))[0])
        return self._advice(
            scene,
            mode=mode,
            advised_speed_mps=advised,
            display_speed_mps=self.displayed(advised, allowed),
            advised_force_n=force_n,
            advised_force_ratio=lever_ratio(force_n, planner.section.largest_n(place.speed_mps)),
            horizon_speed_mps=tuple(speeds.tolist()),
            horizon_force_n=tuple(forces.tolist()),
            next_mode=following.mode,
            next_change_m=following.way_m,
            next_change_s=following.in_s,
            predicted_arrival_ns=arrival_ns,
            predicted_deviation_s=deviation_s,
            buffer_ratio=_buffer_ratio(scene),
            energy_to_go_j=plan.energy_to_go_j(place.interval, state.s_m),
            reason=self._reason(scene, plan, deviation_s),
        )

    def _advice(self, scene: Scene, source: Source | None = None, **fields: Any) -> Advice:
        state, here, planner = scene.state, scene.here, scene.planner
        return Advice(
            time_ns=state.now_ns,
            position_time_ns=here.fix_time_ns,
            s_m=state.s_m,
            speed_mps=state.v_mps,
            source=source or planner.source,
            valid_until_ns=state.now_ns + round(VALID_FOR_S / NS),
            limit_mps=planner.limit_mps(state.s_m),
            position_sd_m=here.position_sd_m,
            guide=scene.guide,
            **fields,
        )

    def _horizon(self, plan: Plan, place: Place, scene: Scene, advised_mps: float) -> tuple[Floats, Floats]:
        """Speeds and forces of the next seconds, with no speed above what limits and the stop allow.

        A brake stronger than planned lasts as long as the advice is valid.
        """
        state, planner, run = scene.state, scene.planner, plan.solution.trajectory
        section, speeds, forces = planner.section, np.empty(HORIZON_S), np.empty(HORIZON_S)
        kernels.horizon(
            place.time_s, run.s_m, run.t_s, run.v_mps, plan.force_n, section.node_m, planner.allowed_w,
            section.limit_mps, speeds, forces,
        )  # fmt: skip
        planned_n = 0.0 if scene.too_fast else float(plan.shown_force_n[place.interval])
        if self._force_n < min(planned_n, 0.0):
            soon = slice(math.ceil(VALID_FOR_S))
            forces[soon] = np.minimum(forces[soon], self._force_n)
        if scene.too_fast:
            planned_m = np.interp(place.time_s + np.arange(1.0, HORIZON_S + 1.0), run.t_s, run.s_m)
            speeds = kept_behind(speeds, advised_mps, state, planned_m, planner)
        return speeds, forces

    def _show(self, mode: Regime, now_ns: int) -> None:
        self._mode, self._mode_since_ns = mode, now_ns

    def _follow_mode(self, plan: Plan, place: Place, scene: Scene) -> Regime:
        wanted, shown_n = Regime(int(plan.modes[place.interval])), float(plan.shown_force_n[place.interval])
        # The plan begins on the braking curve; a train above it gets no traction.
        if scene.too_fast and shown_n > 0:
            wanted, shown_n = Regime.COAST, 0.0
        wanted, shown_n = braked_enough(wanted, shown_n, scene, place.speed_mps)
        mode = self.held_mode(wanted, scene.state.now_ns)
        if mode is wanted:
            self._force_n = shown_n
        return mode

    def _instructed(self, plan: Plan, place: Place, scene: Scene) -> tuple[Regime, Instruction]:
        """The mode to show and the next change: the guide's if its instruction is due, else the plan's."""
        guide = scene.guide
        if guide is not None and guide.now.mode is not Regime.DEPART and guide.now.in_s <= 0.0:
            return self._as_guided(guide, plan, scene, place)
        mode = self._follow_mode(plan, place, scene)
        if guide is not None and guide.now.in_s > 0.0:
            return mode, guide.now
        return mode, self._next_change(plan, mode, scene.state, place)

    def _as_guided(self, guide: Guidance, plan: Plan, scene: Scene, place: Place) -> tuple[Regime, Instruction]:
        """The mode and the next change of the guide's instruction, with the force that keeps to its reference.

        A larger force may be needed to brake: it is constant until the advice expires, while the guide's effort grows.
        """
        state, mode, self._force_n = scene.state, guide.now.mode, guide.reference_force_n
        if mode in BRAKES:
            mode, self._force_n = braked_enough(mode, self._force_n, scene, place.speed_mps)
        if mode is not self._mode:
            self._show(mode, state.now_ns)
        if guide.following:
            return self._mode, guide.following[0]
        end_m = float(plan.solution.trajectory.s_m[-1])
        left_s = plan.solution.time_s - place.time_s
        return self._mode, Instruction(mode=Regime.STOP, way_m=end_m - state.s_m, in_s=left_s)

    def held_mode(self, wanted: Regime, now_ns: int) -> Regime:
        """The mode to show: the wanted one if the last one was shown for `HOLD_S`, or it brakes more or pulls less."""
        held_s = (now_ns - self._mode_since_ns) * NS
        settled = self._mode in (Regime.NONE, Regime.STOP, Regime.DEPART) or not 0 <= held_s < HOLD_S
        if wanted is not self._mode and (settled or wanted > self._mode):
            self._show(wanted, now_ns)
        return self._mode

    def _next_change(self, plan: Plan, shown: Regime, state: TrainState, place: Place) -> Instruction:
        run, planned = plan.solution.trajectory, int(plan.modes[place.interval])
        change = int(plan.next_change[place.interval])
        mode = Regime(int(plan.modes[change])) if change < len(plan.modes) else Regime.STOP
        way_m, in_s = float(run.s_m[change]) - state.s_m, float(run.t_s[change]) - place.time_s
        wait_s = max(HOLD_S - (state.now_ns - self._mode_since_ns) * NS, 0.0)
        if shown != planned and wait_s < in_s:  # The planned mode has to wait until the shown one may change.
            return Instruction(mode=Regime(planned), way_m=wait_s * place.speed_mps, in_s=wait_s)
        return Instruction(mode=mode, way_m=way_m, in_s=in_s)

    def displayed(self, advised_mps: float, allowed_mps: float) -> float:
        """The speed to display (m/s): the advised one in whole steps, steady within a band, never above the allowed."""
        steady_mps = steady_step(advised_mps, self._shown_mps)
        self._shown_mps = min(steady_mps, step_below(allowed_mps))
        return self._shown_mps

    def _reason(self, scene: Scene, plan: Plan, deviation_s: float) -> Reason:
        planner, goal, fit = scene.planner, scene.goal, plan.solution.fit
        if scene.allowed.too_fast:
            return Reason(code=ReasonCode.TOO_FAST, speed_mps=scene.excess_mps)
        if planner.front is None:
            return Reason(code=ReasonCode.FASTEST_SAFE if planner.before is None else ReasonCode.AS_BEFORE)
        window = self._window_said(scene, plan, deviation_s)
        if window:
            return window
        if fit is Fit.LATE:
            return Reason(code=ReasonCode.FASTEST, late_s=deviation_s)
        if deviation_s <= -DEVIATION_NAMED_S:
            stop = planner.section.end_stop_name
            return Reason(code=ReasonCode.WAITS_AT_STOP, late_s=deviation_s, stop=stop)
        if fit is Fit.EARLY or deviation_s >= DEVIATION_NAMED_S:
            return Reason(code=ReasonCode.LEAST_ENERGY, late_s=deviation_s)
        if goal.operator_delay_s is not None and goal.operator_delay_s >= 1:
            return Reason(code=ReasonCode.ON_TIME_TOLD_LATE, late_s=goal.operator_delay_s)
        return Reason(code=ReasonCode.ON_TIME)

    def _window_said(self, scene: Scene, plan: Plan, deviation_s: float) -> Reason:
        """The point ahead, if it may not be passed yet or will be passed late; otherwise no reason."""
        state, planner, goal = scene.state, scene.planner, scene.goal
        point = goal.passing
        if point is None or state.s_m >= point.s_m - PASSED_M or planner.passing is None:
            return NO_REASON
        code, time_ns = ReasonCode.POINT_EARLIEST, point.earliest_ns or 0
        if time_ns <= state.now_ns:
            if passed_s(plan.solution, point) - point.window(plan.made_ns).latest_s < MISSED_NAMED_S:
                return NO_REASON
            code, time_ns = ReasonCode.POINT_MISSED, point.latest_ns or 0
        return Reason(code=code, at_m=point.s_m, time_ns=time_ns, late_s=deviation_s, text=point.reason)


def _buffer_ratio(scene: Scene) -> float:
    """The buffer: time left divided by the least driving time, minus 1; NaN if hardly any driving time is left."""
    state, planner, goal = scene.state, scene.planner, scene.goal
    least_s = least_time_s(planner.section, state.s_m, state.v_mps)
    return goal.left_s(state.now_ns) / least_s - 1.0 if least_s > LEAST_FOR_BUFFER_S else math.nan


def braked_enough(mode: Regime, force_n: float, scene: Scene, planned_mps: float) -> tuple[Regime, float]:
    """The mode and force (N) to show: those given, or braking that is due soon or needed because of excess speed."""
    state, planner, allowed_mps = scene.state, scene.planner, scene.allowed.allowed_mps
    ahead = planner.ahead
    gained_mps2 = (force_n - ahead.section.resistance_n(state.s_m, state.v_mps)) / ahead.section.train.inertial_mass_kg
    pulls = force_n > 0.0 and gained_mps2 > GAINS_MPS2
    if pulls:
        # A driver who starts the next brake late must not be too fast by then.
        until_s = NEXT_S + REACTS_S
        if not ahead.is_due(state.braked_m, state.v_mps + gained_mps2 * until_s, until_s):
            # A driver who cuts off traction late must not be above the limit by then.
            room_mps2 = max(min(planner.limit_mps(state.s_m), allowed_mps) - state.v_mps, 0.0) / until_s
            too_much_n = max(gained_mps2 - room_mps2, 0.0) * ahead.section.train.inertial_mass_kg
            return mode, max(force_n - too_much_n, 0.0)
        mode, force_n = Regime.COAST, 0.0
    back = scene.too_fast or (state.v_mps > allowed_mps and gained_mps2 > 0.0)
    effort = ahead.back_under(state.s_m, state.v_mps, allowed_mps).effort if back else 0.0
    above = scene.too_fast or pulls or state.v_mps > planned_mps + SPEED_SLACK_MPS
    within_s, more_ratio = (REACTS_S, BRAKED_MORE) if above else (NEXT_S, 1.0)
    if ahead.is_due(state.braked_m, state.v_mps, within_s):
        effort = max(effort, ahead.needed(state.braked_m, state.v_mps).effort)
    elif state.v_mps > allowed_mps + OVERSPEED_MPS and allowed_mps < planner.limit_mps(state.s_m):
        effort = ahead.largest(state.s_m, state.v_mps)
    effort = ahead.by_policy(more_ratio * effort, state.s_m, state.v_mps)
    needed_n = ahead.force_n(effort, state.s_m, state.v_mps)
    return (braking_mode(effort), needed_n) if effort > 0.0 and needed_n < force_n else (mode, force_n)


def kept_behind(
    speeds_mps: Floats, advised_mps: float, state: TrainState, planned_m: Floats, planner: Planner
) -> Floats:
    """The horizon speeds of a train that is too fast, lowered to what is allowed on the way to the planned positions.

    The plan brakes from the train's speed, so it may already be beyond a lower limit that a driver who follows the
    horizon still keeps.
    """
    kept, at_m, before = speeds_mps.copy(), state.s_m, advised_mps
    for i, to_m in enumerate(planned_m.tolist()):
        kept[i] = min(kept[i], planner.lowest_allowed_mps(at_m, max(at_m, to_m)))
        at_m, before = at_m + 0.5 * (before + kept[i]), kept[i]
    return kept
