"""Measures of how a trial was driven, from the driver's looks and decisions and from the train's motion."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from das.domain.units import KMH
from sim.drive.stability import REVERSAL_S
from sim.drivers.cab import AdviceView, DriverEvent
from sim.drivers.presentations.presenter import SpeedIs, presenter_of
from sim.experiment.driven import Driven
from sim.world.loop import TICK_S

BAND_MPS: Final = 3.0 * KMH
"""Speeds this near to what is shown are in band."""
LEAST_FORCE_N: Final = 1000.0
"""Wheel forces below this are neither traction nor braking."""
LEAST_MOVE_RATIO: Final = 1e-9
"""A controller that moves less than this between two looks stands still."""


def stop_error_m(driven: Driven) -> float | None:
    """Mean distance (m) of where the train stood from where it should have, over the stops after the first."""
    missed = [abs(call.missed_m) for call in driven.run.calls[1:]]
    return float(np.mean(missed)) if missed else None


def speed_rmse_mps(driven: Driven) -> float | None:
    """Root mean square of the speed's error (m/s) against what was shown; None where no speed was shown."""
    return _root_mean_square(_speed_errors(driven))


def speed_in_band_ratio(driven: Driven) -> float | None:
    """Share of the seconds with a shown speed with the train within 3 km/h of it; None without such seconds."""
    errors = np.abs(_speed_errors(driven))
    return float(np.mean(errors <= BAND_MPS)) if len(errors) else None


def effort_rmse_ratio(driven: Driven) -> float | None:
    """Root mean square of the controller's error against the effort shown (1: full scale); None without one."""
    errors = [look.lever_ratio - look.shown.lever_ratio for _, look in driven.moving if look.shown is not None]
    return _root_mean_square([error for error in errors if not math.isnan(error)])


def reaction_s(driven: Driven) -> float | None:
    """Median time (s) from noticing advice to acting on it; None where the driver never acted on any."""
    return _median([acted - noticed for noticed, acted in _acted_on(driven.run.decisions)])


def response_s(driven: Driven) -> float | None:
    """Median time (s) from when advice was first shown to acting on it; None where the driver never acted on any."""
    since = _shown_since(driven)
    times = np.array([time_s for time_s, _ in since])
    found = []
    for noticed_s, acted_s in _acted_on(driven.run.decisions):
        i = int(np.searchsorted(times, noticed_s, side="right")) - 1
        if i >= 0:
            found.append(acted_s - since[i][1])
    return _median(found)


def compliance_ratio(driven: Driven) -> float | None:
    """Share of the noticed advice that was followed; None where none was noticed."""
    followed, refused = (_count(driven, what) for what in ("followed", "refused"))
    return followed / (followed + refused) if followed + refused else None


def control_movements_per_min(driven: Driven) -> float | None:
    """Movements of the controller per minute in which the train moved; None where it has no setting."""
    settings = [look.lever_ratio for look in driven.looks if look.speed_mps > 0]
    if not settings or any(math.isnan(one) for one in settings):
        return None
    moves = np.abs(np.diff(settings)) > LEAST_MOVE_RATIO
    begun = int(np.count_nonzero(moves[1:] & ~moves[:-1])) + int(moves[:1].any())
    return begun / driven.moving_min


def power_brake_reversals(driven: Driven) -> int:
    """Changes between traction and braking with less than 10 s in between."""
    found, side, ended_s = 0, 0, -math.inf
    for state, _ in driven.moving:
        force_n = state.force_el_n + state.force_friction_n
        now = (force_n > LEAST_FORCE_N) - (force_n < -LEAST_FORCE_N)
        if now and now == -side and state.time_s - ended_s < REVERSAL_S:
            found += 1
        if now:
            side, ended_s = now, state.time_s
    return found


def jerk_rms_mps3(driven: Driven) -> float | None:
    """Root mean square of the acceleration's change from second to second (m/s³), while the train moved."""
    pairs = pairwise(driven.run.states)
    return _root_mean_square(
        [(b.acceleration_mps2 - a.acceleration_mps2) / TICK_S for a, b in pairs if a.speed_mps > 0 and b.speed_mps > 0]
    )


def glances_per_min(driven: Driven) -> float | None:
    """Glances at the display per minute in which the train moved; None of a driver who keeps no diary."""
    moving = {math.floor(state.time_s) for state, _ in driven.moving}
    glances = [one for one in driven.run.decisions if one.what == "glance"]
    if not glances or not moving:
        return None
    return sum(math.floor(one.time_s) in moving for one in glances) / driven.moving_min


def lapses(driven: Driven) -> int | None:
    """Lapses of attention; None of a driver who keeps no diary."""
    return _count(driven, "lapse") if driven.run.decisions else None


def _speed_errors(driven: Driven) -> list[float]:
    """Speed − shown speed (m/s) of the moving seconds in which a speed to keep was shown."""
    seen = ((look.speed_mps, look.shown) for _, look in driven.moving if look.shown is not None)
    errors = (_speed_error(speed, view) for speed, view in seen)
    return [error for error in errors if not math.isnan(error)]


def _speed_error(speed_mps: float, view: AdviceView) -> float:
    error, speed_is = speed_mps - view.shown_speed_mps, _speed_is(view)
    if speed_is is SpeedIs.TO_REACH:
        return math.nan
    return max(error, 0.0) if speed_is is SpeedIs.HIGHEST else error


def _speed_is(view: AdviceView) -> SpeedIs:
    return presenter_of(view.presentation).speed_is(view.mode)


def _acted_on(decisions: Sequence[DriverEvent]) -> Iterator[tuple[float, float]]:
    """When advice was noticed and when it was acted on (s), for all advice that was followed; departures left out."""
    noticed_s = math.nan
    for event in decisions:
        if event.what == "noticed":
            noticed_s = event.time_s
        elif event.what == "acted" and event.value > 0 and event.time_s > noticed_s:
            yield noticed_s, event.time_s


def _shown_since(driven: Driven) -> list[tuple[float, float]]:
    """For every second, its time (s) and since when the present advice was shown: its mode, or its top speed."""
    found: list[tuple[float, float]] = []
    before, since_s = None, math.nan
    for state, look in driven.seconds:
        view = look.shown
        now = None if view is None else round(view.speed_mps) if _speed_is(view) is SpeedIs.HIGHEST else view.mode
        if now != before:
            before, since_s = now, state.time_s
        found.append((state.time_s, since_s))
    return found


def _count(driven: Driven, what: str) -> int:
    return sum(one.what == what for one in driven.run.decisions)


def _root_mean_square(values: Sequence[float]) -> float | None:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else None


def _median(values: Sequence[float]) -> float | None:
    known = [value for value in values if not math.isnan(value)]
    return float(np.median(known)) if known else None
