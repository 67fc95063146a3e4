"""Trains and lines that cannot be meant are refused with a way past; unusual ones are said once."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.bus.session import endpoint, free_ports
from das.command_line.printing import COMPILING
from das.domain.errors import InputError
from das.domain.files.load import catalogue, load_route, load_vehicle
from das.domain.plausibility import (
    ACCEPTED,
    OF_ROUTES,
    OF_VEHICLES,
    ROUTE_CHECKS,
    VEHICLE_CHECKS,
    checked,
    energy_range,
    warnings_of,
)
from das.domain.route import Route
from das.domain.vehicle import Vehicle
from docs.studies.reference import as_markdown
from tests.support.making import make_train

TRAIN = catalogue("vehicles")["re460-ic"].read_text(encoding="utf-8")
LINE = catalogue("routes")["flat-6km"].read_text(encoding="utf-8")


def file_of(folder: Path, text: str, *changes: tuple[str, str], accepted: str = "") -> str:
    """A file with some of its lines changed, and the checks it accepts."""
    for before, after in changes:
        assert text.count(before) == 1, before
        text = text.replace(before, after)
    table = "[vehicle]" if "[vehicle]" in text else "[route]"
    path = folder / f"{table.strip('[]')}.toml"
    path.write_text(text.replace(table, f"{table}\n{ACCEPTED} = [{accepted}]" if accepted else table), encoding="utf-8")
    return str(path)


POWER = "max_power_kw = 6100.0\n\n"
WRONG_TRAINS = {
    "max_deceleration": (
        ("max_force_kn = 400.0", "max_force_kn = 2700.0"),
        "all brakes over mass (m/s²) = 6.818: expected at most 3 m/s²",
    ),
    "max_acceleration": (
        (f"max_force_kn = 300.0\n{POWER}[elec", f"max_force_kn = 3000.0\n{POWER}[elec"),
        "traction over mass (m/s²) = 6.818: expected at most 3 m/s²",
    ),
    "mass": (("mass_t = 440.0", "mass_t = 25e3"), "mass (t) = 25000.0: expected 1 to 20000 t"),
    "max_speed": (("_kmh = 200.0", "_kmh = 2000.0"), "max_speed (km/h) = 2000.0: expected 3.6 to 600 km/h"),
    "power_per_mass": (
        (f"{POWER}[electric", "max_power_w = 6100.0\n\n[electric"),
        "traction power over mass (kW/t) = 0.01386: expected 0.05 to 150 kW/t",
    ),
    "brake_power_per_mass": (
        (f"{POWER}[friction", "max_power_kw = 6100e3\n\n[friction"),
        "electric brake power over mass (kW/t) = 13860.0: expected at most 150 kW/t",
    ),
    "resistance_per_weight": (
        ("c2_kn_per_mps2 = 0.0086", "c2_kn_per_mps2 = 8.6"),
        "resistance at top speed over weight = 6.152: expected at most 1",
    ),
    "rotating_mass": (("_ratio = 0.0\n", "_ratio = 6.0\n"), "rotating_mass_ratio = 6.0: expected at most 0.5"),
    "length": (("length_m = 200.0", "length_m = 200e3"), "length (m) = 200000.0: expected at most 10000 m"),
}


def course(rows: str) -> tuple[str, str]:
    """The change of a line's file that gives it a geometry: position (km), latitude and longitude (deg)."""
    columns = '["position_km", "latitude_deg", "longitude_deg"]'
    return "[gradients]", f"[geometry]\ncolumns = {columns}\nrows = [{rows}]\n\n[gradients]"


WRONG_LINES = {
    "length": (("length_km = 6.0", "length_km = 6e4"), "length (km) = 60000.0: expected 0.001 to 20000 km"),
    "speed_limit": (("160.0]", "1600.0]"), "speed_limits[0] (km/h) = 1600.0: expected at most 600 km/h"),
    "gradient": (("[0.0, 0.0]", "[0.0, -500.0]"), "gradients[0] (‰) = 500.0: expected at most 200 ‰"),
    "geometry_length": (
        course("[0.0, 48.0, 8.0], [6.0, 48.027, 8.0]"),
        "geometry: length on the map over that of the positions = 0.5004: expected 0.6 to 1.3",
    ),
    "geometry_jump": (
        course("[0.0, 48.0, 8.0], [3.0, 48.0, 8.0], [6.0, 48.05396, 8.0]"),
        "geometry: map distance to the next point beyond that of the positions (m) = 3000.0: expected at most 2000 m",
    ),
    "geometry_missing": (
        course("[4.0, 48.0, 8.0], [6.0, 48.01799, 8.0]"),
        "share of the line without geometry = 0.6667: expected at most 0.5",
    ),
}


