"""Effort curves: what lies between their points, their largest power, and what an envelope makes of them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from das.domain.effort import SAMPLE_STEP_MPS, EffortCurve, EffortEnvelope
from das.domain.formulary import largest_power_w

CURVE = EffortCurve(speed_mps=(0.0, 10.0, 20.0, 40.0), force_n=(1e5, 1e5, 4e4, 3e4))


def test_a_curve_is_linear_between_its_points_and_constant_beyond() -> None:
    """Worked out by hand."""
    assert CURVE.at([0.0, 5.0, 15.0, 30.0, 50.0]) == pytest.approx([1e5, 1e5, 7e4, 3.5e4, 3e4])


@given(
    st.lists(st.floats(0.5, 20.0), min_size=1, max_size=8),
    st.lists(st.floats(0.0, 3e5), min_size=9, max_size=9),
)
def test_the_largest_power_of_a_curve_is_that_of_brute_force(steps: list[float], forces: list[float]) -> None:
    speed, force = np.cumsum([0.0, *steps]), np.array(forces[: len(steps) + 1])
    dense = np.union1d(np.linspace(0.0, speed[-1], 20_001), speed)  # A curve is steep between any two of its points.
    found, brute = largest_power_w(speed, force), float((dense * np.interp(dense, speed, force)).max())
    assert brute * (1 - 1e-12) <= found <= brute * (1 + 1e-3) + 1e3


def test_samples_are_the_curve_at_every_tenth_of_a_kilometre_per_hour() -> None:
    assert CURVE.samples_n == pytest.approx(CURVE.at(SAMPLE_STEP_MPS * np.arange(1441)))
    assert CURVE.samples_n[-1] == 3e4


def test_an_envelope_of_a_curve_is_the_curve_up_to_the_top_speed() -> None:
    """Beyond its last point the force stays the same: the largest power is then that at the top speed."""
    envelope = EffortEnvelope.of_curve(CURVE, 45.0)
    speeds = np.linspace(0.0, 45.0, 1000)
    assert envelope.force_n(speeds) == pytest.approx(CURVE.at(speeds))
    assert envelope.max_force_n == 1e5
    assert envelope.max_power_w == pytest.approx(45.0 * 3e4)


def test_force_and_power_cut_a_curve() -> None:
    envelope = EffortEnvelope(max_force_n=8e4, max_power_w=1e6, curve=CURVE)
    assert envelope.force_n([5.0, 15.0, 20.0, 40.0]) == pytest.approx([8e4, 1e6 / 15, 4e4, 1e6 / 40])
