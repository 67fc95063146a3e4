"""`import sim` on recordings: drives as figures, compared, drawn and reported; nonsense is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import das
import sim
from tests.support.making import REPOSITORY

REFERENCES = REPOSITORY / "recordings" / "references"


def test_a_drive_is_drawn_between_its_stops_with_its_own_figures() -> None:
    drive = sim.Drive.read(REFERENCES / "clear-day.mcap")
    plotted = drive.plotted()
    assert plotted.names == ("clear-day",)
    assert plotted.time_s[-1] - plotted.time_s[0] == pytest.approx(drive.travelled.time_s, abs=1e-3)
    assert (np.diff(plotted.s_m) >= 0).all()
    assert plotted.force_el_n is None, "the recording holds positions alone"
    assert len(das.plot(drive, over="time").axes) >= 2
    assert repr(drive).startswith("<Drive recording: clear-day; ")
    assert len(repr(drive)) < 300


def test_a_recording_without_positions_says_so_in_its_one_line(tmp_path: Path) -> None:
    from das.bus import topics
    from tests.support.recordings import write_recording

    path = write_recording(tmp_path / "empty.mcap", only=(topics.STATUS,), seconds=5)
    assert "unusable: holds no positions" in repr(sim.Drive.read(path))


def test_the_same_drive_twice_does_not_differ() -> None:
    path = str(REPOSITORY / "recordings" / "zurich-zug-late.mcap")
    found = sim.compare(path, path)
    assert repr(found).startswith("<AlignedDrives way: km ")
    assert "does not differ" in repr(found)
    columns = found.columns()
    assert {column.shape for column in columns.values()} == {found.s_m.shape}
    np.testing.assert_array_equal(columns["time_s_1"], columns["time_s_2"])


BAD: dict[str, tuple[Callable[[Path], Any], str]] = {
    "one drive": (lambda _: sim.compare(REFERENCES / "replay.mcap"), "compare: drives = 'one': expected two or more"),
    "no drive": (lambda folder: sim.report(out=folder / "a.html"), "report: drives = 'none': expected at least one"),
    "page there": (lambda folder: sim.report("a.mcap", out=folder / "there"), "there: .*exists"),
    "day there": (lambda folder: sim.record_day("clear-day", folder / "there"), "there: .*exists"),
    "replay there": (lambda folder: sim.replay("trip.csv", folder / "there"), "there: .*exists"),
    "no folder": (lambda folder: sim.record_day("clear-day", folder / "no" / "a.mcap"), "no such folder"),
    "advice": (
        lambda folder: sim.record_day("clear-day", folder / "a.mcap", advice="loud"),
        "record_day: advice = 'loud'",
    ),
    "example there": (sim.write_example, "is already there, expected a new folder"),
    "design": (lambda folder: sim.run_experiment("nowhere", folder / "study"), "nowhere"),
}


@pytest.mark.parametrize("case", BAD)
def test_nonsense_is_refused_before_anything_is_written(case: str, tmp_path: Path) -> None:
    (tmp_path / "there").write_text("mine")
    call, message = BAD[case]
    with pytest.raises(das.DasError, match=message):
        call(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["there"]
    assert (tmp_path / "there").read_text() == "mine"


def test_the_example_is_written_whole(tmp_path: Path) -> None:
    folder = sim.write_example(tmp_path / "my-line")
    assert das.load_route(folder / "route.toml").stops[0].name == "Adorf"
    assert (folder / "trip.csv").stat().st_size > 10_000


@pytest.mark.nightly
def test_a_recorded_day_is_the_day_of_run_day_and_can_be_reported(tmp_path: Path) -> None:
    drive = sim.record_day("clear-day", tmp_path / "day.mcap", seed=1, driver="perfect", advice="speed-and-effort")
    day = sim.run_day("clear-day", seed=1, driver="perfect", advice="speed-and-effort")
    assert drive.energy.driven_j == pytest.approx(3.6e6 * day.outcome["energy_kwh"], rel=1e-9)
    plotted = day.plotted(), drive.plotted()
    assert plotted[0].energy_j[-1] == pytest.approx(day.balance.input, rel=1e-4)
    assert plotted[0].time_s[-1] == pytest.approx(plotted[1].time_s[-1], abs=0.2)
    assert plotted[1].energy_j[-1] == pytest.approx(drive.energy.driven_j, rel=1e-4), "one state a second"
    assert sim.report(drive, out=tmp_path / "day.html").read_text(encoding="utf-8").startswith("<!")
    with pytest.raises(das.DasError, match=r"day\.txt: expected a file name that ends in \.html or \.htm"):
        sim.report(drive, out=tmp_path / "day.txt")