def test_every_check_has_its_limits_and_its_file() -> None:
    assert set(OF_VEHICLES) == set(WRONG_TRAINS)
    assert set(OF_ROUTES) == set(WRONG_LINES)
    for found in (*OF_VEHICLES.values(), *OF_ROUTES.values()):
        assert 0 <= found.possible[0] <= found.usual[0] < found.usual[1] < found.possible[1]


Load = Callable[[str], Vehicle | Route]
WRONG: list[tuple[Load, str, str, str]] = [
    *((load_vehicle, TRAIN, "vehicle", check) for check in WRONG_TRAINS),
    *((load_route, LINE, "route", check) for check in WRONG_LINES),
]


@pytest.mark.parametrize(("load", "text", "table", "check"), WRONG)
def test_what_cannot_be_is_refused_unless_its_file_insists(
    load: Load, text: str, table: str, check: str, tmp_path: Path
) -> None:
    change, said = (WRONG_TRAINS if table == "vehicle" else WRONG_LINES)[check]
    other = next(one for one in (VEHICLE_CHECKS if table == "vehicle" else ROUTE_CHECKS) if one != check)
    for insists in ("", f'"{other}"'):
        path = file_of(tmp_path, text, change, accepted=insists)
        with pytest.raises(InputError) as refused:
            load(path)
        assert str(refused.value) == f'{path}: {said}; to accept it, set {ACCEPTED} = ["{check}"] in [{table}]'
    warned = warnings_of(load(file_of(tmp_path, text, change, accepted=f'"{check}"')))
    assert any(line.startswith(f"{path}: {said.split(' = ')[0].split(' (')[0]} = ") for line in warned)
    assert table == "vehicle" or len(warned) == 1


@pytest.mark.parametrize("accepted", ['"brakes"', '"max_deceleration", 3', '""'])
def test_a_check_that_there_is_not_cannot_be_accepted(accepted: str, tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=rf"vehicle\.{ACCEPTED} = .*: expected a list of names from max_deceleration, "
    ):
        load_vehicle(file_of(tmp_path, TRAIN, accepted=accepted))
    path = file_of(tmp_path, TRAIN)
    Path(path).write_text(TRAIN.replace("[vehicle]", f"[vehicle]\n{ACCEPTED} = 'mass'"), encoding="utf-8")
    with pytest.raises(InputError, match=r"expected a list of names"):
        load_vehicle(path)


def test_a_deceleration_that_is_bounded_by_the_train_itself_is_possible(tmp_path: Path) -> None:
    strong = ("max_force_kn = 400.0", "max_force_kn = 2700.0")
    bounded = ("max_speed_kmh = 200.0", "max_speed_kmh = 200.0\nmax_deceleration_mps2 = 1.2")
    assert warnings_of(load_vehicle(file_of(tmp_path, TRAIN, strong, bounded))) == ()


def test_every_load_state_is_judged(tmp_path: Path) -> None:
    loads = ("[losses]\ndefault", "[loads.empty]\nmass_t = 150.0\n[losses]\ndefault")
    path = file_of(tmp_path, TRAIN, loads)
    with pytest.raises(InputError, match=r"loads\.empty: all brakes over mass \(m/s²\) = 4\.667: expected at most 3"):
        load_vehicle(path)


