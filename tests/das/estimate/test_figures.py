"""Every figure of the localisation is used."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any, Final

import numpy as np
import pytest

from das.estimate import estimate as estimate_module
from das.estimate import localisation as localisation_module
from das.estimate import plausibility, track_filter
from das.estimate.estimate import USUAL, Deviations, Estimate, PositionFix, Quality
from das.estimate.localisation import Localisation
from tests.support.fixes import TRAIN, at, fixes, ns

MODULES: Final = (estimate_module, localisation_module, plausibility, track_filter)
ELSEWHERE: Final = ("STANDSTILL_MPS", "SPEED_DOUBTED_S", "CLOCK_FIXES", "CLOCK_MEMORY_S", "CLOCK_LARGEST_S")
"""Used by others only, or when times of reception are known: test_clocks.py."""
NAMES: Final = sorted(
    {
        name
        for module in MODULES
        for name, value in vars(module).items()
        if name.isupper() and isinstance(value, int | float) and name not in ELSEWHERE
    }
)


def change(monkeypatch: pytest.MonkeyPatch, name: str, ratio: float) -> None:
    """Multiply one figure by a ratio wherever it is used; a count is rounded up."""
    for module in MODULES:
        if hasattr(module, name):
            usual = getattr(module, name)
            other = math.ceil(ratio * usual) if isinstance(usual, int) else ratio * usual
            monkeypatch.setattr(module, name, other)


def shifted(fix: PositionFix, **by: float) -> PositionFix:
    return replace(fix, **{name: getattr(fix, name) + more for name, more in by.items()})  # type: ignore[arg-type]


Fault = Callable[[PositionFix, PositionFix], PositionFix | None]
"""Turns a fix, given the one before, into a faulty one; None: it is lost."""


def stating(**fault: Any) -> Fault:
    """Fixes whose fields have other values."""
    return lambda fix, before: replace(fix, **fault)


def off_by(**by: float) -> Fault:
    """Fixes with errors."""
    return lambda fix, before: shifted(fix, **by)


def usual_of(quality: Quality) -> Fault:
    """Fixes that state nothing but their quality."""
    return stating(quality=quality, uncertainty_m=math.nan, speed_uncertainty_mps=math.nan)


def lost(fix: PositionFix, before: PositionFix) -> None:
    """No fix."""


def noisy_odometer(fix: PositionFix, before: PositionFix) -> PositionFix:
    """A measured speed that is nothing but noise."""
    random = np.random.default_rng(fix.time_ns % 2**32)
    return replace(fix, speed_mps=abs(0.06 * random.standard_normal()))


FAULTS: tuple[tuple[range, Fault], ...] = (
    (range(20), usual_of(Quality.GOOD)),
    (range(20, 40), usual_of(Quality.UNKNOWN)),
    (range(40, 60), usual_of(Quality.DEGRADED)),
    (range(60, 70), stating(uncertainty_m=0.01, speed_uncertainty_mps=0.001)),
    (range(72, 73), off_by(s_m=60.0)),
    (range(74, 75), off_by(speed_mps=4.0)),
    (range(75, 76), stating(speed_mps=-0.5)),
    (range(76, 77), stating(uncertainty_m=210.0)),
    (range(77, 78), stating(s_m=2e7)),
    (range(78, 79), stating(speed_mps=1.35 * TRAIN.max_speed_mps)),
    (range(80, 84), lost),
    (range(86, 92), lost),
    (range(26, 29, 2), off_by(time_ns=400_000_000)),
    (range(30, 31), lost),
    (range(30, 401), off_by(time_ns=2_000_000_000)),
    (range(34, 401), off_by(time_ns=-600_000_000)),
    (range(50, 52), lost),
    (range(50, 401), off_by(time_ns=-600_000_000)),
    (range(56, 401), off_by(time_ns=-800_000_000)),
    (range(95, 110), off_by(s_m=500.0)),
    (range(120, 130), stating(s_m=math.nan)),
    (range(135, 140), stating(speed_mps=math.nan)),
    (range(145, 150), lambda fix, before: replace(fix, s_m=before.s_m)),
    (range(153, 157), lambda fix, before: replace(fix, s_m=before.s_m, speed_mps=before.speed_mps)),
    (range(166, 401), noisy_odometer),
    (range(221, 240), off_by(speed_mps=0.2)),
    (range(260, 261), stating(speed_mps=0.18)),
    (range(280, 320), lost),
    (range(320, 340), stating(speed_mps=math.nan)),
)
"""What fails in which seconds of the run; several faults at a time come one after the other."""


@cache
def eventful() -> tuple[PositionFix, ...]:
    """A run on which sensors fail in every way that the localisation knows of."""
    found: list[PositionFix] = []
    for second, measured in enumerate(fixes(400.0, noise_m=4.0, seed=5)):
        fix: PositionFix | None = measured
        for seconds, fault in FAULTS:
            if fix is not None and second in seconds:
                fix = fault(fix, found[-1] if found else fix)
        if fix is not None:
            found.append(fix)
    in_km_h = [at(450.0 + second, found[-1].s_m + 2.0 * second, 7.2) for second in range(30)]
    return (*found, *in_km_h)


def estimates() -> list[Estimate]:
    """The estimates of the whole run, and those of a localisation that begins while the train sets off."""
    found = []
    for run in (eventful(), eventful()[15:40]):
        localisation = Localisation(TRAIN)
        for fix in run:
            localisation.take(fix)
            found += [localisation.at(fix.time_ns), localisation.at(fix.time_ns + ns(3.5) - ns(0.0))]
    return found


@cache
def estimates_as_usual() -> str:
    return repr(estimates())


def estimates_with(name: str, ratio: float) -> str:
    """The estimates with one figure multiplied by a ratio."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        change(monkeypatch, name, ratio)
        return repr(estimates())


@pytest.mark.parametrize("name", NAMES)
def test_every_figure_of_the_localisation_is_used(name: str) -> None:
    """A figure that is a tenth of the usual, or ten times as large, changes some estimate."""
    as_usual = estimates_as_usual()
    assert any(estimates_with(name, by) != as_usual for by in (0.1, 10.0))


@pytest.mark.parametrize("quality", list(USUAL))
def test_the_usual_deviations_are_used(monkeypatch: pytest.MonkeyPatch, quality: Quality) -> None:
    as_usual = estimates_as_usual()
    monkeypatch.setitem(USUAL, quality, Deviations(*(10.0 * x for x in USUAL[quality])))
    assert repr(estimates()) != as_usual
