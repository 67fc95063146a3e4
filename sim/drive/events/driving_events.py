"""Stops, speeds above the limit, and how the driver answered the advice."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from das.advice.regimes import Regime, mode_name
from das.bus import topics
from das.bus.recording import Recording
from das.domain.units import KM, NS, PERCENT, kmh
from sim.drive.calls import NEAR_M, KeptCall
from sim.drive.events.event import DriveEvent, EventKind, lateness_text, place_m, times_text
from sim.drive.limits import spans_above
from sim.drivers.cab import AT_STOP_M, KINDS
from sim.recording.course import DrivenCourse, Floats
from sim.recording.stands import STANDING_MPS, arrival_ns, departure_ns, stands

LEVER_RATIO: Final = 0.03
"""A controller set to less than this share of the effort is at neutral."""
LEAST_STOOD: Final = 5
"""Advice shown for fewer seconds than this need not be followed: drivers take some seconds to react."""
LONGEST_ANSWER_S: Final = 30.0
"""What the driver does later than this (s) is no longer an answer to the advice."""
LATE_ANSWER_S: Final = 10.0
"""An answer later than this (s) is called late."""
LEAST_STAND_S: Final = 1.0
"""A train that stops for less than this (s), on the way to its mark, has not come to stand."""
PAUSE_NS: Final = 5_000_000_000
"""A pause of the positions is an event if it is longer than this (ns); they usually come once a second."""

DECIDED: Final = {"followed": True, "refused": False}
"""A driver's decisions about advice, and whether each means that he follows it."""
PULLS, COASTS, BRAKES = 1, 0, -1
WANTED: Final = {
    Regime.FULL_TRACTION: PULLS,
    Regime.REDUCED_TRACTION: PULLS,
    Regime.COAST: COASTS,
    Regime.REDUCED_BRAKE: BRAKES,
    Regime.FULL_BRAKE: BRAKES,
    Regime.FRICTION_BRAKE: BRAKES,
}
"""What a driver who follows an advised mode sets the controller to; holding a speed may need any of the three."""


def call_events(trip: DrivenCourse, made: tuple[KeptCall, ...]) -> Iterator[DriveEvent]:
    """Departures, arrivals and stops that were missed."""
    for index, call in enumerate(made):
        if call.arrived_ns and index > 0:
            late = "" if math.isnan(call.arrived_late_s) else f", {lateness_text(call.arrived_late_s)}"
            beyond = f", {call.missed_m:.0f} m beyond the stop" if call.missed_m > AT_STOP_M else ""
            yield DriveEvent(
                time_ns=call.arrived_ns, kind=EventKind.ARRIVAL, s_m=call.s_m,
                text=f"arrived at {call.name}{late}{beyond}",
                facts={"stop": call.name, "late_s": call.arrived_late_s, "missed_m": call.missed_m},
            )  # fmt: skip
        if call.departed_ns and index < len(made) - 1:
            late = "" if math.isnan(call.departed_late_s) else f", {lateness_text(call.departed_late_s)}"
            yield DriveEvent(
                time_ns=call.departed_ns, kind=EventKind.DEPARTURE, text=f"left {call.name}{late}", s_m=call.s_m,
                facts={"stop": call.name, "late_s": call.departed_late_s},
            )  # fmt: skip
        if not call.served and call.reached and trip.s_m[-1] > call.s_m + NEAR_M and trip.s_m[0] < call.s_m - NEAR_M:
            passed = int(np.argmax(trip.s_m >= call.s_m))
            speed_kmh = kmh(float(trip.speed_mps[passed]))
            yield DriveEvent(
                time_ns=int(trip.time_ns[passed]), kind=EventKind.MISSED_STOP, s_m=call.s_m,
                text=f"{call.name} was passed at {speed_kmh:.0f} km/h without stopping",
                facts={"stop": call.name, "speed_mps": float(trip.speed_mps[passed])},
            )  # fmt: skip


