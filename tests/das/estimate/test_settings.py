"""The settings of localisation and calibration: their defaults, and that each one of the localisation is used."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, fields, replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from das.estimate import localisation_settings
from das.estimate.calibration_settings import CalibrationSettings
from das.estimate.estimate import Estimate
from das.estimate.fix import PositionFix, Quality
from das.estimate.localisation import Localisation
from das.estimate.localisation_settings import LocalisationSettings
from das.estimate.standstill import STANDSTILL_MPS
from tests.support.fixes import TRAIN, fixes, ns


def test_the_defaults_of_the_localisation_are_those_documented() -> None:
    """The figures are those of docs/explanation/localisation.md."""
    assert asdict(LocalisationSettings()) == {
        "sensors": {
            "good": (5.0, 0.2),
            "unknown": (10.0, 0.3),
            "degraded": (30.0, 0.5),
            "least_position_sd_m": 0.5,
            "least_speed_sd_mps": 0.02,
            "odometer_ratio": 0.01,
        },
        "possible": {
            "overspeed_ratio": 1.3,
            "backwards_mps": -0.3,
            "largest_m": 1e7,
            "largest_stated_sd_m": 200.0,
        },
        "gate": {"sds": 5.0, "least_m": 10.0, "least_mps": 1.0},
        "motion": {"hard_mps2": 1.0, "effort_lasts_s": 60.0, "manoeuvre_sds": 3.0},
        "standstill": {
            "slow_mps": 0.1,
            "slow_sds": 2.5,
            "expected_slow_mps": 0.5,
            "stands_after_s": 2.0,
            "sets_off_sds": 3.3,
            "creep_fixes": 5,
        },
        "frozen": {"way_m": 2.0, "coarse_sds": 4.0},
        "restart": {"silence_s": 30.0, "fixes": 4, "span_s": 2.0},
        "use": {
            "stale_after_s": 3.0,
            "largest_position_sd_m": 50.0,
            "largest_speed_sd_mps": 2.0,
            "recovered_ratio": 0.7,
        },
        "clock": {"most_fixes": 15, "memory_s": 30.0, "largest_s": 10.0},
        "steps": {"rate_fixes": 5, "odd_fixes": 1, "lost_fixes": 2, "least_s": 0.25, "largest_s": 5.0},
    }


def test_the_defaults_of_the_calibration_are_those_documented() -> None:
    """The figures are those of docs/explanation/calibration.md."""
    assert asdict(CalibrationSettings()) == {
        "sample": {
            "every_s": 0.9,
            "longest_gap_s": 2.5,
            "most_waiting": 100,
            "slowest_mps": 5.0,
            "adhesion_ratio": 0.9,
            "possible_force_ratio": 1.5,
            "overspeed_ratio": 1.3,
        },
        "window": {
            "samples": 20,
            "speed_sd_mps": 0.05,
            "force_sd_ratio": 0.02,
            "friction_sd_ratio": 0.1,
            "line_sd_ratio": 2e-4,
            "odometry_m": 40.0,
            "neutral_margin_m": 30.0,
            "grid_m": 10.0,
        },
        "belief": {
            "prior_sd": (0.15, 0.3),
            "least": (0.5, 0.4),
            "most": (1.6, 2.5),
            "forgetting": 0.98,
            "informative_sds": 2.0,
            "surprise_sds": 4.0,
            "surprises": 3,
            "model_sd": (0.005, 0.015),
            "usable_sd": (0.02, 0.08),
        },
        "force": {
            "clocks_differ_s": 0.3,
            "too_strong_ratio": 1.06,
            "too_strong_samples": 5,
            "idle_ratio": 0.005,
            "coasting_windows": 4,
            "coasting_sds": 3.0,
            "gain_step": 0.03,
            "gain_sds": 3.0,
            "near_mass_least": 0.7,
            "near_mass_most": 1.4,
        },
        "load": {"stands_for_s": 20.0, "mass_sd": 0.05},
        "replan": {"mass_step": 0.03, "resistance_step": 0.05, "certain_sds": 3.0, "every_s": 120.0},
    }


def test_the_figures_that_others_use_are_those_of_the_settings() -> None:
    use = (
        localisation_settings.STALE_AFTER_S,
        localisation_settings.OVERSPEED_RATIO,
        localisation_settings.LEAST_SD_M,
        localisation_settings.LEAST_SD_MPS,
    )
    assert (*use, STANDSTILL_MPS) == (3.0, 1.3, 0.5, 0.02, 0.3)


# --- every setting is used ---------------------------------------------------------------------------------------


def paths(settings: LocalisationSettings) -> list[str]:
    """The settings as "group.field"."""
    groups = [one.name for one in fields(settings)]
    return [f"{group}.{one.name}" for group in groups for one in fields(getattr(settings, group))]


def changed(settings: LocalisationSettings, path: str, ratio: float) -> LocalisationSettings:
    """The same settings but for one figure, multiplied by a ratio; a count is rounded up."""
    group, name = path.split(".")
    usual = getattr(getattr(settings, group), name)
    if isinstance(usual, tuple):
        other: Any = type(usual)(*(ratio * x for x in usual))
    else:
        other = math.ceil(ratio * usual) if isinstance(usual, int) else ratio * usual
    return replace(settings, **{group: replace(getattr(settings, group), **{name: other})})


def shifted(fix: PositionFix, **by: float) -> PositionFix:
    return replace(fix, **{name: getattr(fix, name) + more for name, more in by.items()})  # type: ignore[arg-type]


Fault = Callable[[PositionFix, PositionFix], PositionFix | None]
"""What becomes of a fix, given the one before; None: it is lost."""


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
    return tuple(found)


def heard_with(settings: LocalisationSettings) -> list[Estimate]:
    localisation, found = Localisation(TRAIN, settings), []
    for fix in eventful():
        localisation.take(fix)
        found += [localisation.at(fix.time_ns), localisation.at(fix.time_ns + ns(3.5) - ns(0.0))]
    return found


@cache
def heard_as_usual() -> list[Estimate]:
    return heard_with(LocalisationSettings())


# Those of the clock need times of hearing: tests/das/node/test_clock_difference.py.
@pytest.mark.parametrize("path", [path for path in paths(LocalisationSettings()) if not path.startswith("clock.")])
def test_every_setting_of_the_localisation_is_used(path: str) -> None:
    """A figure that is a tenth of the usual, or ten times as large, changes some estimate."""
    settings = LocalisationSettings()
    assert any(repr(heard_with(changed(settings, path, by))) != repr(heard_as_usual()) for by in (0.1, 10.0))
