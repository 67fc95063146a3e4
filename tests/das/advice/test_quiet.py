"""The quiet display: when the driver brakes against the advice or stands on the line, and when he does not."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from functools import cache

import numpy as np
import pytest

from das.advice.advice import Advice, Cause, Guidance, Instruction
from das.advice.quiet import Quiet
from das.advice.regimes import BRAKES, TRACTION, Regime
from das.domain.files.load import load_route, load_vehicle
from das.domain.units import KMH, NS
from das.estimate.estimate import Estimate
from das.solver.section import Section, build_section

FROM_MPS = 30.0
MIDDLE_M = 3_000.0
HOLD = Advice(time_ns=0, mode=Regime.CRUISE)
ACCELERATE = Advice(time_ns=0, mode=Regime.FULL_TRACTION)
BRAKE = Advice(time_ns=0, mode=Regime.FULL_BRAKE)
COAST = Advice(time_ns=0, mode=Regime.COAST)
SHOWN, BRAKES_AGAINST = Cause.NONE, Cause.DRIVER_BRAKES


@cache
def flat() -> Section:
    return build_section(load_route("flat-6km"), load_vehicle("re460-ic"))


@cache
def hilly() -> Section:
    return build_section(load_route("zurich-luzern"), load_vehicle("re460-ic"), end_m=29_000.0)


def rolling_mps2(section: Section, s_m: float, v_mps: float) -> float:
    """The deceleration of a train that coasts (< 0 on a steep way down)."""
    return section.resistance_n(s_m, v_mps) / section.train.inertial_mass_kg


class Drive:
    """A train that is told something every second; `causes` keeps what was answered."""

    def __init__(self, s_m: float = MIDDLE_M, v_mps: float = FROM_MPS, section: Section | None = None) -> None:
        self.section = section or flat()
        self.quiet = Quiet()
        self.s_m, self.v_mps, self.now_s = s_m, v_mps, 1_000.0
        self.causes: list[Cause] = []

    def told(self, advice: Advice, v_mps: float | None = None, span_s: float = 1.0) -> Cause:
        """The cause after some time, when the train has a speed; it stays where it is."""
        self.v_mps = self.v_mps if v_mps is None else v_mps
        self.now_s += span_s
        here = Estimate(time_ns=round(self.now_s / NS), s_m=self.s_m, speed_mps=self.v_mps, problem=None)
        self.causes.append(self.quiet.cause(advice, here, self.section))
        return self.causes[-1]

    def slows(self, advice: Advice, mps2: float, seconds: int) -> list[Cause]:
        """The causes of some seconds in which the train slows down by `mps2`."""
        return [self.told(advice, self.v_mps - mps2) for _ in range(seconds)]


def first(causes: Iterable[Cause], wanted: Cause) -> int | None:
    """In which second (from 1) a cause comes first."""
    return next((second for second, cause in enumerate(causes, 1) if cause is wanted), None)


@pytest.mark.parametrize("mode", sorted(TRACTION))
def test_a_brake_against_an_acceleration_silences_the_display_after_three_seconds(mode: Regime) -> None:
    drive = Drive()
    told = Advice(time_ns=0, mode=mode)
    assert set(drive.slows(told, 0.0, 5)) == {SHOWN}
    assert drive.slows(told, 0.5, 6) == [SHOWN] * 2 + [BRAKES_AGAINST] * 4


def test_who_holds_a_speed_may_correct_it_by_the_brake() -> None:
    """A correction of less than 5 km/h is holding; more is not, here from the third second (3 x 0.5 m/s)."""
    drive = Drive()
    drive.slows(HOLD, 0.0, 5)
    assert set(drive.slows(HOLD, 0.3, 4)) == {SHOWN}
    assert set(drive.slows(HOLD, -0.1, 12)) == {SHOWN}
    assert first(drive.slows(HOLD, 0.5, 6), BRAKES_AGAINST) == 3


def test_slowing_down_by_what_gradient_and_resistance_explain_is_no_brake() -> None:
    section = hilly()
    steepest_m = float(section.node_m[:-1][np.argmax(section.constant_n)]) + 1.0
    explained_mps2 = rolling_mps2(section, steepest_m, FROM_MPS)
    assert explained_mps2 > 0.1
    for more_mps2, braked in ((0.15, None), (0.25, 3)):
        drive = Drive(steepest_m, section=section)
        drive.slows(ACCELERATE, 0.0, 5)
        assert first(drive.slows(ACCELERATE, explained_mps2 + more_mps2, 6), BRAKES_AGAINST) == braked


def test_a_brake_that_only_holds_the_speed_downhill_is_none() -> None:
    section = hilly()
    steepest_m = float(section.node_m[:-1][np.argmin(section.constant_n)]) + 1.0
    assert rolling_mps2(section, steepest_m, FROM_MPS) < -0.05
    drive = Drive(steepest_m, section=section)
    assert set(drive.slows(ACCELERATE, 0.0, 20)) == {SHOWN}
    assert set(drive.slows(ACCELERATE, 0.15, 10)) == {SHOWN}


def with_guide(mode: Regime) -> Advice:
    return Advice(time_ns=0, mode=Regime.CRUISE, guide=Guidance(now=Instruction(mode=mode)))


SLOWING = [
    *(Advice(time_ns=0, mode=mode) for mode in sorted(BRAKES)), COAST, with_guide(Regime.REDUCED_BRAKE),
]  # fmt: skip


@pytest.mark.parametrize("advice", SLOWING)
def test_advice_to_brake_or_coast_is_always_shown(advice: Advice) -> None:
    """On whichever display it says so: before, and also while the driver brakes against what was said."""
    drive = Drive()
    assert set(drive.slows(advice, 0.5, 10)) == {SHOWN}
    drive = Drive()
    assert drive.slows(ACCELERATE, 0.5, 8)[-1] is BRAKES_AGAINST
    assert set(drive.slows(advice, 0.5, 3)) == {SHOWN}


def test_the_display_is_quiet_until_the_driver_releases() -> None:
    """2 s after the brake is released, whatever the advice was meanwhile; a brake that it said is no release."""
    drive = Drive(v_mps=40.0)
    drive.slows(ACCELERATE, 0.5, 10)
    drive.slows(COAST, 0.5, 2)
    drive.slows(BRAKE, 0.5, 2)
    assert set(drive.slows(HOLD, 0.5, 10)) == {BRAKES_AGAINST}
    assert drive.slows(HOLD, 0.0, 4) == [BRAKES_AGAINST, SHOWN, SHOWN, SHOWN]


def test_who_releases_an_advised_brake_late_does_not_brake_against_the_advice() -> None:
    drive = Drive(v_mps=40.0)
    drive.slows(BRAKE, 0.5, 20)
    assert set(drive.slows(ACCELERATE, 0.5, 5)) == {SHOWN}
    assert set(drive.slows(ACCELERATE, -0.2, 5)) == {SHOWN}
    assert first(drive.slows(ACCELERATE, 0.5, 10), BRAKES_AGAINST) == 3


@pytest.mark.parametrize(("in_s", "quiet"), [(19.0, False), (21.0, True)])
@pytest.mark.parametrize("by_guide", [True, False])
def test_who_begins_an_announced_brake_early_is_with_the_advice(in_s: float, quiet: bool, by_guide: bool) -> None:
    if by_guide:
        after = (Instruction(mode=Regime.COAST, in_s=in_s - 10.0), Instruction(mode=Regime.FULL_BRAKE, in_s=in_s))
        told = Advice(time_ns=0, mode=Regime.FULL_TRACTION, guide=Guidance(now=Instruction(), following=after))
    else:
        told = Advice(time_ns=0, mode=Regime.FULL_TRACTION, next_mode=Regime.FULL_BRAKE, next_change_s=in_s)
    drive = Drive()
    assert (BRAKES_AGAINST in drive.slows(told, 0.5, 8)) is quiet


def noisy(seed: int, seconds: int) -> Iterator[float]:
    """A speed that is held within 1 km/h, as an estimate with a standard deviation of 0.07 m/s shows it."""
    random = np.random.default_rng(seed)
    for second in range(seconds):
        yield FROM_MPS + 1.0 * KMH * math.sin(second / 10.0) + 0.07 * float(random.standard_normal())


def test_neither_the_noise_nor_a_jump_of_the_measured_speed_is_a_brake() -> None:
    drive = Drive()
    for v_mps in noisy(1, 4_000):
        assert drive.told(ACCELERATE, v_mps) is SHOWN
    assert drive.told(ACCELERATE, FROM_MPS - 3.0) is SHOWN
    assert set(drive.slows(ACCELERATE, 0.05, 10)) == {SHOWN}


def test_advices_in_quick_succession_and_a_clock_that_is_set_back_change_nothing() -> None:
    drive = Drive()
    for tenth in range(100):  # The speed flickers by 0.06 m/s, which is 0.6 m/s² from one advice to the next.
        drive.told(ACCELERATE, FROM_MPS - 0.05 * tenth + 0.06 * (tenth % 2), 0.1)
    assert first(drive.causes, BRAKES_AGAINST) in range(28, 35)
    assert drive.causes[-1] is BRAKES_AGAINST
    drive.now_s -= 60.0
    assert drive.told(ACCELERATE) is SHOWN
    assert first(drive.slows(ACCELERATE, 0.5, 5), BRAKES_AGAINST) == 3


@pytest.mark.parametrize(
    ("s_m", "cause"),
    [(0.0, SHOWN), (49.0, SHOWN), (51.0, Cause.STANDS_ON_LINE), (5_949.0, Cause.STANDS_ON_LINE), (5_951.0, SHOWN)],
)
def test_a_train_that_stands_elsewhere_than_at_a_stop_is_told_nothing(s_m: float, cause: Cause) -> None:
    drive = Drive(s_m)
    assert drive.told(Advice(time_ns=0, mode=Regime.DEPART), 0.0) is cause
    assert drive.told(ACCELERATE, 0.5) is SHOWN


def test_when_a_train_moves_that_was_braked_to_a_stand_the_advice_is_there_at_once() -> None:
    drive = Drive(v_mps=5.0)
    assert drive.slows(ACCELERATE, 0.5, 6)[-1] is BRAKES_AGAINST
    assert drive.told(Advice(time_ns=0, mode=Regime.DEPART), 0.0) is Cause.STANDS_ON_LINE
    assert drive.told(ACCELERATE, 0.4) is SHOWN


def test_after_a_pause_of_the_advice_the_brake_is_judged_anew() -> None:
    drive = Drive()
    assert drive.slows(ACCELERATE, 0.5, 5)[-1] is BRAKES_AGAINST
    assert drive.told(Advice(time_ns=0, cause=Cause.POSITION_STALE)) is SHOWN
    assert drive.told(ACCELERATE, drive.v_mps - 0.5) is SHOWN
