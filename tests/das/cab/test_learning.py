"""Reports of the estimates made while driving."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import pytest

from das.cab.learning import CALIBRATION_ON, FORCE_DOUBTS, Learning
from das.estimate.calibration import Calibrator, Estimates, ForceDoubt
from tests.support.driven_node import START_NS, S


def found(mass_ratio: float, doubt: ForceDoubt | None = None, *, usable: bool = True) -> Calibrator:
    """A calibrator with an estimate of the mass."""
    estimates = Estimates(
        mass_ratio=mass_ratio,
        mass_sd=0.01,
        resistance_ratio=1.2,
        resistance_sd=0.05,
        samples=20,
        usable=usable and doubt is None,
        doubt=doubt,
    )
    return cast(Calibrator, SimpleNamespace(estimates=estimates))


BOTH = ("another train than planned", "the force sensor is wrong")


@pytest.mark.parametrize("mass_ratio", [0.55, 0.69, 1.41, 1.59])
def test_a_strange_mass_is_never_called_usable_without_both_explanations(mass_ratio: float) -> None:
    learning = Learning(found(mass_ratio))
    reported = learning.report(START_NS)
    assert reported is not None
    assert (reported.usable, reported.doubt) == (True, ForceDoubt.FAR_MASS)
    text = learning.news(START_NS)
    assert all(words in text for words in BOTH)
    assert learning.news(START_NS + 60 * S) == ""


def test_it_is_never_on_again_without_both_explanations() -> None:
    learning = Learning(found(1.5, ForceDoubt.COASTING))
    assert learning.news(START_NS) == f"calibration off: {FORCE_DOUBTS[ForceDoubt.COASTING]}"
    learning.calibrator = found(1.5)
    text = learning.news(START_NS + 60 * S)
    assert all(words in text for words in BOTH)
    learning.calibrator = found(1.2)
    assert learning.news(START_NS + 120 * S) == CALIBRATION_ON


@pytest.mark.parametrize("calibrator", [found(0.71), found(1.39), found(1.5, usable=False)])
def test_a_mass_near_the_planned_one_or_not_used_is_not_reported(calibrator: Calibrator) -> None:
    learning = Learning(calibrator)
    assert learning.news(START_NS) == ""
    reported = learning.report(START_NS)
    assert reported is not None
    assert reported.doubt == ""
