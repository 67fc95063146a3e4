"""Days on which a restriction ends while the train runs, or begins before it passes: driven by the advice, judged by
the scenario's own figures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from das.advice.advice import Advice
from das.domain.restriction import COUNTS_AFTER_S
from das.domain.units import KMH
from sim.drive.limits import Violations
from sim.drivers.drivers import make_driver
from sim.drivers.kinds import DriverKind, Presentation
from sim.plant.kernels import PlantState
from sim.world.in_process import InProcess
from sim.world.loop import Run, Tick, World
from sim.world.service import make_day
from sim.world.surroundings import DayNews
from tests.support.flat_days import service_of

FROM_M, TO_M, SLOW_MPS = 2000.0, 4500.0, 40.0 * KMH
TRACKING_MPS = 0.4
"""A driver holds a speed to this."""


class Listening(InProcess):
    """The advice in this process, kept."""

    def exchange(self, tick: Tick) -> Advice:
        """The advice for a tick."""
        advice = super().exchange(tick)
        self.advices = [*getattr(self, "advices", ()), advice]
        return advice


def driven(path: Path, presentation: str) -> tuple[Run, list[Advice], Callable[[int], float]]:
    """The day of a scenario driven by its advice: the run, the advices, and their times on the run's clock (s)."""
    service = service_of(path)
    said = Listening(service, guide=presentation == "guide")
    made = make_driver(DriverKind.PERFECT, service.line, seed=1)
    run = World(make_day(service, 1), made, Presentation(presentation), said).run()
    return run, said.advices, service.clock_s


def restricted(window: str) -> str:
    """A restriction of 40 km/h in the middle of the line, known from the beginning, with a window."""
    return (
        f"[[disturbances]]\nkind = 'restriction'\nfrom_m = {FROM_M}\nto_m = {TO_M}\nspeed_mps = {SLOW_MPS!r}\n"
        f"announced_m = 3000\n{window}\n"
    )


@pytest.mark.parametrize("presentation", ["speed-and-effort", "guide"])
def test_a_restriction_that_ends_while_the_train_is_in_it_lets_it_go(
    flat: Callable[[str], Path], presentation: str
) -> None:
    until_s = 160.0
    run, advices, clock_s = driven(flat(restricted(f"valid_until_s = {until_s}")), presentation)
    time_s, s_m, speed_mps = (
        np.array([getattr(x, name) for x in run.states]) for name in ("time_s", "s_m", "speed_mps")
    )
    inside = (s_m > FROM_M) & (s_m < TO_M)
    held, after = inside & (time_s < until_s), inside & (time_s > until_s + COUNTS_AFTER_S + 10.0)
    assert held.sum() > 20
    assert speed_mps[held].max() <= SLOW_MPS + TRACKING_MPS
    assert after.sum() > 5
    assert speed_mps[after].max() > SLOW_MPS + 5.0
    assert run.violations == Violations()
    for advice in advices:
        if FROM_M < advice.s_m < TO_M and clock_s(advice.time_ns) < until_s + COUNTS_AFTER_S:
            assert advice.advised_speed_mps <= advice.limit_mps <= SLOW_MPS + 1e-9
    assert max(one.limit_mps for one in advices if FROM_M < one.s_m < TO_M) > 40.0


@pytest.mark.parametrize("presentation", ["speed-and-effort", pytest.param("guide", marks=pytest.mark.slow)])
def test_a_restriction_that_begins_before_the_train_passes_is_kept(
    flat: Callable[[str], Path], presentation: str
) -> None:
    from_s = 60.0
    run, advices, clock_s = driven(flat(restricted(f"valid_from_s = {from_s}")), presentation)
    assert next(x.time_s for x in run.states if x.s_m > FROM_M) > from_s
    assert max(x.speed_mps for x in run.states if FROM_M < x.s_m < TO_M) <= SLOW_MPS + TRACKING_MPS
    assert run.violations == Violations()
    assert all(one.advised_speed_mps <= SLOW_MPS + 1e-9 for one in advices if FROM_M < one.s_m < TO_M)
    assert min(clock_s(one.time_ns) for one in advices) < from_s  # the advice was made before it began


def test_a_restriction_that_begins_long_after_the_train_slows_nobody(flat: Callable[[str], Path]) -> None:
    run, _, _ = driven(flat(restricted("valid_from_s = 5000")), "speed-and-effort")
    assert max(x.speed_mps for x in run.states if FROM_M < x.s_m < TO_M) > SLOW_MPS + 10.0
    assert run.violations == Violations()


def test_what_is_allowed_at_the_line_goes_by_the_window_exactly(flat: Callable[[str], Path]) -> None:
    service = service_of(flat(restricted("valid_from_s = 100\nvalid_until_s = 200")))
    news = DayNews(make_day(service, 1))
    (said,) = news.update(PlantState(**(dict.fromkeys(PlantState._fields, 0.0) | {"s_m": 1000.0, "time_s": 50.0})))
    assert said == "restriction to 40 km/h, km 2.00 to 4.50 from 08:05:40 until 08:07:20 UTC"
    assert news.shown == news.told  # it begins soon
    assert [len(news.holding(now_s)) for now_s in (99.99, 100.0, 199.99, 200.0)] == [0, 1, 1, 0]
