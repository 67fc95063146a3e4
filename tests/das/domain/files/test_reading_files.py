"""Numbers, texts, lists and files that are too large, or of the wrong type: refused in one short line, and at once."""

from __future__ import annotations

import copy
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from das.domain.errors import MOST_OF_A_MESSAGE, DasError, InputError
from das.domain.files import routes
from das.domain.files.load import catalogue, load_route
from das.domain.files.reading import MOST_BYTES, MOST_ROWS, read_text, read_toml
from das.domain.files.routes import MOST_POINTS, MOST_STOPS, read_route
from das.domain.files.vehicles import read_loss_map, read_vehicle
from das.offline import ttobench
from das.offline.asked_journey import journey_of
from tests.das.domain.files.refusing import Read, refused
from tests.das.domain.files.test_routes import ROUTE
from tests.das.domain.files.test_vehicles import VEHICLE


def test_a_curve_may_be_as_wide_as_it_likes(tmp_path: Path) -> None:
    path = tmp_path / "wide.toml"
    path.write_text(ROUTE.replace("[0.3, inf, -400]", "[0.3, 1e30, -400]"))
    assert read_route(path).curvature_per_m.value[1] == pytest.approx(1 / 800)


def rows(count: int) -> str:
    return ", ".join(f"[{3.0 * i / count}, {72 + i % 2}]" for i in range(count))


def test_lists_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Points of geometry up to 2 000 here: 200 000 take a second to read."""
    most_points = MOST_POINTS // 100
    monkeypatch.setattr(routes, "MOST_POINTS", most_points)
    path = tmp_path / "long.toml"
    limits = "[[0.0, 72.0], [1.5, 90]]"
    path.write_text(ROUTE.replace(limits, f"[{rows(MOST_ROWS + 1)}]"))
    message = f"number of speed_limits.rows = {MOST_ROWS + 1}: expected at most {MOST_ROWS}"
    assert refused(read_route, path) == f"{path}: {message}"
    path.write_text(ROUTE.replace(limits, f"[{rows(MOST_ROWS)}]"))
    assert len(read_route(path).limits_mps.value) == MOST_ROWS
    stops = "".join(f'[[stops]]\nname = "S{i}"\nposition_m = {i}\n' for i in range(1, MOST_STOPS))
    path.write_text(ROUTE.replace("[speed_limits]", f"{stops}[speed_limits]"))
    assert f"number of stops = {MOST_STOPS + 1}: expected at most {MOST_STOPS}" in refused(read_route, path)
    points = ",".join(f"[{i},1,1]" for i in range(most_points + 1))
    geometry = f'[geometry]\ncolumns = ["position_m", "latitude_deg", "longitude_deg"]\nrows = [{points}]\n'
    path.write_text(ROUTE + geometry)
    assert f"number of geometry.rows = {most_points + 1}" in refused(read_route, path)


def test_lists_of_the_benchmark_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "long.json"
    limits = {"units": {"position": "m", "velocity": "km/h"}, "values": [[i, 50] for i in range(MOST_ROWS + 1)]}
    path.write_text(json.dumps({"stops": {"unit": "m", "values": [0, 1e6]}, "speed limits": limits}))
    assert f"number of speed limits.values = {MOST_ROWS + 1}" in refused(ttobench.read_track, path)
    path.write_text(json.dumps({"stops": {"unit": "km", "values": [0, 1e300]}}))
    assert "stops.values[1] = 1e+300: expected a number of at most" in refused(ttobench.read_track, path)


def test_a_loss_map_has_so_many_points(tmp_path: Path) -> None:
    path = tmp_path / "map.csv"
    path.write_text("speed_kmh,force_n,loss_w\n" + "".join(f"{i},{i},1\n" for i in range(3000)))
    assert "size of the loss map = '3000 speeds × 3000 forces': expected at most 5000000" in refused(
        read_loss_map, path
    )


@pytest.mark.parametrize(
    ("read", "name"), [(read_vehicle, "x.toml"), (ttobench.read_train, "x.json"), (read_loss_map, "x.csv")]
)
def test_large_files_are_not_read(tmp_path: Path, read: Read, name: str) -> None:
    path = tmp_path / name
    with path.open("wb") as file:
        file.truncate(100 * MOST_BYTES)
    assert refused(read, path) == f"{path}: more than 5 MB, expected a smaller file"


def test_large_values_are_not_repeated(tmp_path: Path) -> None:
    path = tmp_path / "large.toml"
    for value in (f'"{"x" * 2_000_000}"', f"[{'1,' * 100_000}]"):
        path.write_text(f"schema_version = {value}")
        message = refused(read_vehicle, path)
        assert "schema_version = " in message
        assert message.endswith("characters): expected 1")
    path.write_text(f"schema_version = 1\n{'k' * 2_000_000} = 1")
    assert "expected one of the keys adhesion" in refused(read_vehicle, path)


def test_deep_nesting_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "deep.toml"
    for depth in (50, 150, 100_000):
        path.write_text(f"schema_version = {'[' * depth}{']' * depth}")
        assert refused(read_vehicle, path)
        path.with_suffix(".json").write_text(f'{{"mass": {"[" * depth}{"]" * depth}}}')
        assert refused(ttobench.read_train, path.with_suffix(".json"))


def test_only_regular_files_are_read(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.toml"
    os.mkfifo(pipe)
    assert refused(read_vehicle, pipe) == f"{pipe}: not a regular file"
    assert refused(read_vehicle, tmp_path).endswith("cannot be read (Is a directory)")
    with pytest.raises(DasError, match="cannot be read"):
        read_text(tmp_path / "nul\0.toml")
    path = tmp_path / "v.toml"
    csv = VEHICLE[: VEHICLE.index("[losses.l3]")] + '[losses.l3]\nkind = "csv"\npath = "{}"\n'
    for name, expected in (("pipe.toml", "not a regular file"), ("", "directory"), ("nul\\u0000", "cannot be read")):
        path.write_text(csv.format(name))
        with pytest.raises(DasError, match=expected):
            read_vehicle(path)


def places(data: Any, way: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The way to every value of a document; of a list of rows only the first and the last."""
    entries = list(data.items()) if isinstance(data, dict) else list(enumerate(data)) if isinstance(data, list) else []
    for key, value in entries if isinstance(data, dict) else dict([*entries[:1], *entries[-1:]]).items():
        yield (*way, key)
        yield from places(value, (*way, key))


