"""TTOBench files: our own and all of the library are read, units are honoured, bad files get their messages."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.domain.files.load import load_journey, load_route, load_vehicle
from das.domain.levels import Level
from das.domain.losses import EfficiencyLoss
from das.domain.vehicle import BrakePolicy, Vehicle
from das.offline.ttobench import read_track, read_train
from tests.das.domain.files.refusing import Read, refused
from tests.support import benchmark
from tests.support.benchmark import DATA, JOURNEY, SHARED, TRACKS, TRAINS, journey_path, track_path, train_path

TRAIN_FIGURES = {  # mass kg, kN and kW of traction, R(72 km/h) in kN by hand, brakes
    "own": (100_000, 100, 2000, 2 + 0.01 * 72 + 0.0005 * 72**2, BrakePolicy.BLENDED),
    "CH_Stadler_FLIRT_TPF": (122_000, 200, 2600, 2.37888 + 0.01698165 * 72 + 0.00093264 * 72**2, BrakePolicy.BLENDED),
    "CN_Beijing_Subway": (278_000, 310, 3100, 3.9476 + 0.0022294 * 72**2, BrakePolicy.ELECTRIC),
    "NL_Intercity_VIRM6": (391_000, 213.9, 2157, 5.854 + 0.0206 * 72 + 0.001 * 72**2, BrakePolicy.BLENDED),
    "CH_Stadler_KISS_SBB": (297_000, None, None, None, BrakePolicy.BLENDED),
}
LIBRARY_IS_HERE = SHARED.is_dir()


def test_every_file_of_the_library_is_in_these_tests(shared: Path) -> None:
    """Without the library its tracks and trains are tested by this file's own and by those of tests/data alone."""
    assert {p.stem for p in (shared / "ttobench" / "tracks").glob("*.json")} == set(TRACKS)
    assert {p.stem for p in (shared / "ttobench" / "trains").glob("*.json")} == set(TRAINS)
    assert set(TRAINS) == set(TRAIN_FIGURES) - {"own"}


def same(one: Any, other: Any, where: str = "") -> None:
    """Two frozen data trees hold the same figures; where a file lies and what it calls things may differ."""
    if is_dataclass(one):
        for field in fields(one):
            if field.name not in ("source", "name", "data_source"):
                same(getattr(one, field.name), getattr(other, field.name), f"{where}.{field.name}")
    elif isinstance(one, tuple):
        assert len(one) == len(other), where
        for i, (a, b) in enumerate(zip(one, other, strict=True)):
            same(a, b, f"{where}[{i}]")
    elif isinstance(one, np.ndarray):
        assert one.tolist() == other.tolist(), where
    elif isinstance(one, Mapping):
        assert one.keys() == other.keys(), where
        for key in one:
            same(one[key], other[key], f"{where}[{key}]")
    else:
        assert one == (pytest.approx(other, rel=1e-14) if isinstance(other, float) else other), where


def test_the_figures_of_tests_data_are_those_of_the_library(shared: Path) -> None:
    """Routes and journey of tests/data and bundled trains say what the library says, to the last bit of a position."""
    carried = [track for track in TRACKS if track_path(track).suffix == ".toml"]
    assert {path.stem for path in (DATA / "routes").iterdir()} == set(carried)
    for track in carried:
        same(read_track(shared / "ttobench" / "tracks" / f"{track}.json"), load_route(str(track_path(track))), track)
    for train in TRAINS:
        same(read_train(shared / "ttobench" / "trains" / f"{train}.json"), load_vehicle(str(train_path(train))), train)
    library, route = shared / "ttobench" / "journeys", load_route(str(track_path("CH_StGallen_Wil")))
    assert [path.stem for path in library.iterdir()] == [JOURNEY]
    asked = load_journey(str(library / f"{JOURNEY}.json"), route)
    own = load_journey(str(journey_path()), route)
    same(asked, own, "journey")
    assert [point.name for point in asked.points] == [point.name for point in own.points]


def rows(units: dict[str, str], *values: list[Any]) -> dict[str, Any]:
    return {"units": units, "values": list(values)}


TRACK = {
    "metadata": {"id": "T"},
    "altitude": {"unit": "m", "value": 400},
    "stops": {"unit": "m", "values": [0, 5000]},
    "speed limits": rows({"position": "m", "velocity": "km/h"}, [0, 80], [2000, 120]),
    "gradients": rows({"position": "m", "slope": "permil"}, [0, 1], [900, -2]),
    "curvatures": rows(
        {"position": "m", "radius at start": "m", "radius at end": "m"}, [0, "infinity", "infinity"], [900, -500, -500]
    ),
    "tunnels": rows({"position": "m", "length": "m", "cross section": "m^2"}, [1000, 200, 42], [3000, 400, 24]),
}
TRAIN = {
    **benchmark.TRAIN,
    "tunnel resistance": rows({"cross section": "m^2", "coefficient": "kN/(km/h)^2"}, [24, 0.001], [40, 0.0005]),
}
FULL_TRAIN = {
    **TRAIN,
    "metadata": {"id": "own"},
    "length": {"unit": "m", "value": 75},
    "rho": {"unit": "%", "value": 8},
    "max pn braking force": {"unit": "kN", "value": 300},
    "max acceleration": {"unit": "m/s^2", "value": 1.1},
    "max deceleration": {"unit": "m/s^2", "value": 0.9},
}
"""A train with everything that the format can say."""


