"""Causes of single moments, judged by hand."""

from __future__ import annotations

import pytest

from das.advice.regimes import Regime
from sim.drive.causes import EnergyCause, Judge, Moment, Seen


def departing(mode: Regime) -> EnergyCause:
    """The cause of a moment in which the train departs with full traction and no effort is advised for now."""
    seen = Seen(mode=mode, speed_mps=0.0, advised_ratio=0.0, lever_ratio=1.0, top_only=False)
    moment = Moment(speed_mps=0.2, driven_ratio=0.9, best_ratio=1.0, coasts_to_brake=False, seen=seen)
    return Judge().cause(moment)


def test_to_depart_as_advised_is_not_against_the_advice_to_depart_when_cleared() -> None:
    assert departing(Regime.DEPART) is EnergyCause.AS_ADVISED
    assert departing(Regime.CRUISE) is EnergyCause.AGAINST_ADVICE


def coasting_moment(shown_mps: float, lever_ratio: float) -> Moment:
    """A moment at 29 m/s while coasting to a speed is shown and the controller is set so."""
    seen = Seen(mode=Regime.COAST, speed_mps=shown_mps, advised_ratio=0.0, lever_ratio=lever_ratio, top_only=False)
    return Moment(speed_mps=29.0, driven_ratio=lever_ratio, best_ratio=0.0, coasts_to_brake=True, seen=seen)


def coasting(shown_mps: float, lever_ratio: float) -> EnergyCause:
    """The cause of such a moment."""
    return Judge().cause(coasting_moment(shown_mps, lever_ratio))


@pytest.mark.parametrize("shown_mps", [25.0, 33.0], ids=["below the train's speed", "above it"])
def test_to_pull_while_coasting_is_shown_is_against_what_is_shown_whatever_speed_it_names(shown_mps: float) -> None:
    """A coast to a speed above the train's leads there down a hill; nobody has to pull for it."""
    assert coasting(shown_mps, 0.6) is EnergyCause.LATE_COASTING
    assert coasting(shown_mps, 0.0) is EnergyCause.AS_ADVISED


def test_to_brake_after_coasting_has_begun_is_against_the_advice() -> None:
    judge = Judge()
    causes = [judge.cause(coasting_moment(33.0, ratio)) for ratio in (0.0, 0.0, 0.0, -0.2)]
    assert causes == [*[EnergyCause.AS_ADVISED] * 3, EnergyCause.AGAINST_ADVICE]
