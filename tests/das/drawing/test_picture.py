"""`das.plot`: the lines of a picture are the numbers of the runs, whatever is drawn, and nonsense is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import das
from das.domain.route import Stop
from das.domain.units import KM, KMH, KWH
from das.drawing.colors import look_of
from das.drawing.picture import Over, Picture, draw_runs
from das.drawing.plotted import PlottedRun, plotted_on
from tests.support.making import REPOSITORY


@pytest.fixture(scope="module")
def fronts() -> tuple[das.Front, das.Front]:
    """The fronts of two trains on six flat kilometres."""
    route = das.load_route("flat-6km")
    first, second = (
        das.solve(das.build_section(route, das.load_vehicle(name), level="l1"))
        for name in ("re460-ic", "re460-ic-igbt")
    )
    return first, second


@pytest.fixture(scope="module")
def run(fronts: tuple[das.Front, das.Front]) -> das.Solution:
    return fronts[0].trajectory(240.0)


def line(picture: Picture, title: str, label: str) -> tuple[np.ndarray, np.ndarray]:
    """The points of a line by its label, in the axis with a title."""
    axis = next(one for one in picture.axes if one.get_ylabel().startswith(title))
    drawn = next(one for one in axis.lines if str(one.get_label()).startswith(label))
    return np.asarray(drawn.get_xdata()), np.asarray(drawn.get_ydata())


def words(picture: Picture) -> list[str]:
    """What the legend of a picture says."""
    return [text.get_text() for text in picture.legends[0].get_texts()]


def test_a_run_is_drawn_as_it_is(run: das.Solution) -> None:
    picture = das.plot(run)
    at_km, speed_kmh = line(picture, "speed", "240 s")
    np.testing.assert_array_equal(at_km, run.trajectory.s_m / KM)
    np.testing.assert_array_equal(speed_kmh, run.trajectory.v_mps / KMH)
    _, energy_kwh = line(picture, "energy", "240 s")
    assert energy_kwh[-1] * KWH == pytest.approx(run.balance.input, rel=1e-9)
    assert words(picture) == ["limit", f"240 s, {run.balance.input / KWH:.1f} kWh"]
    assert [axis.get_ylabel().split(",")[0] for axis in picture.axes] == ["speed", "wheel force", "energy"], (
        "it is flat"
    )
    assert {text.get_text() for text in picture.axes[0].texts} == {"A", "B"}


def test_over_time_a_run_lies_at_its_minutes(run: das.Solution) -> None:
    minutes, speed_kmh = line(das.plot(run, over="time"), "speed", "240 s")
    np.testing.assert_allclose(60.0 * minutes, run.trajectory.t_s, atol=1e-9)
    np.testing.assert_array_equal(speed_kmh, run.trajectory.v_mps / KMH)


def test_several_runs_are_named_by_what_tells_them_apart(
    fronts: tuple[das.Front, das.Front], run: das.Solution
) -> None:
    other = fronts[1].trajectory(240.0)
    picture = das.plot(run, other)
    names = [front.section.vehicle.name for front in fronts]
    assert [text.startswith(name) for text, name in zip(words(picture)[1:], names, strict=True)] == [True, True]
    assert "A – B" in picture.get_suptitle()
    assert "level l1" in picture.get_suptitle()
    colours = {one.get_color() for one in picture.axes[0].lines if "kWh" in str(one.get_label())}
    assert len(colours) == 2
    assert words(das.plot(run, other, labels=("old", "new")))[1:] == [
        f"{name}, 240 s, {one.balance.input / KWH:.1f} kWh" for name, one in (("old", run), ("new", other))
    ]


def test_many_runs_all_look_different(run: das.Solution) -> None:
    looks = {(str(look["color"]), str(look["linestyle"])) for look in map(look_of, range(36))}
    assert len(looks) == 36
    first, seventh = (das.plot(*[run] * 7).axes[0].lines[at] for at in (1, 7))
    assert first.get_color() == seventh.get_color()
    assert first.get_linestyle() != seventh.get_linestyle()


def test_over_time_the_limit_is_said_to_be_that_of_the_first_run(run: das.Solution) -> None:
    assert words(das.plot(run, run, over="time"))[0] == "limit of the first run"
    assert words(das.plot(run, over="time"))[0] == words(das.plot(run, run))[0] == "limit"


def test_fronts_are_drawn_through_their_points(fronts: tuple[das.Front, das.Front]) -> None:
    points = das.front_points(fronts[0])
    picture = das.plot(*fronts)
    percent, energy_kwh = line(picture, "energy", fronts[0].section.vehicle.name)
    np.testing.assert_array_equal(percent, points["buffer_percent"])
    np.testing.assert_allclose(energy_kwh * KWH, points["energy_j"])
    time_s, _ = line(das.plot(*fronts, over="time"), "energy", fronts[0].section.vehicle.name)
    np.testing.assert_array_equal(time_s, points["time_s"])


def test_a_journey_is_drawn_with_its_stops_and_windows() -> None:
    route, train = das.load_route("zurich-luzern"), das.load_vehicle("re460-ic")
    plan = das.plan_journey(das.load_journey("zurich-luzern", route), route, train, level="l0-reg")
    picture = das.plot(plan)
    assert {text.get_text() for text in picture.axes[0].texts} == {"Zürich HB", "Thalwil", "Zug", "Luzern"}
    _, energy_kwh = line(picture, "energy", "")
    assert energy_kwh[-1] * KWH == pytest.approx(plan.input_j, rel=1e-9)
    clock = next(axis for axis in picture.axes if axis.get_ylabel().startswith("min"))
    marks = [one for one in clock.lines if one.get_marker() in ("^", "v")]
    bounds = [
        bound
        for one in plan.plotted().windows
        for bound in (one.window.earliest_s, one.window.latest_s)
        if np.isfinite(bound)
    ]
    begin_s = plan.sections[0].departure.time_s
    np.testing.assert_allclose([60.0 * one.get_ydata()[0] + begin_s for one in marks], bounds)


def test_friction_braking_is_hatched_and_a_name_without_room_is_left_out(run: das.Solution) -> None:
    plotted, route = plotted_on(run.section, run.trajectory), run.section.route
    crowded = replace(route, stops=(*route.stops[:1], Stop(name="near A", position_m=30.0), *route.stops[1:]))
    braked = replace(plotted, route=crowded, force_friction_n=np.where(plotted.s_m > 5500.0, -1e4, 0.0))
    picture = draw_runs([braked])
    assert {text.get_text() for text in picture.axes[0].texts} == {"A", "B"}
    assert [text.get_text() for text in picture.axes[1].get_legend().get_texts()] == ["motors", "friction brake"]


def test_of_a_bare_run_only_the_speed_is_drawn() -> None:
    bare = PlottedRun(names=("bare",), time_s=np.arange(3.0), s_m=np.arange(3.0), speed_mps=np.ones(3))
    picture = draw_runs([bare], Over.TIME)
    assert len(picture.axes) == 1
    assert words(picture) == ["2 s"]
    assert bare.stops == []


def test_a_picture_is_shown_in_a_notebook_and_saved_once(run: das.Solution, tmp_path: Path) -> None:
    path = tmp_path / "run.png"
    picture = das.plot(run, save=path)
    written = path.read_bytes()
    assert written.startswith(b"\x89PNG")
    das.plot(run, save=tmp_path / "again.png")
    assert (tmp_path / "again.png").read_bytes() == written, "the same picture gives the same bytes"
    assert picture._repr_png_().startswith(b"\x89PNG")
    assert repr(picture) == "<Picture: a notebook shows it; in a script, write it with .save('run.png')>"
    with pytest.raises(das.DasError, match=r"run.png: exists already; picture.save\(…, overwrite=True\) replaces it"):
        picture.save(path)
    with pytest.raises(das.DasError, match=r"run.gif: expected a file name that ends in .png, .pdf or .svg"):
        picture.save(tmp_path / "run.gif")
    picture.save(path, overwrite=True)
    assert path.read_bytes().startswith(b"\x89PNG")


BAD: list[tuple[dict[str, Any], str]] = [
    ({"shown": ()}, "plot: runs = 'none': expected at least one run or front"),
    ({"shown": ("run", 5)}, "plot: runs = 'int': expected solutions"),
    ({"shown": ("run", "front")}, "plot: runs = 'fronts and runs': expected either fronts or runs"),
    ({"shown": ("run",), "over": "buffer"}, "plot: over = <Over.BUFFER: 'buffer'>: expected buffer or time for fronts"),
    ({"shown": ("front",), "over": "distance"}, "expected buffer or time for fronts, distance or time for runs"),
    ({"shown": ("run",), "over": "speed"}, "plot: over = 'speed': expected one of distance, time, buffer"),
    ({"shown": ("run",), "labels": ("a", "b")}, "plot: labels = '2 of them': expected 1, one for each run"),
]


@pytest.mark.parametrize(("given", "message"), BAD)
def test_nonsense_is_refused(
    given: dict[str, Any], message: str, fronts: tuple[das.Front, das.Front], run: das.Solution
) -> None:
    known = {"run": run, "front": fronts[0]}
    shown = [known.get(one, one) for one in given.pop("shown")]
    with pytest.raises(das.InputError) as error:
        das.plot(*shown, **given)
    assert message in str(error.value)


def test_without_matplotlib_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    import importlib.util

    from das.command_line.files import check_picture

    known = importlib.util.find_spec
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == "matplotlib" else known(name))
    with pytest.raises(das.DasError, match=r"^pictures need matplotlib: install the extra, pip install '.\[view\]'"):
        check_picture(tmp_path / "run.png")
    check_picture(None)


def test_objects_say_in_one_line_what_they_are(fronts: tuple[das.Front, das.Front], run: das.Solution) -> None:
    route, section = run.section.route, run.section
    drive = das.read_recording(REPOSITORY / "recordings" / "zurich-zug-late.mcap")
    for thing in (route, section.vehicle, section, fronts[0], run, run.trajectory, run.balance, drive):
        text, table = repr(thing), thing._repr_html_()
        assert text.startswith(f"<{type(thing).__name__} ")
        assert "\n" not in text
        assert len(text) < 500
        assert table.count("<tr>") == len(thing.facts()) > 1
    assert "needs: 240 s" in repr(run)
    assert "<b>" not in replace(route, name="<b>bold</b>")._repr_html_()