def test_a_foreign_file_is_to_be_corrected_or_converted(tmp_path: Path) -> None:
    def quantity(unit: str, value: float) -> dict[str, Any]:
        return {"unit": unit, "value": value}

    train = {
        "mass": quantity("t", 100.0),
        "max speed": quantity("km/h", 140.0),
        "rolling resistance r0": quantity("kN", 1.0),
        "rolling resistance r1": quantity("kN/(m/s)", 0.0),
        "rolling resistance r2": quantity("kN/(m/s)^2", 0.005),
        "max traction force": quantity("kN", 100.0),
        "max traction power": quantity("kW", 1500.0),
        "max pn braking force": quantity("kN", 680.0),
        "efficiency traction": quantity("%", 85.0),
    }
    path = tmp_path / "train.json"
    path.write_text(json.dumps(train), encoding="utf-8")
    with pytest.raises(InputError) as refused:
        load_vehicle(str(path))
    assert str(refused.value) == (
        f"{path}: all brakes over mass (m/s²) = 6.8: expected at most 3 m/s²; correct the file, or convert it to TOML "
        "(docs/reference/file-formats.md), which can accept max_deceleration"
    )
    path.write_text(json.dumps({**train, "max pn braking force": quantity("kN", 100.0)}), encoding="utf-8")
    assert warnings_of(load_vehicle(str(path))) == ()
    track = tmp_path / "track.json"
    rows = {"units": {"position": "m", "velocity": "km/h"}, "values": [[0.0, 900.0]]}
    slopes = {"units": {"position": "m", "slope": "permil"}, "values": [[0.0, 0.0]]}
    stops = {"unit": "m", "values": [0.0, 5e3]}
    track.write_text(json.dumps({"stops": stops, "speed limits": rows, "gradients": slopes}), encoding="utf-8")
    with pytest.raises(InputError, match=r"speed_limits\[0\] \(km/h\) = 900\.0: .* which can accept speed_limit$"):
        load_route(str(track))


def test_bundled_trains_and_lines_are_as_usual() -> None:
    for name in catalogue("vehicles"):
        assert warnings_of(load_vehicle(name)) == ()
    for name in catalogue("routes"):
        assert warnings_of(load_route(name)) == ()


def test_what_is_possible_but_unusual_is_a_warning(tmp_path: Path) -> None:
    light = replace(make_train(power_w=2e5), mass_kg=9_000.0, source="light", max_deceleration_mps2=1.7)
    light = replace(light, max_acceleration_mps2=1.0)
    assert checked(light, insist="{check}") is light
    lines = "\n".join(warnings_of(light))
    assert "light: mass = 9 t: 10 to 10000 t is usual" in lines
    assert "light: all brakes over mass = 1.7 m/s²: 0.3 to 1.6 m/s² is usual" in lines
    fast = load_route(file_of(tmp_path, LINE, ("160.0]", "450.0]")))
    assert warnings_of(fast) == (f"{fast.source}: speed_limits[0] = 450 km/h: 3 to 400 km/h is usual",)


@pytest.mark.nightly
def test_a_command_says_once_what_is_unusual_and_refuses_in_one_line(tmp_path: Path) -> None:
    fast = file_of(tmp_path, LINE, ("160.0]", "450.0]"))
    node = [sys.executable, "-m", "das.node", "--train", "T1", "--listen", endpoint(free_ports(1)[0])]
    warning = f"warning: {fast}: speed_limits[0] = 450 km/h: 3 to 400 km/h is usual"
    solve = [sys.executable, "-m", "precompute.cli", "solve", fast, "re460-ic", "--buffer", "10", "--json"]
    done = subprocess.run(solve, capture_output=True, text=True, timeout=120, check=True)
    assert [one for one in done.stderr.splitlines() if one != COMPILING] == [warning]
    json.loads(done.stdout)
    with subprocess.Popen(
        [*node, "--route", fast, "--vehicle", "re460-ic"], stderr=subprocess.PIPE, text=True
    ) as child:
        assert child.stderr is not None
        said = [child.stderr.readline()]
        while not said[-1].startswith("das-node"):
            said.append(child.stderr.readline())
            assert said[-1], said
        child.terminate()
    assert [one for one in said[:-1] if one != f"{COMPILING}\n"] == [f"{warning}\n"]
    wrong = file_of(tmp_path, TRAIN, WRONG_TRAINS["max_deceleration"][0])
    refused = subprocess.run(
        [*node, "--route", "flat-6km", "--vehicle", wrong], capture_output=True, text=True, timeout=60, check=False
    )
    assert refused.returncode == 2
    assert refused.stderr.splitlines() == [
        f"error: {wrong}: all brakes over mass (m/s²) = 6.818: expected at most 3 m/s²; to accept it, set "
        f'{ACCEPTED} = ["max_deceleration"] in [vehicle]'
    ]