HOSTILE: tuple[Any, ...] = (
    *("", "x" * 1000, "\x1b[31m", "1", True, False, 0, -1, 10**30, 1e300, -1e300, float("inf"), float("-inf")),
    *(float("nan"), [], [[]], [1], {}, {"a": {}}, None),
)


def as_toml(value: Any) -> str:
    """A value as TOML; nothing has no words in it and becomes an empty table."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {as_toml(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(as_toml(inner) for inner in value) + "]"
    if isinstance(value, float):
        return repr(value)  # inf and nan are written alike
    return "{}" if value is None else json.dumps(value)


def document(data: dict[str, Any]) -> str:
    return "".join(f"{json.dumps(key)} = {as_toml(value)}\n" for key, value in data.items())


def outcome(read: Read, path: Path) -> str:
    """Why a file is refused; empty where it is read."""
    try:
        read(path)
    except DasError as error:
        return str(error)
    return ""


@pytest.mark.nightly
def test_mutated_files_are_read_or_refused_in_one_line(tmp_path: Path) -> None:
    """Every value of our own formats becomes one of the wrong type, size or sign; nothing else than a refusal comes."""
    route = load_route("zurich-luzern")
    small = tmp_path / "small.toml"
    small.write_text(VEHICLE)
    line = tmp_path / "line.toml"
    line.write_text(ROUTE)
    readers: list[tuple[Read, Path]] = [
        (read_vehicle, small),
        (read_route, line),
        (lambda path: journey_of(read_toml(path), route), catalogue("journeys")["zurich-luzern"]),
    ]
    path = tmp_path / "mutated.toml"
    found = {"read": 0, "refused": 0}
    for read, original in readers:
        data = dict(read_toml(original).data)
        path.write_text(document(data))
        read(path)
        for way in places(data):
            for value in HOSTILE:
                mutated = copy.deepcopy(data)
                place: Any = mutated
                for key in way[:-1]:
                    place = place[key]
                place[way[-1]] = value
                path.write_text(document(mutated))
                message = outcome(read, path)
                assert message.isprintable(), (way, value)
                assert len(message) <= MOST_OF_A_MESSAGE, (way, value)
                found["refused" if message else "read"] += 1
    assert found["refused"] > 1000
    assert 0 < found["read"] < found["refused"]


def test_an_error_keeps_what_it_was_told() -> None:
    error = InputError("a.toml", "mass_t", 10**30, "a number")
    assert (error.source, error.key, error.value, error.expected) == ("a.toml", "mass_t", 10**30, "a number")
    assert str(DasError("one\ntwo \x1b[31m red")) == r"one\ntwo \x1b[31m red"
    assert str(DasError("Zürich\u00a0HB → 5\u202fkm")) == "Zürich\u00a0HB → 5\u202fkm"
    assert str(DasError("x" * 5000)).endswith("x… (5000 characters)")
    assert str(DasError()) == ""
