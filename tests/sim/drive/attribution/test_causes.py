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


def coasting(shown_mps: float, lever_ratio: float) -> EnergyCause:
    """The cause of a moment at 29 m/s while coasting to a speed is shown and the controller is set so."""
    seen = Seen(mode=Regime.COAST, speed_mps=shown_mps, advised_ratio=0.0, lever_ratio=lever_ratio, top_only=False)
    now = Moment(speed_mps=29.0, driven_ratio=lever_ratio, best_ratio=0.0, coasts_to_brake=True, seen=seen)
    return Judge().cause(now)


def test_a_driver_is_not_blamed_for_late_coasting_by_a_card_with_a_speed_above_the_trains() -> None:
    assert coasting(25.0, 0.6) is EnergyCause.LATE_COASTING
    assert coasting(33.0, 0.6) is EnergyCause.AS_ADVISED
    assert coasting(33.0, 0.0) is EnergyCause.AS_ADVISED
    assert coasting(33.0, -0.2) is EnergyCause.AGAINST_ADVICE