def stand_events(trip: DrivenCourse, made: tuple[KeptCall, ...]) -> Iterator[DriveEvent]:
    """The stands of the train that belong to no stop of its journey."""
    at_stops = {call.stand for call in made}
    for stand in stands(trip):
        arrived, departed = arrival_ns(trip, stand), departure_ns(trip, stand)
        if stand in at_stops or not arrived or not departed:
            continue
        lasted_s = (departed - arrived) * NS
        if lasted_s < LEAST_STAND_S:
            continue
        yield DriveEvent(
            time_ns=arrived, end_ns=departed, kind=EventKind.STAND, s_m=stand.s_m,
            text=f"stood for {lasted_s:.0f} s where there is no stop", facts={"lasted_s": lasted_s},
        )  # fmt: skip


def overspeed_events(trip: DrivenCourse, limit_mps: Floats) -> Iterator[DriveEvent]:
    """The stretches of time in which the train was above the limit in force (`sim.drive.limits`)."""
    for over in spans_above(trip, limit_mps):
        over_kmh, limit_kmh = kmh(over.over_mps), kmh(over.allowed_mps)
        text = f"up to {over_kmh:.0f} km/h above the limit of {limit_kmh:.0f} km/h for {over.lasted_s:.0f} s"
        facts = {"limit_mps": over.allowed_mps, "over_kmh": over_kmh, "lasted_s": over.lasted_s}
        yield DriveEvent.on(trip, EventKind.OVERSPEED, over.start_ns, text, end_ns=over.end_ns, **facts)


def top_speed_events(trip: DrivenCourse, top_mps: float) -> Iterator[DriveEvent]:
    """That the train was faster than its vehicle file says that it can go (m/s); nothing if it was not.

    It is one event however often it was so, where it was fastest: there is one question to answer, which train it was.
    """
    spans = tuple(spans_above(trip, np.full(len(trip.time_ns), top_mps)))
    if not spans:
        return
    worst, lasted_s = max(spans, key=lambda one: one.over_mps), sum(one.lasted_s for one in spans)
    often = "" if len(spans) == 1 else f" in all, {times_text(len(spans))}"
    text = (
        f"up to {kmh(worst.over_mps):.0f} km/h faster than the vehicle file says the train can go "
        f"({kmh(top_mps):.0f} km/h) for {lasted_s:.0f} s{often}: is it the right train?"
    )
    facts = {"top_speed_mps": top_mps, "over_kmh": kmh(worst.over_mps), "lasted_s": lasted_s, "times": len(spans)}
    yield DriveEvent.on(trip, EventKind.BEYOND_TRAIN, worst.start_ns, text, end_ns=worst.end_ns, **facts)


def driver_events(recording: Recording, trip: DrivenCourse) -> Iterator[DriveEvent]:
    """How, and after how long, the driver answered each change of the shown mode, judged by his controller.

    A change to what the controller is already set to needs no answer. What the driver thought is not recorded.
    """
    cab = recording.columns(topics.CAB, "time_ns", "presentation", "mode", "lever_ratio", "signal_m")
    at, mode, shown = cab["time_ns"], cab["mode"], cab["presentation"] > 0
    does = np.where(np.abs(cab["lever_ratio"]) < LEVER_RATIO, COASTS, np.sign(np.nan_to_num(cab["lever_ratio"])))
    changes = [*np.flatnonzero(np.diff(mode, prepend=-1)), len(mode)] if len(mode) else []
    for first, end in pairwise(changes):
        wanted = WANTED.get(Regime(int(mode[first]))) if int(mode[first]) in set(Regime) else None
        if wanted is None or not shown[first] or does[first] == wanted:
            continue
        answers = does[first:end] == wanted
        standing = bool((trip.at(at[first:end], trip.speed_mps) < STANDING_MPS).all())
        minds_signal = bool((cab["signal_m"][first:end] > 0).any())
        excused = end - first < LEAST_STOOD or standing or minds_signal  # too short, at a stand, or for a signal
        if answers.any() or not excused:
            yield _answer(trip, at[first:end], answers, Regime(int(mode[first])))


