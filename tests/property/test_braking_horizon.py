"""The horizon of an advice to brake: no later sample above what is allowed where it leads."""

from __future__ import annotations

import numpy as np
import pytest

from das.advice.advice import Advice, Source
from das.domain.restriction import Restriction
from tests.property.test_advice_property import END_M, Allowed, asked, front_of, ns, section_of

SLACK_MPS = 0.1


def check(advice: Advice, allowed: Allowed) -> None:
    """Where a driver is who keeps to the samples, none of them is above limit or brake curve."""
    assert advice.horizon_speed_mps
    at_m, before = advice.s_m, advice.advised_speed_mps
    for after in advice.horizon_speed_mps:
        at_m, before = at_m + 0.5 * (before + after), after
        assert after <= allowed.highest(at_m, at_m) + SLACK_MPS


@pytest.mark.parametrize("number", range(20))
def test_a_train_that_is_too_fast_has_no_horizon_above_a_limit_ahead(number: int) -> None:
    random = np.random.default_rng([25, number])
    start_m = float(random.uniform(1500.0, 6000.0))
    first = Restriction(start_m=start_m, end_m=start_m + 600.0, limit_mps=float(random.uniform(12.0, 25.0)))
    second = Restriction(start_m=start_m + 150.0, end_m=start_m + 500.0, limit_mps=float(random.uniform(4.0, 10.0)))
    section = section_of((first, second))
    allowed, front = Allowed((first, second)), front_of(section)
    for _ in range(20):
        s_m = start_m + float(random.uniform(-600.0, 140.0))
        v_mps = float(np.interp(s_m, section.node_m, section.allowed_mps)) + float(random.uniform(1.0, 12.0))
        advice = asked(front, Source.SOLVED, s_m, v_mps, 400.0).update(ns(0))
        assert "too fast" in advice.reason
        check(advice, allowed)


@pytest.mark.parametrize("beyond_m", [-0.9, -0.3, 0.0, 3.0, 20.0])
def test_at_the_stop_the_horizon_is_to_stand(beyond_m: float) -> None:
    section = section_of(())
    for v_mps in (0.4, 1.0, 3.0, 8.0):
        advice = asked(front_of(section), Source.SOLVED, END_M + beyond_m, v_mps, 400.0).update(ns(0))
        assert advice.reason == "stop here"
        assert max(advice.horizon_speed_mps[1:]) == pytest.approx(0.0, abs=1e-9 if beyond_m >= 0 else 0.1)
        check(advice, Allowed(()))