def written(folder: Path, data: Any) -> Path:
    """A file of our own in the format of the library."""
    path = folder / "own.json"
    path.write_text(json.dumps(data))
    return path


@pytest.mark.parametrize("name", ["own", *(TRACKS if LIBRARY_IS_HERE else [])])
def test_a_track_is_read(tmp_path: Path, name: str) -> None:
    own = {**TRACK, "metadata": {"id": "own"}}
    path = written(tmp_path, own) if name == "own" else SHARED / "ttobench" / "tracks" / f"{name}.json"
    route, data = read_track(path), json.loads(path.read_text())
    assert (route.id, route.illustrative) == (name, False)
    assert [stop.position_m for stop in route.stops] == data["stops"]["values"]
    assert route.length_m == data["stops"]["values"][-1]
    positions, limits_kmh = zip(*data["speed limits"]["values"], strict=True)
    assert route.limits_mps.start_m.tolist() == list(positions)
    assert route.limits_mps.value * 3.6 == pytest.approx(np.array(limits_kmh))
    positions, slopes = zip(*data["gradients"]["values"], strict=True)
    assert route.gradients_ratio.start_m.tolist() == list(positions)
    assert route.gradients_ratio.value * 1000 == pytest.approx(np.array(slopes))
    assert route.altitude_at_start_m == data["altitude"]["value"]
    assert len(route.tunnels) == len(data.get("tunnels", {"values": []})["values"])
    assert route.reversed().reversed().stops[0].position_m == route.stops[0].position_m


@pytest.mark.parametrize("name", ["own", *(["CH_StGallen_Wil"] if LIBRARY_IS_HERE else [])])
def test_clothoids_count_with_their_mean_curvature(tmp_path: Path, name: str) -> None:
    bends = [
        [0, "infinity", "infinity"],
        [900, "infinity", -500],
        [1000, -500, -500],
        [1500, -500, 800],
        [1700, 800, 800],
    ]
    own = {**TRACK, "curvatures": {**TRACK["curvatures"], "values": bends}}
    path = written(tmp_path, own) if name == "own" else SHARED / "ttobench" / "tracks" / f"{name}.json"
    rows = json.loads(path.read_text())["curvatures"]["values"]
    curvature = read_track(path).curvature_per_m
    expected = [abs(sum(0 if r == "infinity" else 1 / r for r in row[1:])) / 2 for row in rows]
    assert curvature.start_m.tolist() == [row[0] for row in rows]
    assert curvature.value == pytest.approx(expected)
    assert any(row[1] != row[2] for row in rows)


@pytest.mark.parametrize("name", ["own", *(TRAINS if LIBRARY_IS_HERE else [])])
def test_a_train_is_read(tmp_path: Path, name: str) -> None:
    path = written(tmp_path, FULL_TRAIN) if name == "own" else SHARED / "ttobench" / "trains" / f"{name}.json"
    train = read_train(path)
    mass_kg, force_kn, power_kw, resistance_kn, brakes = TRAIN_FIGURES[name]
    assert (train.id, train.mass_kg, train.brake_policy) == (name, mass_kg, brakes)
    assert train.default_level is Level.OWN
    if force_kn:
        assert (train.traction.max_force_n, train.traction.max_power_w) == pytest.approx(
            (force_kn * 1e3, power_kw * 1e3)
        )
        assert float(train.resistance.force_n(20.0)) == pytest.approx(resistance_kn * 1e3)


