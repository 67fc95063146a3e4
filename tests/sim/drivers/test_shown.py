"""What is read off a display depends on the presentation, and on nothing that is not shown."""

from __future__ import annotations

import math
from typing import Any

import pytest

from das.advice.modes import Mode
from das.domain.units import KMH
from sim.drivers.cab import AdviceView, Presentation
from sim.drivers.presentations.presenter import Shown


def view(presentation: Presentation, mode: Mode = Mode.CRUISE, **fields: Any) -> AdviceView:
    given = {"speed_mps": 81.4 * KMH, "display_speed_mps": 82 * KMH, "lever_ratio": 0.31, **fields}
    return AdviceView(time_s=0.0, valid_until_s=3.0, presentation=presentation, mode=mode, **given)


def test_each_presentation_shows_what_it_is_for() -> None:
    assert Shown.of(view(Presentation.RMS)) == Shown(mode=None, speed_kmh=82, effort=None)
    assert Shown.of(view(Presentation.FOUR_MODE)) == Shown(mode=Mode.CRUISE, speed_kmh=82, effort=None)
    assert Shown.of(view(Presentation.FOUR_MODE, Mode.COAST)) == Shown(mode=Mode.COAST, speed_kmh=None, effort=None)
    late = view(Presentation.DEVIATION, deviation_s=12.4)
    assert Shown.of(late) == Shown(mode=None, speed_kmh=None, effort=None, deviation_s=12)
    assert Shown.of(view(Presentation.VECTOR)) == Shown(mode=Mode.CRUISE, speed_kmh=82, effort=2)


@pytest.mark.parametrize(("ratio", "steps"), [(0.0, 0), (0.09, 0), (0.11, 1), (-0.29, -1), (-0.31, -2), (1.0, 5)])
def test_effort_is_read_in_fifths_of_the_controller(ratio: float, steps: int) -> None:
    assert Shown.of(view(Presentation.VECTOR, lever_ratio=ratio)).effort == steps


def test_what_is_not_known_is_not_shown() -> None:
    nothing = view(Presentation.VECTOR, speed_mps=math.nan, display_speed_mps=math.nan, lever_ratio=math.nan)
    assert Shown.of(nothing) == Shown(mode=Mode.CRUISE)
    assert Shown.of(view(Presentation.RMS, display_speed_mps=math.nan)) == Shown(speed_kmh=81)
