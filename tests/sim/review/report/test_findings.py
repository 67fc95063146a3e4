"""No best speed is named where a signal at danger or a restriction forbade it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from das.domain.restriction import Restriction
from sim.drive.drive import Drive
from sim.drive.limits import Signal, TemporaryLimit
from sim.drivers.drivers import PerfectDriver
from sim.review.report.findings import findings
from tests.support.flat_days import flat_day
from tests.support.recorded_days import DrivesFaster, inputs_of_day, recorded_day


@pytest.mark.parametrize("hindrance", ["none", "signal", "restriction"])
def test_no_best_speed_past_a_signal_at_danger_or_through_a_restriction(hindrance: str) -> None:
    driver = DrivesFaster(PerfectDriver(flat_day().service.line), 3.0)
    drive = Drive(recording=recorded_day(flat_day(), driver), given=inputs_of_day(flat_day()))
    start_ns, end_ns = drive.table.course.time_ns[[0, -1]].tolist()
    drive = replace(drive)
    assert findings(drive)
    if hindrance == "signal":
        drive.__dict__["signals"] = (Signal(9e9, start_ns, end_ns),)
    if hindrance == "restriction":
        told = Restriction(0.0, 9e9, 10.0)
        drive.__dict__["temporary_limits"] = (TemporaryLimit(told, start_ns, end_ns),)
    places = [place for one in findings(drive) for place in one.places]
    named = [place for place in places if place.best is not None or place.mean_mps is not None]
    assert bool(named) is (hindrance == "none")