def _answer(trip: DrivenCourse, at: NDArray[np.int64], does: NDArray[np.bool_], mode: Regime) -> DriveEvent:
    """The driver's answer to advice that was shown at the times `at`; `does`: his controller was set as advised."""
    waited_s = (at - at[0]) * NS
    answered = np.flatnonzero(does & (waited_s <= LONGEST_ANSWER_S))
    stood_s = float(waited_s[-1]) + 1.0
    if len(answered):
        reaction_s = float(waited_s[answered[0]])
        late = ", which is late" if reaction_s > LATE_ANSWER_S else ""
        text = f"{mode_name(mode)} was followed after {reaction_s:.0f} s{late}"
        facts: dict[str, Any] = {"followed": True, "reaction_s": reaction_s}
    else:
        over = f"it stood for {stood_s:.0f} s" if stood_s <= LONGEST_ANSWER_S else f"{LONGEST_ANSWER_S:.0f} s"
        text = f"{mode_name(mode)} was not followed ({over})"
        facts = {"followed": False, "stood_s": stood_s}
    return DriveEvent.on(trip, EventKind.DRIVER, int(at[0]), text, mode=mode_name(mode), **facts)


def pause_events(recording: Recording, trip: DrivenCourse) -> Iterator[DriveEvent]:
    """The pauses in the positions that the train's localisation gave."""
    at = np.sort(recording.columns(topics.POSITION, "time_ns")["time_ns"])
    for index in np.flatnonzero(np.diff(at) > PAUSE_NS):
        lasted_s = float(at[index + 1] - at[index]) * NS
        start_ns, end_ns = int(at[index]), int(at[index + 1])
        text = f"no position for {lasted_s:.0f} s from km {place_m(trip, start_ns) / KM:.2f}"
        yield DriveEvent.on(trip, EventKind.LAPSE, start_ns, text, end_ns=end_ns, lasted_s=lasted_s)


def decision_events(recording: Recording, trip: DrivenCourse) -> Iterator[DriveEvent]:
    """Advice that the driver followed or refused, with his reaction time, and lapses of his attention.

    There are none if no decisions were recorded, as in a real drive, or with a driver who does not report them.
    """
    told = [(KINDS[one.message.kind - 1], one.message) for one in recording.of(topics.DECISION)]
    kept = [one for one in told if one[0] != "expected"]
    for (kind, one), (after, reaction) in pairwise([*kept, ("", None)]):
        if kind in DECIDED:
            follows = DECIDED[kind]
            advice = mode_name(Regime(int(one.value)))
            text = f"advice '{advice}' is not followed"
            facts: dict[str, Any] = {"mode": advice, "followed": follows}
            if not follows:
                text += _controller(recording, int(one.time_ns))
            if after == "reaction":  # The reaction that a decision starts is recorded right after the decision.
                facts |= {"reaction_s": reaction.value}
                text = f"{advice} is followed after a reaction of {reaction.value:.1f} s" if follows else text
            yield DriveEvent.on(trip, EventKind.DRIVER, one.time_ns, text, **facts)
        elif kind == "lapse":
            text = f"attention is away for {one.value:.0f} s, unless the train warns"
            end_ns = one.time_ns + round(one.value / NS)
            yield DriveEvent.on(trip, EventKind.DRIVER, one.time_ns, text, end_ns=end_ns, away_s=one.value)


def _controller(recording: Recording, time_ns: int) -> str:
    """What the controller was set to at a moment, in words; empty if that was not recorded."""
    cab = recording.columns(topics.CAB, "time_ns", "lever_ratio")
    at = int(np.searchsorted(cab["time_ns"], time_ns, side="right")) - 1
    if at < 0 or not np.isfinite(cab["lever_ratio"][at]):
        return ""
    share = round(float(cab["lever_ratio"][at]) / PERCENT)
    return f"; the controller {f'stays at {share:+d} %' if share else 'stays at 0'}"
