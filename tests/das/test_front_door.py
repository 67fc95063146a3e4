"""`import das`: the names it offers, its examples, plain results, and a table of bad inputs with their messages."""

from __future__ import annotations

import builtins
import doctest
import json
import re
import subprocess
import sys
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from types import ModuleType
from typing import Any, get_type_hints

import numpy as np
import pytest

import das
import das.domain.files.load
import das.front_door
import sim
import sim.front_door
from precompute.tables.writing import TableSettings, make_table
from tests.support.making import REPOSITORY
from tests.support.small_tables import quick_references


@pytest.fixture(scope="module")
def section() -> das.Section:
    return das.build_section(das.load_route("flat-6km"), das.load_vehicle("re460-ic"), level="l1")


@pytest.fixture(scope="module")
def front(section: das.Section) -> das.Front:
    return das.solve(section)


@pytest.mark.parametrize("package", [das, sim], ids=lambda package: package.__name__)
def test_every_name_is_there_and_what_type_checkers_see(package: ModuleType) -> None:
    seen: dict[str, Any] = {"__package__": package.__name__}
    stub = Path(str(package.__file__)).with_suffix(".pyi").read_text(encoding="utf-8")
    exec("\n".join(line for line in stub.splitlines() if not line.startswith("__version__")), seen)
    assert {name: value for name, value in seen.items() if not name.startswith("__")} == {
        name: getattr(package, name) for name in package.__all__
    }
    for name in package.__all__:
        assert getattr(package, name) is not None
        assert name in dir(package)
    with pytest.raises(AttributeError, match=f"No {package.__name__} attribute nothing"):
        package.nothing  # noqa: B018


def test_functions_take_few_parameters_and_are_typed() -> None:
    for module in (das, sim):
        for name in module.__all__:
            thing = getattr(module, name)
            if callable(thing) and not isinstance(thing, type):
                assert thing.__doc__
                assert thing.__code__.co_argcount + thing.__code__.co_kwonlyargcount <= 6, name


@pytest.mark.parametrize(
    ("statement", "not_loaded"),
    [
        ("import das", ("numpy", "numba", "zenoh", "mcap")),
        ("import sim", ("numpy", "numba", "zenoh", "mcap")),
        ("import das; das.load_route('flat-6km')", ("numba", "zenoh", "mcap")),
        ("import das; das.read_recording; das.DasError", ("numba", "zenoh")),
        ("import sim.cli.run, sim.world.driving, sim.drivers.human", ("das.cab.cab", "das.advice.guide.guide")),
    ],
)
def test_only_what_is_used_is_imported(statement: str, not_loaded: tuple[str, ...]) -> None:
    code = f"{statement}\nimport json, sys\nprint(json.dumps([name for name in {not_loaded!r} if name in sys.modules]))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=REPOSITORY)
    assert json.loads(run.stdout) == []


@pytest.mark.parametrize("package", ["das", "precompute", "sim"])
def test_packages_say_that_they_are_typed(package: str) -> None:
    assert (files(package) / "py.typed").is_file()


EXAMPLES = [das, das.front_door, das.domain.files.load]
DRIVEN_DAYS = [pytest.param(sim, marks=pytest.mark.nightly), pytest.param(sim.front_door, marks=pytest.mark.slow)]


@pytest.mark.parametrize("module", EXAMPLES + DRIVEN_DAYS, ids=lambda module: module.__name__)
def test_examples_run(module: ModuleType) -> None:
    failed, attempted = doctest.testmod(module, optionflags=doctest.ELLIPSIS)
    assert attempted
    assert not failed


API = REPOSITORY / "docs" / "reference" / "api"
PAGES = [page for page in sorted(API.glob("*.md")) if page.name not in ("index.md", "sim.md")]
OF_SIM = pytest.param(API / "sim.md", marks=pytest.mark.nightly)
"""The page whose example drives a day."""


@pytest.mark.parametrize("page", [*PAGES, OF_SIM], ids=lambda one: one.stem)
def test_the_example_of_a_page_of_the_api_runs(page: Path) -> None:
    failed, attempted = doctest.testfile(str(page), module_relative=False, encoding="utf-8")
    assert attempted
    assert not failed


def test_the_pages_of_the_api_have_the_exported_names_and_no_others() -> None:
    text = "\n".join(page.read_text(encoding="utf-8") for page in [*PAGES, API / "sim.md"])
    lists = re.findall(r"members: \[(.*)\]", text)
    whole = ("das.bus.topics", "das.drawing.picture", "das.front_door", "sim.front_door")
    names = [name for name in re.findall(r"^::: (\S+)$", text, re.MULTILINE) if name not in whole]
    found = [*(name.rpartition(".")[2] for name in names), *(name for one in lists for name in one.split(", "))]
    assert sorted(found) == sorted([*das.__all__, *sim.__all__, "Over", "Picture"])


