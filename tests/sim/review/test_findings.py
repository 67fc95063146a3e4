"""No best speed is named where a signal at danger or a restriction forbade it."""

from __future__ import annotations

import pytest

from das.domain.restriction import Restriction
from sim.drive.limits import Signal, TemporaryLimit
from sim.review.first_page import findings
from tests.sim.review.test_report import fast, other


@pytest.mark.parametrize("hindrance", ["none", "signal", "restriction"])
def test_no_best_speed_past_a_signal_at_danger_or_through_a_restriction(hindrance: str) -> None:
    start_ns, end_ns = fast().drive.table.course.time_ns[[0, -1]].tolist()
    drive = {
        "none": other(),
        "signal": other(signals=(Signal(9e9, start_ns, end_ns),)),
        "restriction": other(temporary_limits=(TemporaryLimit(Restriction(0.0, 9e9, 10.0), start_ns, end_ns),)),
    }[hindrance]
    assert findings(drive)
    places = [place for one in findings(drive) for place in one.places]
    named = [place for place in places if place.best is not None or place.mean_mps is not None]
    assert bool(named) is (hindrance == "none")
