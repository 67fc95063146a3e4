"""Clocks that are set while a train runs, and clocks that differ: the stated deviation covers the error."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from das.estimate import localisation
from das.estimate.estimate import PositionFix
from das.estimate.localisation import ClockDifference, Localisation
from das.estimate.track_filter import WANDER_S
from tests.support.crossing import crossed
from tests.support.fixes import TRAIN, ns

SET_S, END_S = 40.0, 60


@dataclass(frozen=True, kw_only=True)
class Drive:
    """A train at a speed; the clocks of sensors and node are set by a time, just after a fix or just before one."""

    speed_mps: float
    hz: float = 1.0
    sensors_s: float = 0.0
    node_s: float = 0.0
    before_tick: bool = False
    sd_m: float = 3.0
    lost_ratio: float = 0.0
    jump_m: float = 0.0

    def judged(self) -> Iterator[tuple[bool, float]]:
        """At each second from 20 s on: whether the estimate is usable, and its error in stated deviations.

        Fixes come 0.05 s before the seconds. The node passes steps of its own clock on to the localisation.
        """
        random, localisation = np.random.default_rng(4), Localisation(TRAIN)
        keep, off_m, was_set = math.exp(-1 / self.hz / WANDER_S), 0.0, False
        set_s = SET_S - 0.02 if self.before_tick else SET_S - 0.5 / self.hz
        fixes = [(1.0 + i / self.hz - 0.05, True) for i in range(round(END_S * self.hz))]
        for time_s, is_fix in sorted(fixes + [(float(second), False) for second in range(1, END_S)]):
            if not was_set and time_s >= set_s:
                was_set = True
                localisation.set_clock(self.node_s)
            node_ns = ns(time_s + self.node_s * was_set)
            s_m = self.speed_mps * time_s
            if is_fix:
                off_m = keep * off_m + self.sd_m * math.sqrt(1 - keep**2) * random.standard_normal()
                if random.random() >= self.lost_ratio:
                    localisation.take(
                        PositionFix(
                            time_ns=ns(time_s + self.sensors_s * was_set),
                            s_m=s_m + off_m + self.jump_m * (SET_S < time_s < SET_S + 2),
                            speed_mps=self.speed_mps + 0.05 * random.standard_normal(),
                            uncertainty_m=self.sd_m,
                            speed_uncertainty_mps=0.05,
                        ),
                        node_ns,
                    )
                continue
            found = localisation.at(node_ns)
            if time_s >= 20:
                yield found.usable, abs(found.s_m - s_m) / found.position_sd_m


STEPS_S = (-3.0, -2.0, -1.0, -0.5, 0.5, 1.0, 1.5, 2.0, 3.0)


@pytest.mark.parametrize(
    ("clocks", "step_s", "hz", "before_tick"),
    crossed([("sensors", "node"), ("sensors",), ("node",)], STEPS_S, [1.0, 10.0], [False, True]),
)
def test_the_deviation_covers_a_step_of_either_clock(
    clocks: tuple[str, ...], step_s: float, hz: float, before_tick: bool
) -> None:
    """A clock set back by 3 s gave 6 s of advice for a place 135 m behind, with a stated deviation of 0.8 m."""
    for speed_mps in (10.0, 25.0, 45.0):
        for sd_m in (1.0, 5.0):
            drive = Drive(
                speed_mps=speed_mps,
                hz=hz,
                sensors_s=step_s * ("sensors" in clocks),
                node_s=step_s * ("node" in clocks),
                before_tick=before_tick,
                sd_m=sd_m,
            )
            assert all(sds < 3.0 for usable, sds in drive.judged() if usable), drive


@pytest.mark.parametrize(("step_s", "hz"), crossed(STEPS_S, [1.0, 10.0]))
def test_where_both_clocks_are_set_alike_no_advice_is_lost(step_s: float, hz: float) -> None:
    assert all(usable for usable, _ in Drive(speed_mps=30.0, hz=hz, sensors_s=step_s, node_s=step_s).judged())


@pytest.mark.parametrize("step_s", [-2.0, -0.5, 0.5, 1.0, 2.0])
def test_a_step_is_noticed_also_where_fixes_get_lost(step_s: float) -> None:
    drive = Drive(speed_mps=30.0, sensors_s=step_s, node_s=step_s, lost_ratio=0.15)
    assert all(sds < 3.0 for usable, sds in drive.judged() if usable)


@pytest.mark.parametrize("drive", [Drive(speed_mps=30.0, lost_ratio=0.1), Drive(speed_mps=30.0, jump_m=60.0)])
def test_lost_fixes_and_a_receiver_that_jumps_are_no_step_of_a_clock(drive: Drive) -> None:
    assert all(usable and sds < 3.0 for usable, sds in drive.judged())


# --- the difference of two clocks ----------------------------------------------------------------------------------


def test_single_messages_that_were_held_up_do_not_count() -> None:
    clock = ClockDifference()
    for second in range(1, 20):
        held_up_s = 2.5 if second % 5 == 0 else 0.02
        clock.receive(ns(second), ns(second + held_up_s))
        clock.tick(ns(second + held_up_s) + 1)
    assert clock.seconds == pytest.approx(0.02)


def test_a_clock_that_stands_still_between_ticks_is_no_difference() -> None:
    """A simulation receives the positions of a second by the clock of the second before."""
    clock = ClockDifference()
    for second in range(1, 20):
        clock.receive(ns(second), ns(second - 1))
        clock.tick(ns(second))
        assert clock.seconds == 0.0


def differences() -> list[float]:
    """The differences found on a run with late messages, others that are held up, and a gap."""
    clock, found = ClockDifference(), []
    for second in [*range(1, 80), *range(130, 150)]:
        late_s = 0.1 + 0.01 * second + (25.0 if 20 <= second < 32 else 0.0)
        clock.receive(ns(second), ns(second + late_s))
        clock.tick(ns(second + late_s) + 1)
        found.append(clock.seconds)
    return found


@pytest.mark.parametrize("name", ["CLOCK_FIXES", "CLOCK_MEMORY_S", "CLOCK_LARGEST_S"])
def test_every_figure_of_the_clock_is_used(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    usual, before = getattr(localisation, name), differences()
    found = []
    for by in (0.1, 10.0):
        monkeypatch.setattr(localisation, name, type(usual)(usual * by + 0.5))
        found.append(differences())
    assert any(one != before for one in found)
