"""Estimates made while driving may lower the braking curve, never raise it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from das.advice.planner import Planner
from das.cab.situation import Situation
from das.domain.conditions import Conditions
from das.domain.files.load import load_route, load_vehicle
from das.solver.state import fastest
from tests.support.crossing import crossed

PLANNED = Situation(route=load_route("zurich-luzern"), vehicle=load_vehicle("re460-ic"))


@pytest.mark.parametrize(("mass", "resistance"), crossed([0.5, 0.8, 1.0, 1.3, 1.6], [0.4, 1.0, 1.7, 2.5]))
def test_the_braking_curve_never_rises(mass: float, resistance: float) -> None:
    found = replace(PLANNED, conditions=Conditions(mass_ratio=mass, resistance_ratio=resistance))
    planned, calibrated = PLANNED.section(0.0, 12e3), found.section(0.0, 12e3)
    at_m = np.arange(0.0, 12e3, 1.0)
    before, after = (Planner(one) for one in (planned, calibrated))
    # Curves between nodes of two grids differ by a little, most where a limit ends.
    allowed, curve = ([one.allowed_mps(s_m) for s_m in at_m] for one in (before, after))
    assert all(curve[i] <= max(allowed[i : i + 3]) + 0.02 for i in range(len(at_m)))
    assert fastest(calibrated).feasible


def test_a_heavier_train_brakes_earlier() -> None:
    heavy = replace(PLANNED, conditions=Conditions(mass_ratio=1.3)).section(0.0, 12e3)
    planned = PLANNED.section(0.0, 12e3)
    at_m = 12e3 - 400.0
    assert np.interp(at_m, heavy.node_m, heavy.envelope_mps) < np.interp(at_m, planned.node_m, planned.envelope_mps)
