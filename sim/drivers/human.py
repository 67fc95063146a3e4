"""A human driver: looks now and then, reacts late, does not always follow, errs, and gets better."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from das.bus import das_pb2
from sim.drivers.cab import AT_STOP_M, AdviceView, Cab, Efforts, Presentation
from sim.drivers.knowledge import Foresight, Habit, LineKnowledge, Outlook
from sim.drivers.parameters import HumanParameters
from sim.drivers.rules import JUDGED_EVERY_S, TimeRule
from sim.drivers.tracking import STOPPING_MPS
from sim.plant.plant import COAST, Command, lever

GAIN_PER_S = 0.2
"""Share of a speed error a human means to correct per second."""
SETTLED_RATIO = 0.25
"""A correction ends when this share of the dead band is left."""
WARNING_MPS = 1.5
"""So far above the braking curve the train warns of its speed, and any lapse ends."""
ROLL_MPS = 2.0
"""Nobody brakes for less than this above the speed he means to hold."""
WATCHED_MPS = 1.5
"""So near to the highest speed allowed the driver minds it, whatever the advice says."""
RELEASED_RATIO = 0.6
"""Brakes stay applied while at least this share of the planned deceleration is needed."""
SETTLED_MPS = 0.1
"""Braking for a limit ends when the speed is above it by no more than this."""
EASED_S = 3.0
"""Speed above a limit is braked away within about this time."""
NEAREST_M = 0.3
"""For the last bit before the mark, and beyond it, he brakes as planned."""
MISSED_M = 0.8 * AT_STOP_M
"""He misses a mark by no more than this: a train further off would not be at its stop, and never leave it."""

_KINDS: dict[int, str] = {
    das_pb2.MODE_FULL_TRACTION: "traction",
    das_pb2.MODE_REDUCED_TRACTION: "traction",
    das_pb2.MODE_CRUISE: "hold",
    das_pb2.MODE_COAST: "coast",
    das_pb2.MODE_REDUCED_BRAKE: "brake",
    das_pb2.MODE_FULL_BRAKE: "brake",
    das_pb2.MODE_FRICTION_BRAKE: "brake",
}
"""Kinds of advice by mode; a reduced maximum speed is to be held."""


class Event(NamedTuple):
    """Something the driver did or felt, for whoever studies him: what, and a number that goes with it.

    `reaction` (s), `followed` and `refused` (mode of the advice), `lapse` (s, as drawn), `lever` (new setting of a
    controller that stood still before).
    """

    time_s: float
    what: str
    value: float


class _Wander:
    """An Ornstein–Uhlenbeck process with standard deviation 1 and a correlation time."""

    def __init__(self, correlation_s: float, random: np.random.Generator) -> None:
        self._correlation_s, self._random = correlation_s, random
        self.value = float(random.standard_normal())

    def over(self, span_s: float) -> None:
        """Go on for a time (exact for any step)."""
        keep = math.exp(-span_s / self._correlation_s)
        self.value = keep * self.value + math.sqrt(1.0 - keep * keep) * float(self._random.standard_normal())


class HumanDriver:
    """Drives by what the cab shows, with a human's limits; the same seed and stream drive the same, bit for bit.

    Limits and stops are minded all the time (but for lapses), the display only at glances. Every kind of chance has a
    stream of its own, so that a change of one parameter does not reshuffle the others.
    """

    def __init__(
        self, line: LineKnowledge, parameters: HumanParameters | None = None, *, seed: int = 0, stream: int = 0
    ) -> None:
        self.parameters = human = parameters or HumanParameters()
        streams = np.random.SeedSequence(seed, spawn_key=(stream,)).spawn(7)
        self._reactions, self._choices, self._looks, self._lapses, self._marks, a, b = map(
            np.random.default_rng, streams
        )
        self._speed_error, self._force_error = _Wander(human.speed_error_s, a), _Wander(human.force_error_s, b)
        habit = Habit(braking_mps2=human.braking_mps2, below_mps=human.below_limit_mps)
        self._foresight, self._rule = Foresight(line, habit), TimeRule(JUDGED_EVERY_S)
        self.events: list[Event] = []
        self._now_s, self._felt_mps, self._rate_mps2 = -math.inf, 0.0, 0.0
        self._depart_s = self._act_s = math.inf
        self._glance_s = -math.inf
        self._lapse_s, self._awake_s = -math.inf, -math.inf
        self._seen: AdviceView | None = None
        self._heeded: AdviceView | None = None
        self._judged: tuple[object, ...] | None = None
        self._pending: bool | None = None
        self._following = False
        self._correcting = self._braking = self._restraining = False
        self._correction = 0.0
        self._efforts = Efforts.at(0.0, line.train)
        self._lever, self._moving, self._notched_s = 0.0, False, -math.inf
        self._mark_for, self._mark_off_m = math.nan, 0.0

    def command(self, cab: Cab) -> Command:
        span_s = max(cab.time_s - self._now_s, 0.0) if math.isfinite(self._now_s) else 0.0
        self._now_s = cab.time_s
        if span_s > 0:
            self._speed_error.over(span_s)
            self._force_error.over(span_s)
            self._rate_mps2 = (cab.speed_mps - self._felt_mps) / span_s
        self._felt_mps = cab.speed_mps
        if cab.speed_mps <= 0 and not self._departs(cab):
            self._lever, self._correcting, self._braking = 0.0, False, False
            return COAST
        outlook = self._foresight.outlook(cab)
        if not self._lapsing(cab, outlook):
            self._glance(cab)
            self._act(cab)
            self._efforts = Efforts.at(cab.speed_mps, outlook.train)
            self._move(self._wanted(cab, outlook), span_s)
        # Advice on effort is for the motors: who follows it uses them.
        return lever(self._lever, friction_ratio=0.0 if self._advised_effort else self.parameters.friction_ratio)

    # --- attention ---------------------------------------------------------------------------------------------------

    def _departs(self, cab: Cab) -> bool:
        """Whether a standing train is to move, a reaction after it may."""
        if cab.shall_stand:
            self._depart_s = math.inf
            return False
        if math.isinf(self._depart_s):
            self._depart_s = cab.time_s + self._reaction(cab.time_s)
        return cab.time_s >= self._depart_s

    def _reaction(self, now_s: float) -> float:
        human = self.parameters
        normal = float(self._reactions.standard_normal())
        reaction_s = human.reaction_median_s * math.exp(human.reaction_log_sd * normal)
        self._note(now_s, "reaction", reaction_s)
        return reaction_s

    def _lapsing(self, cab: Cab, outlook: Outlook) -> bool:
        """Whether attention is away; the train's warning of its speed brings it back."""
        human, now_s = self.parameters, cab.time_s
        if human.lapses_per_h <= 0:
            return False
        if not math.isfinite(self._lapse_s):
            self._lapse_s = now_s + self._until_lapse()
        if now_s >= self._lapse_s:
            length_s = human.lapse_mean_s * float(self._lapses.standard_exponential())
            self._note(now_s, "lapse", length_s)
            self._awake_s = now_s + length_s
            self._lapse_s = self._awake_s + self._until_lapse()
        if cab.speed_mps > outlook.allowed_mps(cab.s_m) + self.parameters.below_limit_mps + WARNING_MPS:
            self._awake_s = min(self._awake_s, now_s)
        return now_s < self._awake_s

    def _until_lapse(self) -> float:
        return 3600.0 / self.parameters.lapses_per_h * float(self._lapses.standard_exponential())

    def _glance(self, cab: Cab) -> None:
        """Look at the display when it is time to, and judge what is new on it."""
        human, now_s = self.parameters, cab.time_s
        if now_s < self._glance_s:
            return
        beyond_s = max(human.glance_mean_s - human.glance_least_s, 0.0)
        self._glance_s = now_s + human.glance_least_s + beyond_s * float(self._looks.standard_exponential())
        self._seen = view = cab.shown
        item = None if view is None else _item(view)
        if item != self._judged:
            self._judged = item
            self._judge(view, now_s)
        if self._pending is None:
            self._heed(cab)

    def _judge(self, view: AdviceView | None, now_s: float) -> None:
        """Decide on new advice, and when to act on it; advice that is gone is let go of at once."""
        kind = None if view is None else advice_kind(view)
        if view is None or kind is None:
            self._following, self._pending = False, None
            return
        follow = bool(self._choices.random() < getattr(self.parameters, f"comply_{kind}_ratio"))
        self._note(now_s, "followed" if follow else "refused", view.mode)
        self._pending, self._act_s = follow, now_s + self._reaction(now_s)

    def _act(self, cab: Cab) -> None:
        """Take up the decision, a reaction after it; until then he does what he did."""
        if self._pending is not None and cab.time_s >= self._act_s:
            self._following, self._pending = self._pending, None
            self._heed(cab)

    def _heed(self, cab: Cab) -> None:
        """Go by what he has seen, and by what its speed adds to its effort, until he sees more."""
        self._heeded, self._correction = self._seen, 0.0
        view = self._heeded
        if view is not None and view.presentation is Presentation.VECTOR:
            error = view.speed_mps + self._speed_off() - cab.speed_mps
            if abs(error) > self.parameters.dead_band_mps:
                self._correction = GAIN_PER_S * error

    # --- what to do --------------------------------------------------------------------------------------------------

    @property
    def _advised_effort(self) -> bool:
        """Whether he follows advice that says more than a highest speed."""
        view = self._heeded
        return self._following and view is not None and view.presentation is not Presentation.RMS

    def _wanted(self, cab: Cab, outlook: Outlook) -> float:
        """The controller's setting he wants now: by advice or habit, but never more than limits and stops let."""
        allowed = min(outlook.allowed_mps(cab.s_m), cab.limit_mps)
        reach_s = self._reach_s()
        coming = min(allowed, outlook.allowed_mps(cab.s_m + cab.speed_mps * reach_s))
        near = cab.speed_mps + reach_s * max(self._rate_mps2, 0.0) > coming - WATCHED_MPS
        if self._heeded is not None and self._advised_effort:
            wanted = self._advised(cab, outlook, self._heeded, allowed)
            wanted = min(wanted, self._held(cab, outlook, coming)) if near else wanted
        else:
            wanted = self._held(cab, outlook, min(self._top(cab, outlook), coming if near else allowed))
        needed = self._needed_braking(cab, outlook)
        return wanted if needed is None else min(wanted, self._braked(cab, outlook, needed))

    def _reach_s(self) -> float:
        """The time it takes to get the controller back from traction."""
        human = self.parameters
        full_s = human.notches * human.notch_s if human.notches else 1.0 / human.lever_rate_per_s
        return max(self._lever, 0.0) * full_s

    def _needed_braking(self, cab: Cab, outlook: Outlook) -> float | None:
        """The deceleration for what comes (m/s²), from a little before it is needed until it is done; else None."""
        human, v, s = self.parameters, cab.speed_mps, cab.s_m
        needed = outlook.needed_braking_mps2(s, v, v * EASED_S)
        if v <= STOPPING_MPS:
            way_m = self._mark_m(cab) - s
            stopping = v * v / (2.0 * way_m) if way_m > NEAREST_M else human.braking_mps2
            if stopping >= RELEASED_RATIO * human.braking_mps2:
                self._braking = True
                return stopping
        ahead_m = v * (human.early_braking_s + self._reach_s())
        if v > outlook.allowed_mps(s + ahead_m) + min(human.dead_band_mps, human.below_limit_mps):
            self._braking = True
        elif needed < RELEASED_RATIO * human.braking_mps2:
            self._braking = self._braking and v > max(outlook.allowed_mps(s) + SETTLED_MPS, STOPPING_MPS)
        return needed if self._braking else None

    def _advised(self, cab: Cab, outlook: Outlook, view: AdviceView, allowed: float) -> float:
        if view.presentation is Presentation.VECTOR:
            more = self._correction * outlook.train.inertial_mass_kg
            more_ratio = self._efforts.lever_ratio(more)
            return min(max(view.lever_ratio * self._force_off() + more_ratio, -1.0), 1.0)
        if view.mode == das_pb2.MODE_CRUISE:
            return self._held(cab, outlook, min(view.speed_mps, allowed))
        if view.mode == das_pb2.MODE_FULL_TRACTION:
            return 1.0
        if view.mode == das_pb2.MODE_FULL_BRAKE:
            return self._efforts.lever_ratio(-self._efforts.electric_n)
        return 0.0

    def _top(self, cab: Cab, outlook: Outlook) -> float:
        """The highest speed he drives at: the display's reduced maximum, or between keeping time and haste."""
        view = self._heeded
        if self._following and view is not None and view.presentation is Presentation.RMS:
            return view.speed_mps
        keeps = self._rule.cap_mps(cab, outlook)
        return keeps + self.parameters.haste_ratio * max(outlook.top_mps - keeps, 0.0)

    def _held(self, cab: Cab, outlook: Outlook, speed_mps: float) -> float:
        """The setting that holds a speed; errors within the dead band are left, small excess is rolled off."""
        human, v = self.parameters, cab.speed_mps
        error = speed_mps + min(self._speed_off(), human.below_limit_mps) - v
        if abs(error) > human.dead_band_mps:
            self._correcting = True
        elif abs(error) <= SETTLED_RATIO * human.dead_band_mps:
            self._correcting = False
        force_n = outlook.resisting_n(cab.s_m, v)
        if self._correcting:
            force_n += GAIN_PER_S * outlook.train.inertial_mass_kg * error
        # Downhill he brakes until the speed is right again, then lets it roll: else he would brake every few seconds.
        if not self._correcting or error > 0 or v <= STOPPING_MPS:
            self._restraining = False
        elif error <= -ROLL_MPS:
            self._restraining = True
        if force_n < 0 and not self._restraining:
            return 0.0
        return self._efforts.lever_ratio(force_n * self._force_off())

    def _braked(self, cab: Cab, outlook: Outlook, needed_mps2: float) -> float:
        """The setting for a deceleration, at most twice what he plans with."""
        rate = min(max(needed_mps2, 0.0), 2.0 * self.parameters.braking_mps2)
        force_n = outlook.resisting_n(cab.s_m, cab.speed_mps) - outlook.train.inertial_mass_kg * rate
        return self._efforts.lever_ratio(force_n * self._force_off())

    def _mark_m(self, cab: Cab) -> float:
        """Where he takes the mark to be: drawn once for each halt; before a signal, never beyond it."""
        if cab.halt_m != self._mark_for:
            self._mark_for = cab.halt_m
            off_m = self.parameters.stop_error_m * float(self._marks.standard_normal())
            off_m = min(max(off_m, -MISSED_M), MISSED_M)
            self._mark_off_m = -abs(off_m) if cab.signal_m < cab.stop_m else off_m
        return cab.halt_m + self._mark_off_m

    def _speed_off(self) -> float:
        return self.parameters.speed_error_mps * self._speed_error.value

    def _force_off(self) -> float:
        return max(1.0 + self.parameters.force_error_ratio * self._force_error.value, 0.0)

    # --- the controller ----------------------------------------------------------------------------------------------

    def _move(self, wanted: float, span_s: float) -> None:
        """Move the controller towards a setting, as fast as a hand does."""
        before = self._lever
        self._lever = self._by_notches(wanted) if self.parameters.notches else self._by_percent(wanted, span_s)
        moved = self._lever != before
        if moved and not self._moving:
            self._note(self._now_s, "lever", wanted)
        self._moving = moved and self._lever != wanted

    def _by_notches(self, wanted: float) -> float:
        """A notch at a time, each takes its while."""
        human = self.parameters
        notch, aim = round(self._lever * human.notches), round(wanted * human.notches)
        if aim != notch and self._now_s - self._notched_s >= human.notch_s:
            self._notched_s = self._now_s
            notch += 1 if aim > notch else -1
        return notch / human.notches

    def _by_percent(self, wanted: float, span_s: float) -> float:
        human, before = self.parameters, self._lever
        small = abs(wanted - before) < human.lever_least_ratio and abs(wanted) not in (0.0, 1.0)
        if small and not self._moving:
            return before
        step = min(abs(wanted - before), human.lever_rate_per_s * span_s)
        return wanted if step == abs(wanted - before) else before + math.copysign(step, wanted - before)

    def _note(self, now_s: float, what: str, value: float) -> None:
        self.events.append(Event(now_s, what, value))


def advice_kind(view: AdviceView) -> str | None:
    """The kind of advice a compliance belongs to: traction, hold, coast, brake; None for nothing to follow."""
    return "hold" if view.presentation is Presentation.RMS else _KINDS.get(view.mode)


def _item(view: AdviceView) -> tuple[object, ...]:
    """What makes advice new: another mode, or another speed to hold (to 1 m/s)."""
    if view.presentation is Presentation.VECTOR or math.isnan(view.speed_mps):
        return (view.presentation, view.mode)
    return (view.presentation, advice_kind(view), round(view.speed_mps))