@pytest.mark.parametrize(
    ("name", "figures", "friction_n", "deceleration_mps2", "brake_efficiency", "tunnel_n_per_kmh2"),
    [
        ("own", (108_000, 75, 44.4444444), 3e5, 0.9, 0.8, (1.0, 0.5)),
        ("CH_Stadler_FLIRT_TPF", (134_200, 58.6, 44.4444444), 1.22e6, 1.1, 0.9, (1.1698, 0.5579)),
    ],
)
def test_a_train_by_hand(
    tmp_path: Path,
    name: str,
    figures: tuple[float, float, float],
    friction_n: float,
    deceleration_mps2: float,
    brake_efficiency: float,
    tunnel_n_per_kmh2: tuple[float, float],
) -> None:
    own = name == "own"
    train = read_train(written(tmp_path, FULL_TRAIN)) if own else load_vehicle(str(train_path(name)))
    assert (train.inertial_mass_kg, train.train_length_m, train.max_speed_mps) == pytest.approx(figures)
    assert train.friction_brake_force_n == pytest.approx(friction_n)
    assert (train.max_acceleration_mps2, train.max_deceleration_mps2) == (1.1, deceleration_mps2)
    assert train.losses[Level.OWN] == EfficiencyLoss(traction_ratio=1 / 0.9 - 1, brake_ratio=1 - brake_efficiency)
    assert train.tunnel_coefficient_n_per_mps2(24) == pytest.approx(tunnel_n_per_kmh2[0] * 12.96)
    assert train.tunnel_coefficient_n_per_mps2(32) == pytest.approx(0.5 * sum(tunnel_n_per_kmh2) * 12.96)


OTHER_UNITS = {
    ("kg", "mass"): ("t", 1e-3),
    ("t", "mass"): ("kg", 1e3),
    ("m", "length"): ("km", 1e-3),
    ("%", ""): ("-", 1e-2),
    ("kN", ""): ("N", 1e3),
    ("kW", ""): ("W", 1e3),
    ("km/h", ""): ("m/s", 1 / 3.6),
    ("kN/(km/h)", ""): ("N/(m/s)", 3600),
    ("kN/(km/h)^2", ""): ("N/(m/s)^2", 12_960),
}


def numbers(thing: Any) -> list[float]:
    """Every number in a dataclass, in order."""
    if is_dataclass(thing):
        return [x for f in fields(thing) for x in numbers(getattr(thing, f.name))]
    if isinstance(thing, tuple):
        return [x for item in thing for x in numbers(item)]
    return [] if isinstance(thing, str) or not isinstance(thing, int | float) else [float(thing)]


@pytest.mark.parametrize("name", ["own", *(["CH_Stadler_FLIRT_TPF"] if LIBRARY_IS_HERE else [])])
def test_the_same_train_in_other_units_is_the_same_train(tmp_path: Path, name: str) -> None:
    path = written(tmp_path, FULL_TRAIN) if name == "own" else SHARED / "ttobench" / "trains" / f"{name}.json"
    data, changed = json.loads(path.read_text()), 0
    for key, entry in data.items():
        unit, factor = OTHER_UNITS.get((entry.get("unit"), key)) or OTHER_UNITS.get((entry.get("unit"), ""), (None, 1))
        if unit:
            entry.update(unit=unit, value=entry["value"] * factor)
            changed += 1
    tunnel = data["tunnel resistance"]
    tunnel["units"]["coefficient"] = "N/(m/s)^2"
    tunnel["values"] = [[area, c * 12_960] for area, c in reversed(tunnel["values"])]
    other_path = tmp_path / "other.json"
    other_path.write_text(json.dumps(data))
    one, other = read_train(path), read_train(other_path)
    assert changed == 14
    assert numbers(other) == pytest.approx(numbers(one), rel=1e-12)
    assert len(numbers(one)) > 15
    assert numbers(other.losses[Level.OWN]) == pytest.approx(numbers(one.losses[Level.OWN]), rel=1e-12)
    assert (other.brake_policy, other.default_level) == (one.brake_policy, one.default_level)