def test_stops_are_given_by_name_or_number() -> None:
    route, train = das.load_route("zurich-luzern"), das.load_vehicle("re460-ic")
    by_name = das.build_section(route, train, start="thalwil", end="ZUG", level=das.Level.L1)
    by_number = das.build_section(route, train, start=2, end=3, level="l1")
    stops = route.stops[1:3]
    assert [by_name.start_m, by_name.end_m] == [stop.position_m for stop in stops]
    assert [by_number.start_m, by_number.end_m] == [stop.position_m for stop in stops]
    whole = das.build_section(route, train)
    assert [whole.start_m, whole.end_m] == [route.stops[0].position_m, route.stops[-1].position_m]
    assert whole.level is train.default_level


def test_a_run_tells_its_time_its_energy_and_its_gap(front: das.Front) -> None:
    wanted_s = 1.1 * front.fastest().time_s
    run = front.trajectory(wanted_s)
    assert run.time_s == pytest.approx(wanted_s, abs=0.02)
    assert 0.0 <= run.gap_ratio < 0.05
    terms = run.balance.as_dict()
    gone = ("resistance_j", "component_loss_j", "friction_brake_j", "unreturned_j")
    assert terms["irreversible_j"] == pytest.approx(sum(terms[name] for name in gone))
    assert terms["input_j"] == pytest.approx(terms["irreversible_j"] + terms["kinetic_j"] + terms["potential_j"])


def test_columns_of_a_trajectory(front: das.Front) -> None:
    run = front.fastest().trajectory
    columns = run.columns()
    assert {column.shape for column in columns.values()} == {run.s_m.shape}
    np.testing.assert_array_equal(columns["force_el_n"][:-1], run.force_el_n)
    assert (columns["force_el_n"][-1], columns["force_friction_n"][-1]) == (0.0, 0.0)
    np.testing.assert_array_equal(columns["limit_mps"], np.append(run.limit_mps, run.limit_mps[-1]))


def test_points_of_a_front(front: das.Front) -> None:
    points = das.front_points(front, (0, 5, 10))
    np.testing.assert_allclose(points["buffer_percent"], [0, 5, 10], atol=0.02)
    np.testing.assert_allclose(points["time_s"][0], front.fastest().time_s)
    for time_s, energy_j in zip(points["time_s"], points["energy_j"], strict=True):
        assert energy_j == pytest.approx(front.trajectory(time_s).balance.input, rel=1e-3)
    assert (np.diff(points["energy_j"]) < 0).all()
    assert (np.diff(points["lambda_w"]) < 0).all()


def test_points_end_at_the_run_of_least_energy(front: das.Front) -> None:
    points = das.front_points(front, (0, 10, 1e6, 2e6))
    assert len(points["time_s"]) == 3
    assert points["buffer_percent"][-1] < 1e5
    assert {column.shape for column in points.values()} == {(3,)}


def test_a_table_gives_the_front_and_the_references(section: das.Section, front: das.Front, tmp_path: Path) -> None:
    path = tmp_path / "table.json"
    with quick_references():
        path.write_bytes(make_table(section, TableSettings(buffers_percent=(5.0,), refined=False, proven=0)))
    table, solved = das.read_table(str(path)), front.trajectory(1.05 * front.fastest().time_s)
    frame = das.to_pandas(table.columns())
    assert list(frame["buffer_percent"].fillna(-1.0)) == [5.0, -1.0]
    assert (frame["time_s"][0], frame["energy_input_j"][0]) == (solved.time_s, solved.balance.input)
    near = min(table.references.finished, key=lambda one: abs(one.time_s - solved.time_s))
    assert near.energy_j == pytest.approx(solved.balance.input, rel=0.03)


def test_columns_and_energy_balances_become_data_frames(front: das.Front) -> None:
    run = front.fastest()
    table = das.to_pandas(run.trajectory.columns())
    assert list(table) == list(run.trajectory.columns())
    assert len(table) == len(run.trajectory.s_m)
    assert das.to_pandas(run.balance.as_dict())["input_j"].tolist() == [run.balance.input]
    with pytest.raises(das.DasError, match="columns of different lengths: a has 1, b has 2"):
        das.to_pandas({"a": [1], "b": [1, 2]})


def test_without_pandas(monkeypatch: pytest.MonkeyPatch) -> None:
    known = builtins.__import__

    def without(name: str, *args: Any) -> ModuleType:
        if name == "pandas":
            raise ImportError(name)
        return known(name, *args)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(das.DasError, match="pandas is not installed"):
        das.to_pandas({"a": [1]})


def refused(call: Callable[[], object]) -> str:
    with pytest.raises(das.DasError) as error:
        call()
    message = str(error.value)
    assert "\n" not in message
    assert len(message) < 1000
    return message


def on_the_line(**options: Any) -> Callable[[], object]:
    return lambda: das.build_section(das.load_route("zurich-luzern"), das.load_vehicle("re460-ic"), **options)


