"""Where coasting leads, and what is shown of it: over a brow, through a valley, and up to a brake."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from das.advice.advice import Replan
from das.advice.coach.keeping import Kept, StandingReference
from das.advice.coach.settings import ShowingSettings
from das.advice.coach.showing import Showing, ShownNow
from das.advice.coach.shown_brakes import SpeedsAllowed
from das.advice.goal import TrainState
from das.advice.regimes import TRACTION, Regime
from das.domain.units import KMH
from das.solver.guide.phases import Phase, PhaseKind
from das.solver.guide.schedule import Schedule, known_run
from das.solver.section import build_section
from tests.support.bundled_sections import BUNDLED, section_of
from tests.support.coach import ns
from tests.support.making import make_route

LIMIT_MPS = 140 * KMH
UPHILL, DOWNHILL = 0.005, -0.01
VALLEY = [(0.0, 0.0), (3000.0, UPHILL), (5000.0, DOWNHILL), (9000.0, 0.0)]
"""A brow: the train slows down up to km 5 and is faster than before at km 9."""
COASTS_M, HELD_KMH = 3000.0, 110.0


class Coasted:
    """A schedule that begins to coast at km 3 with 100 km/h or so, and what is shown of it."""

    def __init__(
        self, grades: list[tuple[float, float]], before: PhaseKind, *rest: tuple[PhaseKind, float, float],
        length_m: float = 16_000.0,
    ) -> None:  # fmt: skip
        vehicle = section_of(BUNDLED[0]).vehicle
        section = build_section(make_route(length_m, [(0.0, LIMIT_MPS)], grades), vehicle)
        first_kmh = 100.0 if before is PhaseKind.HOLD else LIMIT_MPS / KMH
        phases = ((before, 0.0, first_kmh), (PhaseKind.COAST, COASTS_M, rest[0][2]), *rest)
        made = tuple(
            Phase(kind, 0.2 if kind is PhaseKind.TRACTION else 0.0, int(np.searchsorted(section.node_m, at)), v * KMH)
            for kind, at, v in phases
        )
        known = known_run(section, np.full(len(section.node_m), 20.0))
        raw = Schedule(section=section, phases=made, known=known, back_share=0.7)
        self.schedule = raw.settled(0.0, 90 * KMH)[0]
        self.showing = Showing(ShowingSettings())

    def at(self, second: float, s_m: float, v_mps: float) -> ShownNow:
        """What is shown to a train in this state at this second."""
        reference = StandingReference(
            schedule=self.schedule, lambda_w=1e6, arrival_ns=ns(800), point=None, replan=Replan()
        )
        kept = Kept(reference, self.schedule.forecast(s_m, v_mps), 0.0)
        return self.showing.show(kept, TrainState(ns(second), s_m, v_mps), SpeedsAllowed(LIMIT_MPS, LIMIT_MPS))

    def followed(self, from_m: float, to_m: float, slower_mps: float = 0.0) -> list[ShownNow]:
        """What is shown, second by second, to a train that keeps the schedule's speeds or is slower by this much."""
        found, s_m, second = [], from_m, 0
        while s_m < to_m:
            v_mps = self.schedule.speed_at(s_m) - slower_mps
            found.append(self.at(second, s_m, v_mps))
            s_m, second = s_m + v_mps, second + 1
        return found


@pytest.mark.parametrize("before", [PhaseKind.HOLD, PhaseKind.TRACTION])
@pytest.mark.parametrize("slower_mps", [0.0, 0.6])
def test_coasting_over_a_brow_up_to_a_higher_speed_is_coasting_all_the_way(
    before: PhaseKind, slower_mps: float
) -> None:
    """100 km/h, 77 on the brow, 109 behind it: "hold 110" instead would be full traction up the hill."""
    line = Coasted(VALLEY, before, (PhaseKind.HOLD, 8800.0, HELD_KMH), (PhaseKind.BRAKE, 15_000.0, 0.0))
    speeds = [line.schedule.speed_at(at_m) / KMH for at_m in (COASTS_M, 5000.0, 8800.0)]
    assert speeds[1] < speeds[0] - 5 < speeds[2] - 10
    told = [one.now for one in line.followed(2600.0, 8300.0, slower_mps)]
    begun = next(i for i, one in enumerate(told) if one.mode is Regime.COAST)
    assert begun < (COASTS_M - 2600.0) / speeds[0] * 3.6, "shown before it is due"
    assert {one.mode for one in told[begun:]} == {Regime.COAST}
    assert {one.mode for one in told[:begun]} <= {Regime.CRUISE, *TRACTION}
    assert max(abs(one.speed_mps / KMH - speeds[2]) for one in told[begun:]) < 5.0


def test_coasting_that_would_only_make_a_train_slower_than_its_next_speed_is_not_shown() -> None:
    """On the level, a train at 95 km/h that is to hold 100 next does not coast down to 90 first."""
    line = Coasted([(0.0, 0.0)], PhaseKind.HOLD, (PhaseKind.HOLD, 5000.0, 100.0), (PhaseKind.BRAKE, 15_000.0, 0.0))
    now = line.at(0.0, 3100.0, 97 * KMH).now
    assert (now.mode, round(now.speed_mps / KMH)) == (Regime.CRUISE, 100)


@pytest.mark.parametrize("length_m", [8900.0, 9800.0, 10_700.0, 11_500.0, 12_400.0, 13_200.0])
def test_the_speed_named_for_coasting_up_to_a_brake_stands_while_the_forecast_wavers(length_m: float) -> None:
    """The brake begins at a speed between two steps: both in turn would be ten instructions for one act."""
    ends = Coasted([(0.0, 0.0)], PhaseKind.HOLD, (PhaseKind.BRAKE, length_m - 100.0, 0.0), length_m=length_m)
    section = ends.schedule.section
    ends_m = float(section.node_m[np.argmax(section.envelope_mps < ends.schedule.known.speed_mps + 0.01)])
    line = Coasted([(0.0, 0.0)], PhaseKind.HOLD, (PhaseKind.BRAKE, ends_m, 0.0), length_m=length_m)
    told = []
    for i, s_m in enumerate(np.arange(3100.0, ends_m - 400.0, 27.0)):
        wavers_mps = 0.35 * np.sin(i / 9.0)
        told.append(line.at(float(i), float(s_m), line.schedule.speed_at(float(s_m)) + wavers_mps).now)
    named = [round(one.speed_mps / KMH) for one in told if one.mode is Regime.COAST]
    assert len(named) > 150
    assert sum(a != b for a, b in pairwise(named)) <= 1
    assert abs(named[-1] - line.schedule.speed_at(ends_m) / KMH) < 5.0