NAN, INF = math.nan, math.inf
BAD_TRACKS: list[tuple[tuple[str | int, ...], Any, str]] = [
    (("stops",), ..., r"stops is missing: expected a table"),
    (("stops", "unit"), "mile", r"stops\.unit = 'mile': expected a unit of length, one of m, km"),
    (("stops", "values"), [0], r"stops\.values = \[0\]: expected at least two positions"),
    (("stops", "values"), [0, NAN], r"stops\.values\[1\] = nan: expected a number"),
    (("stops", "values"), [500, 100, 5000], r"stops\[1\] position = '100 m': expected more than 500 m"),
    (("stops", "values"), [0, INF], r"stops\.values\[1\] = inf: expected a finite number"),
    (("speed limits",), ..., r"speed limits is missing: expected a table"),
    (("speed limits",), [], r"speed limits = 'list': expected a table of keys"),
    (("speed limits", "units", "velocity"), "knot", r"speed limits\.units\.velocity = 'knot': expected a unit of spee"),
    (("speed limits", "values"), ..., r"speed limits\.values is missing: expected a list of rows"),
    (("speed limits", "values"), [], r"speed limits\.values = \[\]: expected a list of rows"),
    (("speed limits", "values", 1), [2000], r"speed limits\.values\[1\] = \[2000\]: expected 2 numbers: position, vel"),
    (("speed limits", "values", 1), [2000, None], r"speed limits\.values\[1\]\.velocity = None: expected a number"),
    (
        ("speed limits", "values", 1),
        [2000, "infinity"],
        r"speed limits\.values\[1\]\.velocity = inf: expected a finite number",
    ),
    (("speed limits", "values", 1), [2000, 0], r"speed limits\[1\] \(km/h\) = 0\.0: expected a speed > 0"),
    (("gradients", "values", 1), [-1, 0], r"gradients\[1\] position = '-1 m': expected more than 0 m"),
    (("curvatures", "values", 1), [9, 59, 500], r"curves\[1\] radius = 59\.0: expected a radius of at least 60 m"),
    (("curvatures", "values", 1), [9, 500, 0], r"curves\[1\] radius = 0\.0: expected a radius of at least 60 m"),
    (("altitude", "value"), INF, r"altitude.* = inf: expected a finite number"),
    (("metadata", "id"), 7, r"metadata\.id = 7: expected a string"),
    (("tunnels", "values", 1), [3000, 400, 0], r"tunnels.*\[1\].*: expected"),
    (("tunnels", "values", 1), [3000, "infinity", 42], r"tunnels.*\[1\].* = .*inf"),
]
BAD_TRAINS: list[tuple[tuple[str | int, ...], Any, str]] = [
    (("mass",), ..., r"mass is missing: expected \{\"unit\": …, \"value\": …\}"),
    (("mass",), 100, r"mass = 'int': expected a table of keys"),
    (("mass", "unit"), "lb", r"mass\.unit = 'lb': expected a unit of mass, one of kg, t"),
    (("mass", "unit"), ["t"], r"mass\.unit = \['t'\]: expected a unit of mass"),
    (("mass", "value"), ..., r"mass\.value is missing: expected a number"),
    (("rolling resistance r1", "unit"), "kN", r"rolling resistance r1\.unit = 'kN': expected a unit of resistance 1"),
    (("rolling resistance r2", "value"), -1, r"resistance.* = -129.*: expected a finite number >= 0"),
    (("efficiency traction", "value"), 0, r"efficiency traction = 0: expected more than 0 and at most 100 %"),
    (("efficiency traction", "value"), 101, r"efficiency traction = 101: expected more than 0 and at most 100 %"),
    (("efficiency reg brake", "value"), -5, r"efficiency reg brake = -5: expected more than 0 and at most 100 %"),
    (("efficiency reg brake",), ..., r"efficiency reg brake is missing"),
    (("tunnel resistance", "values", 0), [24, -1], r"tunnel resistance.*\[0\].*: expected"),
    (("tunnel resistance", "values", 0), [24, "infinity"], r"tunnel resistance.*\[0\].*: expected"),
    (("tunnel resistance", "values", 0), [40, 0.001], r"tunnel resistance.*: expected"),
]
CASES = [(read_track, TRACK, *case) for case in BAD_TRACKS] + [(read_train, TRAIN, *case) for case in BAD_TRAINS]


@pytest.mark.parametrize(
    ("read", "data", "keys", "value", "expected"),
    CASES,
    ids=[f"{'.'.join(map(str, case[2]))}={case[3]}"[:60] for case in CASES],
)
def test_a_bad_file_is_refused_in_one_line(
    tmp_path: Path, read: Read, data: Any, keys: Any, value: Any, expected: str
) -> None:
    data = copy.deepcopy(data)
    place = data
    for key in keys[:-1]:
        place = place[key]
    if value is ...:
        del place[keys[-1]]
    else:
        place[keys[-1]] = value
    path = tmp_path / "bad.json"
    path.write_text(json.dumps(data))
    refused(read, path, expected)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", r"not valid JSON \(Expecting value"),
        (b'{"mass": ', r"not valid JSON \("),
        (b"[1, 2]", r"the file = 'list': expected a table of keys"),
        (b'{"mass": "\xff"}', r"not a UTF-8 text file \(invalid start byte at byte 10\)"),
        (b"[" * 100_000, r"not valid JSON \("),
        (b'{"mass": ' + b"1" * 5000 + b"}", r"not valid JSON \("),
    ],
    ids=["empty", "cut", "list", "not UTF-8", "deep", "endless integer"],
)
def test_what_is_not_a_json_object_is_refused(tmp_path: Path, content: bytes, expected: str) -> None:
    path = tmp_path / "bad.json"
    path.write_bytes(content)
    refused(read_train, path, expected)


def test_the_files_that_are_spoilt_here_are_good(tmp_path: Path) -> None:
    for data, read in ((TRACK, read_track), (TRAIN, read_train)):
        path = tmp_path / "good.json"
        path.write_text(json.dumps(data))
        read(path)
    train = read_train(path)
    assert isinstance(train, Vehicle)
    figures = train.rotating_mass_ratio, train.train_length_m, train.friction_brake_force_n
    assert (train.id, *figures) == ("good", 0, 0, 0)
