"""Causes of single moments, judged by hand."""

from __future__ import annotations

from das.advice.regimes import Regime
from sim.drive.attribution.causes import EnergyCause, Judge, Moment, Seen


def departing(mode: Regime) -> EnergyCause:
    """The cause of a moment in which the train departs with full traction and no effort is advised for now."""
    seen = Seen(mode=mode, speed_mps=0.0, advised_ratio=0.0, lever_ratio=1.0, top_only=False)
    moment = Moment(speed_mps=0.2, driven_ratio=0.9, best_ratio=1.0, coasts_to_brake=False, seen=seen)
    return Judge().cause(moment)


def test_to_depart_as_advised_is_not_against_the_advice_to_depart_when_cleared() -> None:
    assert departing(Regime.DEPART) is EnergyCause.AS_ADVISED
    assert departing(Regime.CRUISE) is EnergyCause.AGAINST_ADVICE