BAD_SECTIONS: list[tuple[dict[str, Any], str]] = [
    ({"start": "Bern"}, "zurich-luzern.toml: start = 'Bern': expected name or number of a stop (1: Zürich HB, "),
    ({"start": 0}, "start = 0: expected name or number of a stop"),
    ({"end": 99}, "end = 99: expected name or number of a stop"),
    ({"end": True}, "end = True: expected name or number"),
    ({"start": 1000.0}, "positions are given as between_m"),
    ({"start": "Zug", "end": "Zug"}, "end = 'Zug': expected a stop after Zug"),
    ({"start": "Luzern", "end": 1}, "end = 'Zürich HB': expected a stop after Luzern; route.reversed() leads back"),
    ({"level": "l9"}, "re460-ic.toml: level = 'l9': expected one of l0-noreg, l0-reg, l1, l2, l3, own"),
    ({"level": 3}, "level = 3: expected one of l0-noreg"),
    ({"level": "own"}, "no data for level own"),
    (
        {"between_m": (4000.0, 500.0)},
        "between_m = (4000.0, 500.0): expected two positions that rise, from 0 to 57000 m",
    ),
    ({"between_m": (0.0, float("nan"))}, "expected two positions that rise"),
    ({"between_m": (-1.0, 500.0)}, "expected two positions that rise"),
    ({"between_m": (0.0, 1e300)}, "between_m = (0.0, 1e+300): expected two positions that rise"),
    ({"between_m": ("a", "b")}, "between_m = ('a', 'b'): expected two positions (m)"),
    ({"between_m": 5.0}, "between_m = 5.0: expected two positions (m)"),
    ({"between_m": (0.0, 500.0), "start": "Zug"}, "start = 'Zug': expected none with between_m"),
]


@pytest.mark.parametrize(("options", "message"), BAD_SECTIONS)
def test_bad_sections(options: dict[str, Any], message: str) -> None:
    assert message in refused(on_the_line(**options))


@pytest.mark.parametrize("time_s", [float("nan"), float("inf"), 0.0, -5.0])
def test_bad_times(front: das.Front, time_s: float) -> None:
    assert "expected a finite time > 0 s" in refused(lambda: front.trajectory(time_s))


@pytest.mark.parametrize("buffers", [(), (5, 0), (0, 0), (-1,), (0, float("nan")), "many", [[0, 1]], None])
def test_bad_buffers(front: das.Front, buffers: Any) -> None:
    assert "front_points: buffers_percent" in refused(lambda: das.front_points(front, buffers))


def test_bad_files(tmp_path: Path, section: das.Section) -> None:
    (tmp_path / "folder.toml").mkdir()
    (tmp_path / "folder.mcap").mkdir()
    route = section.route
    loaders: list[tuple[str, Callable[[Any], object]]] = [
        ("route", das.load_route),
        ("vehicle", das.load_vehicle),
        ("journey", lambda path: das.load_journey(path, route)),
    ]
    for kind, load in loaders:
        assert "missing.toml: no such file" in refused(lambda load=load: load(tmp_path / "missing.toml"))
        too_long = "x" * 300 + ".toml"
        assert "x.toml: no such file" in refused(lambda load=load, name=too_long: load(tmp_path / name))
        assert "folder.toml: is a folder, expected a file" in refused(lambda load=load: load(tmp_path / "folder.toml"))
        assert f"nowhere: not a bundled {kind}" in refused(lambda load=load: load("nowhere"))
        assert f"expected the name of a bundled {kind}, or a path" in refused(lambda load=load: load(None))
    assert "No such file" in refused(lambda: das.read_recording(tmp_path / "missing.mcap"))
    assert "directory" in refused(lambda: das.read_recording(tmp_path / "folder.mcap"))
    assert "missing: cannot be read" in refused(lambda: das.read_table(tmp_path / "missing"))
    assert "cannot be read" in refused(lambda: das.read_table(tmp_path))


def test_bad_journeys() -> None:
    route, train = das.load_route("zurich-luzern"), das.load_vehicle("re460-ic")
    journey = das.load_journey("zurich-luzern", route)
    message = refused(lambda: das.plan_journey(journey, route, train, split="fair"))
    assert "zurich-luzern.toml: split = 'fair': expected one of equal-marginal, proportional" in message
    assert "level = 'l9'" in refused(lambda: das.plan_journey(journey, route, train, level="l9"))


def test_the_other_values_of_the_front_door() -> None:
    route, train = das.load_route("flat-6km"), das.load_vehicle("re460-ic")
    slow = route.with_restrictions([das.Restriction(start_m=1000.0, end_m=2000.0, limit_mps=10.0)])
    wind = das.Conditions(head_wind_mps=10.0)
    plain, held = (das.build_section(line, train, level="l1") for line in (route, slow))
    windy = das.build_section(wind.line(route), wind.train(train), level="l1")
    fastest = [das.solve(one).fastest() for one in (plain, held, windy)]
    assert fastest[0].time_s < fastest[2].time_s < fastest[1].time_s
    assert fastest[2].balance.resistance > fastest[0].balance.resistance
    assert "restriction: limit_mps = nan" in refused(
        lambda: das.Restriction(start_m=0.0, end_m=1.0, limit_mps=float("nan"))
    )
    assert get_type_hints(das.load_route)["return"] is das.Route
