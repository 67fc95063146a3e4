"""A made-up drive of a train, and position fixes of a receiver on it, for tests of the filter and the localisation."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from das.domain.units import NS
from das.domain.vehicle import Vehicle
from das.estimate.estimate import PositionFix
from das.estimate.localisation import Localisation
from das.estimate.plausibility import SpeedScale
from das.estimate.track_filter import WANDER_S
from tests.support.making import make_train

T0 = 1_800_000_000_000_000_000
TRAIN = make_train()
SD_M, SD_MPS = 3.0, 0.05


class _Believed(SpeedScale):
    def unit_sd_mps(self, speed_mps: float) -> float:
        return 0.0


def believing(vehicle: Vehicle) -> Localisation:
    """A localisation that accepts a speed before the distance confirms it, for tests that begin in motion."""
    localisation = Localisation(vehicle)
    localisation._scale = _Believed()
    return localisation


def ns(seconds: float) -> int:
    """The time in ns since 1970, given the seconds since the beginning of the drive."""
    return T0 + round(seconds / NS)


def at(time_s: float, s_m: float, speed_mps: float, **more: object) -> PositionFix:
    """A fix of usual quality at a time of the drive (s); `more` sets further fields of the fix."""
    given = {"uncertainty_m": SD_M, "speed_uncertainty_mps": SD_MPS, **more}
    return PositionFix(time_ns=ns(time_s), s_m=s_m, speed_mps=speed_mps, **given)  # type: ignore[arg-type]


def truth(time_s: float) -> tuple[float, float]:
    """True position and speed: 10 s at rest, 50 s at 0.6 m/s², 60 s at 30 m/s, 40 s at −0.75 m/s², then at rest."""
    s_m = speed_mps = 0.0
    for until_s, rate in ((10, 0.0), (60, 0.6), (120, 0.0), (160, -0.75), (math.inf, 0.0)):
        begun_s = {10: 0, 60: 10, 120: 60, 160: 120}.get(until_s, 160)
        span_s = min(time_s, until_s) - begun_s
        if span_s <= 0:
            break
        s_m += speed_mps * span_s + 0.5 * rate * span_s**2
        speed_mps += rate * span_s
    return s_m, max(speed_mps, 0.0)


def fixes(
    until_s: float, *, from_s: float = 0.0, hz: float = 1.0, seed: int = 1, noise_m: float = SD_M
) -> Iterator[PositionFix]:
    """A receiver's reports of `truth`: positions with a slowly drifting error, speeds with independent noise."""
    random = np.random.default_rng(seed)
    keep, off_m = math.exp(-1 / hz / WANDER_S), noise_m * random.standard_normal()
    for i in range(round((until_s - from_s) * hz) + 1):
        time_s = from_s + i / hz
        s_m, speed_mps = truth(time_s)
        off_m = keep * off_m + noise_m * math.sqrt(1 - keep**2) * random.standard_normal()
        said_mps = max(speed_mps + SD_MPS * random.standard_normal(), 0.0) if speed_mps else 0.0
        yield at(time_s, s_m + off_m, said_mps)


def heard(until_s: float, **more: float) -> Localisation:
    """A localisation that has received usual fixes up to a time (s); `more` is passed on to `fixes`."""
    localisation = believing(TRAIN)
    for fix in fixes(until_s, **more):  # type: ignore[arg-type]
        localisation.take(fix)
    return localisation
