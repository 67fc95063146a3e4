"""The signs of a driver's habits in a recorded drive: times, speeds and controller settings at telling moments.

Only what a recording has of people as well is read, once a second: display, speed, limit and controller, and no
decisions of a simulated driver.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.advice.regimes import KIND_OF, InstructionKind
from sim.drive.table import DriveTable
from sim.drivers.cab import AT_STOP_M, AdviceView
from sim.drivers.presentations.presenter import presenter_of
from sim.recording.course import Floats, stretches_of

Samples = Mapping[str, Sequence[float]]
"""The samples of a drive, by the statistic that they belong to."""
SETTLED_S: Final = 10
"""Time (s) after new advice from which its effect on the drive is expected."""
SOON_S: Final = 25
"""Longest time (s) from new advice to an action that counts as the answer to it."""
LEAST_S: Final = 5
"""Shortest stretch (s) from which a way of driving is read."""
CRUISE_S: Final = 20
"""Shortest stretch (s) of light traction that counts as holding a speed."""
AT_REST_RATIO, SET_RATIO, LIGHT_RATIO = 0.02, 0.05, 0.6
"""Settings of the controller: neither traction nor braking, clearly one of them, and light traction up to the last."""
EFFORT_RATIO: Final = 0.1
"""Distance of the controller from the effort shown within which that effort is set."""
SLOW_MPS, NEAR_MPS, APPROACH_M = 12.0, 3.0, 1500.0
"""Speed below which a train is about to stop, margin to a limit that is being kept, and the way (m) to a stop in which
the braking for it begins."""


class Seconds(NamedTuple):
    """A drive second by second, each of shape (seconds,): position (m), speed and limit (m/s), the controller's setting
    (−1 … 1), whether the train may leave, and the display."""

    s_m: Floats
    speed_mps: Floats
    limit_mps: Floats
    lever: Floats
    cleared: NDArray[np.bool_]
    shown: Sequence[AdviceView | None]


def observed(table: DriveTable) -> Samples:
    """The samples of one drive."""
    rows = np.flatnonzero(table.spoke["cab"] & table.spoke["truth"])
    names = ("truth_s_m", "truth_speed_mps", "cab_limit_mps", "cab_lever_ratio")
    cleared = (table["cab_may_depart"] > 0) & (table["cab_clock_s"] >= table["cab_departure_s"] - 1e-6)
    s_m, speed_mps, limit_mps, lever = (table[name][rows] for name in names)
    drive = Seconds(s_m, speed_mps, limit_mps, lever, cleared[rows], table["cab_view"][rows].tolist())
    stops_m = np.array([stop.s_m for stop in table.journey.stops] if table.journey else [])
    found: dict[str, list[float]] = defaultdict(list)
    for part in (_departures(drive), _answers(drive), _cruises(drive), _stops(drive, stops_m)):
        for name, value in part:
            found[name].append(value)
    return dict(found)


def _departures(drive: Seconds) -> Iterator[tuple[str, float]]:
    """The logarithm of the time (s) from the order to depart to the first movement of the controller."""
    lever, stands = drive.lever, (drive.speed_mps <= 0) & (drive.lever <= AT_REST_RATIO)
    for i in np.flatnonzero(stands[1:] & drive.cleared[1:] & ~drive.cleared[:-1]) + 1:
        moved = np.flatnonzero(lever[i : i + SOON_S] > AT_REST_RATIO)
        if len(moved) and i + moved[0] + 1 < len(lever):
            k = int(i + moved[0])
            began = lever[k] / max(lever[k + 1] - lever[k], lever[k])  # the part of a second since the movement began
            yield "departure", math.log(max(k - i - began, 0.1))


def _answers(drive: Seconds) -> Iterator[tuple[str, float]]:
    """The logarithm of the time (s) from new advice until it is followed, and signs of following it or not."""
    moving = [view if v > 1.0 else None for view, v in zip(drive.shown, drive.speed_mps, strict=True)]
    kinds = [KIND_OF.get(one.mode) if one and presenter_of(one.presentation).says_mode else None for one in moving]
    for kind in InstructionKind:
        for start, end in stretches_of(np.array([one is kind for one in kinds])):
            lever, settled = drive.lever[start:end], slice(start + SETTLED_S, end)
            if kind in (InstructionKind.COAST, InstructionKind.BRAKE):
                done = np.abs(lever) <= AT_REST_RATIO if kind is InstructionKind.COAST else lever <= -SET_RATIO
                first = np.flatnonzero(done[:SOON_S])
                if len(first) and first[0] > 0:
                    yield "answer", math.log(float(first[0]) - 0.5)
            if end - start < SETTLED_S + LEAST_S:
                continue
            advice = [(one.shown_speed_mps, one.lever_ratio) for one in drive.shown[settled] if one is not None]
            speed_mps, effort = np.array(advice).T
            if kind is InstructionKind.COAST:
                yield "coast", float(np.mean(drive.lever[settled] > AT_REST_RATIO) < 0.25)
            elif kind is InstructionKind.HOLD:
                yield from (("hold", float(one)) for one in drive.speed_mps[settled] - speed_mps)
            elif np.isfinite(effort).sum() >= LEAST_S:
                yield str(kind), float(np.nanmedian(np.abs(drive.lever[settled] - effort)) <= EFFORT_RATIO)


def _cruises(drive: Seconds) -> Iterator[tuple[str, float]]:
    """Of light traction: deviations (m/s) from a steady speed, share of seconds with movements of the controller; the
    settings at rest, and the margin (m/s) to a limit that is near."""
    lever, v = drive.lever, drive.speed_mps
    for start, end in stretches_of((lever > AT_REST_RATIO) & (lever < LIGHT_RATIO) & (v > SLOW_MPS)):
        if end - start >= CRUISE_S:
            seconds = np.arange(start, end)
            steady = np.polyval(np.polyfit(seconds, v[start:end], 1), seconds)
            yield from (("held error", float(one)) for one in v[start:end] - steady)
            yield "held moves", float(np.mean(np.abs(np.diff(lever[start:end])) > 1e-3))
    rest = lever[1:][np.abs(np.diff(lever)) < 1e-6]
    yield from (("rest", float(one)) for one in rest)
    margin = (drive.limit_mps - v)[SETTLED_S:][drive.limit_mps[SETTLED_S:] == drive.limit_mps[:-SETTLED_S]]
    if len(margin) and (least := float(np.quantile(margin, 0.05))) < NEAR_MPS:
        yield "below limit", least


def _stops(drive: Seconds, stops_m: Floats) -> Iterator[tuple[str, float]]:
    """Of each arrival: the stopping error (m), the deceleration (m/s², logarithm), and the time (s), at that speed,
    by which braking began earlier than with that deceleration."""
    v, s, lever = drive.speed_mps, drive.s_m, drive.lever
    for i in np.flatnonzero((v[1:] <= 0) & (v[:-1] > 0)) + 1:
        off_m = s[i] - stops_m
        if not len(off_m) or np.abs(off_m).min() > AT_STOP_M:
            continue
        yield "stop", float(off_m[np.abs(off_m).argmin()])
        way_m = s[i] - s[:i]
        slow = np.flatnonzero((way_m < APPROACH_M) & (v[:i] > NEAR_MPS) & (v[:i] < SLOW_MPS))
        if len(slow) < LEAST_S or v[slow[0]] <= v[slow[-1]]:
            continue
        rate_mps2 = (v[slow[0]] - v[slow[-1]]) / (slow[-1] - slow[0])
        yield "deceleration", math.log(rate_mps2)
        brakes = np.flatnonzero((way_m < APPROACH_M) & (lever[:i] <= -SET_RATIO) & (v[:i] > SLOW_MPS))
        if len(brakes):
            k = int(brakes[0])
            yield "braking begins", float((way_m[k] - v[k] ** 2 / (2.0 * rate_mps2)) / v[k])


_LOG_RMS: Final = ("hold", "held error", "stop")
"""Samples of errors, of which the logarithm of the root mean square counts; of the others it is the mean."""


def statistics(drives: Sequence[Samples]) -> dict[str, float]:
    """The statistics of one driver from all drives together; a statistic without samples is missing."""
    pooled = {name: np.array([x for one in drives for x in one.get(name, ())]) for name in set().union(*drives)}
    found = {name: float(values.mean()) for name, values in pooled.items()}
    found |= {name: math.log(max(math.sqrt(np.mean(pooled[name] ** 2)), 1e-3)) for name in _LOG_RMS if name in pooled}
    if len(latency := pooled.get("departure", np.empty(0))) > 2:
        found["departure spread"] = math.log(max(float(latency.std(ddof=1)), 0.02))
    return found


def notches_of(drives: Sequence[Samples]) -> int:
    """The number of notches of the controller each way, by the settings at rest; 0 for one without notches."""
    rest = np.array([one for drive in drives for one in drive.get("rest", ())])
    for count in range(2, 33):
        at = np.round(rest * count)
        if len(np.unique(at)) > 3 and np.mean(np.abs(rest * count - at) < 0.02) >= 0.98:
            return count
    return 0