def test_the_documentation_names_every_check() -> None:
    said = as_markdown("plausibility")
    assert all(f"| `{check}`" in said for check in (*VEHICLE_CHECKS, *ROUTE_CHECKS))


def test_the_public_benchmark_is_as_usual(shared: Path) -> None:
    trains = sorted((shared / "ttobench" / "trains").glob("*.json"))
    tracks = sorted((shared / "ttobench" / "tracks").glob("*.json"))
    assert len(trains) == 4
    assert len(tracks) > 10
    found = [*map(load_vehicle, map(str, trains)), *map(load_route, map(str, tracks))]
    assert [line for thing in found for line in warnings_of(thing)] == []


def line_with(folder: Path, *changes: tuple[str, str]) -> Route:
    return load_route(file_of(folder, LINE, *changes))


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("[0.0, 91.0, 8.0], [6.0, 91.054, 8.0]", "geometry latitude_deg[0] = 91.0: expected -90 to 90"),
        ("[0.0, 48.0, 200.0], [6.0, 48.054, 200.0]", "geometry longitude_deg[0] = 200.0: expected -180 to 180"),
        (
            "[0.0, 48.0, 8.0], [3.0, 48.027, 8.0], [6.0, 57.0, 8.0]",
            "map distance to the next point beyond that of the positions",
        ),
        (
            "[0.0, 48.0, 8.0], [3.0, 0.0, 0.0], [6.0, 48.054, 8.0]",
            "map distance to the next point beyond that of the positions",
        ),
        ("[0.0, 48.0, 8.0], [6.0, 48.027, 8.0]", "length on the map over that of the positions = 0.5"),
    ],
)
def test_a_geometry_that_is_not_of_the_line_is_refused(rows: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        line_with(tmp_path, course(rows))
    assert message in str(refused.value)


def test_a_geometry_that_begins_late_is_a_warning(tmp_path: Path) -> None:
    route = line_with(tmp_path, course("[0.6, 48.0, 8.0], [6.0, 48.04856, 8.0]"))
    (warned,) = warnings_of(route)
    assert warned.endswith("share of the line without geometry = 0.1: at most 0.02 is usual")


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ('altitudes = "level"', ""),
        ('altitudes = "none"', "no altitudes: energies are those of a flat line"),
        ("", "no altitudes: energies are those of a flat line"),
        ("illustrative = true", ""),
        ('altitudes = "points"', "altitudes of a few points"),
        ('altitudes = "raw"', "raw altitudes: noise of 4 m"),
        ('altitudes = "smoothed"', ""),
    ],
)
def test_how_wrong_energies_may_be_is_a_warning(said: str, words: str, tmp_path: Path) -> None:
    route = line_with(tmp_path, ('altitudes = "level"', said))
    warned = warnings_of(route)
    assert (len(warned) == 1 and words in warned[0]) if words else not warned
    assert (said == 'altitudes = "smoothed"') == energy_range(route).startswith("smoothed")


def test_noise_is_seen_in_a_file_that_does_not_speak_of_it(tmp_path: Path) -> None:
    """Noise of 1 m every 100 m; the same line with gentle gradients says nothing."""
    random = np.random.default_rng(5)
    for noise_m, noisy in ((1.0, True), (0.0, False)):
        at_m = np.arange(0.0, 6001.0, 100.0)
        slope = np.diff(noise_m * random.standard_normal(len(at_m)) + 5.0 * np.sin(at_m / 900.0)) / 100.0
        rows = ", ".join(f"[{x / 1000:.1f}, {1000 * y:.4f}]" for x, y in zip(at_m[:-1], slope, strict=True))
        route = line_with(tmp_path, ('altitudes = "level"\n', ""), ("rows = [[0.0, 0.0]]", f"rows = [{rows}]"))
        assert energy_range(route).startswith("raw") is noisy
