"""The picture of a recording: everything where it was, nothing over something else, every panel."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.bus import topics
from das.domain.errors import DasError
from das.domain.units import KM
from das.drawing.meanings import DARK
from sim.drive.drive import Drive
from sim.recording.opening import open_recording
from sim.review import view
from sim.review.scene import ReviewScene
from tests.support.crossing import crossed
from tests.support.hand_recorded import day, recorded
from tests.support.making import das_sim
from tests.support.recordings import write_recording

pytest.importorskip("matplotlib")
from das.drawing.meanings import COMPARED
from sim.drive.comparison import AlignedDrives, on_track
from sim.drivers.kinds import DriverKind, Presentation
from sim.review.canvas import comparison_figure, half_width_ratio, joined_labels
from sim.review.lanes import instructions
from sim.review.picture import panels, picture_of
from tests.support.flat_days import flat_day
from tests.support.recorded_days import inputs_of_day, recorded_day

GUIDE, NONE = Presentation.GUIDE, Presentation.NONE


def test_the_picture_shows_them_where_they_were() -> None:
    shown, empty = (picture_of(one, DARK) for one in (day(), recorded()))
    for figure in (shown, empty):
        figure.canvas.draw()

    def colour(figure: Any, s_m: float, speed_kmh: float) -> Any:
        x, y = figure.axes[0].transData.transform((s_m / KM, speed_kmh))
        pixels = np.asarray(figure.canvas.buffer_rgba())[::-1][round(y) - 2 : round(y) + 3, round(x) - 2 : round(x) + 3]
        return np.median(pixels[..., :3].reshape(-1, 3), axis=0) / 255.0

    plain = colour(empty, 1450.0, 50.0)
    assert np.ptp(colour(shown, 1450.0, 50.0) - plain) < 0.05  # grey, and lighter
    assert colour(shown, 1450.0, 50.0).min() > plain.max() + 0.1
    assert colour(shown, 450.0, 60.0)[0] > colour(shown, 450.0, 60.0)[1:].max() + 0.03  # reddish above 36 km/h
    assert colour(shown, 450.0, 15.0) == pytest.approx(plain, abs=0.01)
    assert colour(shown, 1000.0, 4.0)[0] > 0.6  # the signal
    assert colour(shown, 1100.0, 50.0) == pytest.approx(plain, abs=0.01)


def test_numbers_of_marks_do_not_cover_each_other() -> None:
    rng = np.random.default_rng(5)
    for _ in range(50):
        places = np.sort(rng.uniform(0.0, 1.0, 25) ** 2)
        found = joined_labels([(float(x), number) for number, x in enumerate(places, start=1)])
        assert sorted(number for _, numbers in found for number in numbers) == list(range(1, 26))
        ends = [(middle - half_width_ratio(numbers), middle + half_width_ratio(numbers)) for middle, numbers in found]
        assert all(a[1] <= b[0] + 1e-12 for a, b in pairwise(ends))


def test_the_whole_picture_has_every_panel() -> None:
    full, least = (panels(ReviewScene.of(Drive(source=one))) for one in (day(), recorded()))
    assert list(full) == ["speed", "lanes", "lever", "deviation", "buffer", "estimate", "calibration"]
    assert list(least) == ["speed"]
    assert len(picture_of(day()).axes) == 3 + len(full)


@pytest.mark.parametrize(("only", "seconds"), crossed([(topics.POSITION,), (topics.ADVICE,), topics.RECORDED], [1, 30]))
def test_png_of_little(tmp_path: Path, only: tuple[topics.Topic, ...], seconds: int) -> None:
    write_recording(tmp_path / "little.mcap", only=only, seconds=seconds)
    answer = das_sim("view", "little.mcap", "--png", "little.png", cwd=tmp_path)
    assert answer.returncode == 0, answer.stderr
    assert (tmp_path / "little.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["little.mcap", "little.png"]


@pytest.mark.parametrize(("suffix", "begins"), [("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_the_suffix_decides_the_kind_of_picture(tmp_path: Path, suffix: str, begins: bytes) -> None:
    recording = write_recording(tmp_path / "r.mcap", seconds=2)
    view.save_picture(open_recording(recording), tmp_path / f"x.{suffix}")
    assert (tmp_path / f"x.{suffix}").read_bytes().startswith(begins)


def test_png_is_refused_where_it_cannot_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recording = write_recording(tmp_path / "r.mcap", seconds=2)
    before = recording.read_bytes()
    for arguments, reason in (
        (["--save", str(recording)], "is also an input"),
        (["--png", str(tmp_path / "nowhere" / "x.png")], "no such folder"),
        (["--plot", str(tmp_path / "x.svg"), "--save", str(tmp_path / "x.svg")], "name the same file"),
        (["--language", "it"], "'it' is not one of 'en', 'de', 'fr'"),
        (["--plot", str(tmp_path / "x.jpg")], "expected a file name that ends in .png, .pdf or .svg"),
    ):
        answer = das_sim("view", str(recording), *arguments, cwd=tmp_path)
        assert answer.returncode == 2
        assert reason in answer.stderr
    assert recording.read_bytes() == before
    monkeypatch.setattr(view.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(DasError, match=r"matplotlib is not installed.*\[view\]"):
        view.save_picture(open_recording(recording), tmp_path / "x.png")
    assert [path.name for path in tmp_path.iterdir()] == ["r.mcap"]


def test_compared_drives_have_a_strip_of_what_each_display_said() -> None:
    """One panel for each drive with a display, in words if it changes seldom; the others are the same as ever."""
    day = flat_day()
    shown = {advice: recorded_day(day, day.driver(DriverKind.HUMAN), advice) for advice in (GUIDE, NONE)}
    drives = [Drive(source=one, given=inputs_of_day(day)) for one in shown.values()]
    aligned = AlignedDrives.of([on_track(one, label) for one, label in zip(drives, ("led", "alone"), strict=True)])
    figure = comparison_figure(aligned)
    assert figure.get_figheight() < 11.7, "it fits on a sheet A4"
    speed, said, _, _ = figure.axes
    assert 160.0 < speed.get_ylim()[1] < 1.1 * 160.0, "the limit of the line is just below the top"
    words = [text.get_text() for text in said.texts]
    assert words == [one.state for one in instructions(drives[0]).changes if one.state][: len(words)]
    assert len(words) > 1
    assert said.get_title(loc="left") == "led"
    assert [line.get_color() for line in speed.get_lines() if line.get_label() in ("led", "alone")] == list(
        COMPARED[:2]
    )


def test_the_title_of_a_picture_is_not_cut() -> None:
    long = recorded()
    long.metadata["run"] = {
        "scenario": "day-of-the-recording",
        "driver": "a.very.long.module.name:DriverOfTheRecording",
    }
    figure = picture_of(long)
    (title,) = (text for text in figure.texts if "DriverOfTheRecording" in text.get_text())
    box = title.get_window_extent(figure.canvas.get_renderer())
    assert 0 < box.x0 < box.x1 < figure.bbox.x1
