"""Trains from files of other programs and from tables: their figures by hand, and bad files with their messages."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.domain.errors import DasError
from das.domain.files.load import load_route, load_vehicle
from das.domain.levels import Level
from das.domain.losses import EfficiencyLoss
from das.domain.units import KMH
from das.solver.section import SectionOptions, build_section
from precompute.vehicle_import import Imported, import_train
from precompute.vehicle_import.tables import Figures
from tests.support.making import REPOSITORY

DATA = REPOSITORY / "tests" / "data" / "railtoolkit"
BR642 = DATA / "br642.yaml"
FIGURES = Figures(
    mass="440 t", length="200 m", max_speed="160 km/h", davis="2.4 kN, 0.02 kN/(km/h), 0.0005 kN/(km/h)^2"
)
CSV = "v [km/h];F [kN];brake [kN]\n0;200,0;50\n50;200;150\n160;62,5;62,5\n"


def stock(**changes: Any) -> dict[str, Any]:
    """A rolling stock as OSRD has them, with figures of our own: an engine, and two curves under a wire."""
    return {
        "railjson_version": "3.4",
        "name": "own stock",
        "effort_curves": {
            "default_mode": "25000V",
            "modes": {
                "thermal": {
                    "is_electric": False,
                    "curves": [],
                    "default_curve": {"speeds": [0, 10, 30], "max_efforts": [100e3, 80e3, 30e3]},
                },
                "25000V": {
                    "is_electric": True,
                    "curves": [
                        {
                            "cond": {
                                "comfort": "HEATING",
                                "electrical_profile_level": "22500V",
                                "power_restriction_code": None,
                            },
                            "curve": {"speeds": [0, 20, 40], "max_efforts": [180e3, 90e3, 45e3]},
                        }
                    ],
                    "default_curve": {"speeds": [0, 20, 40], "max_efforts": [200e3, 100e3, 50e3]},
                },
            },
        },
        "length": 150.0,
        "max_speed": 40.0,
        "mass": 200e3,
        "inertia_coefficient": 1.05,
        "gamma": {"type": "CONST", "value": -0.6},
        "comfort_acceleration": 0.3,
        "rolling_resistance": {"type": "davis", "A": 3000, "B": 60, "C": 8},
        **changes,
    }


def imported(folder: Path, content: object, name: str = "own.json", losses: str = "0.85", **options: Any) -> Imported:
    path = folder / name
    path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return import_train(path, losses, **options)


def read_again(folder: Path, found: Imported) -> None:
    """The text is a vehicle file, and says the same when it is read from the disk."""
    path = folder / "train.toml"
    path.write_text(found.text, encoding="utf-8")
    train = load_vehicle(path)
    speeds = np.linspace(0.0, train.max_speed_mps, 50)
    assert train.traction_effort_n(speeds) == pytest.approx(found.vehicle.traction_effort_n(speeds))
    assert train.mass_kg == found.vehicle.mass_kg


def test_rolling_stock_of_osrd_has_its_figures_and_modes(tmp_path: Path) -> None:
    found = imported(tmp_path, stock())
    train = found.vehicle
    assert (train.id, train.mass_kg, train.train_length_m, train.max_speed_mps) == ("own-stock", 200e3, 150.0, 40.0)
    assert train.rotating_mass_ratio == pytest.approx(0.05)
    assert train.resistance.force_n(20.0) == pytest.approx(3000 + 60 * 20 + 8 * 400)
    assert train.max_deceleration_mps2 == train.service_brake.deceleration_mps2 == 0.6
    assert list(train.modes) == ["25000V", "thermal", "25000V-heating-22500V"]
    assert (train.mode, train.modes["25000V"].voltage_v) == ("25000V", 25_000.0)
    assert train.modes["25000V-heating-22500V"].voltage_v == 22_500.0
    # Linear between points; beyond the last one, at 30 m/s, constant, as OSRD has it.
    assert train.traction_effort_n([10.0, 30.0]) == pytest.approx([150e3, 75e3])
    assert train.in_mode("thermal").traction_effort_n([5.0, 35.0]) == pytest.approx([90e3, 30e3])
    assert any("beyond 108 km/h" in note for note in found.notes)
    assert any("comfort_acceleration = 0.3" in note for note in found.notes)
    assert train.electric_brake.max_force_n == 0
    read_again(tmp_path, found)


def test_an_electric_brake_is_given_as_a_share_of_the_traction(tmp_path: Path) -> None:
    train = imported(tmp_path, stock(), electric_brake=0.5).vehicle
    assert train.electric_brake_effort_n([0.0, 10.0]) == pytest.approx([100e3, 75e3])


def test_newer_stock_has_const_gamma(tmp_path: Path) -> None:
    newer = {key: value for key, value in stock(const_gamma=0.7).items() if key != "gamma"}
    assert imported(tmp_path, newer).vehicle.max_deceleration_mps2 == 0.7


def test_a_mode_without_force_is_left_out(tmp_path: Path) -> None:
    curves = stock()["effort_curves"]
    curves["modes"]["thermal"]["default_curve"] = {"speeds": [0], "max_efforts": [0]}
    found = imported(tmp_path, stock(effort_curves=curves))
    assert "thermal" not in found.vehicle.modes
    assert any("thermal is left out" in note for note in found.notes)


def test_losses_are_those_that_the_user_names(tmp_path: Path) -> None:
    """Lossless, a mean efficiency, or efficiency and scaled idle power of another train."""
    assert imported(tmp_path, stock(), losses="lossless").vehicle.default_level is Level.L0_REG
    mean = imported(tmp_path, stock(), losses="0.8").vehicle.loss_model(Level.L1)
    assert mean == EfficiencyLoss.symmetric(0.8)
    found, model = imported(tmp_path, stock(), losses="re460-ic"), load_vehicle("re460-ic")
    theirs, ours = model.loss_model(Level.L2), found.vehicle.loss_model(Level.OWN)
    assert isinstance(theirs, EfficiencyLoss)
    assert isinstance(ours, EfficiencyLoss)
    assert ours.traction_ratio == pytest.approx(theirs.traction_ratio, rel=1e-5)
    # 2250 kW at 30 m/s and 75 kN, 6100 kW of the Re 460.
    assert ours.idle_w == pytest.approx(theirs.idle_w * 2250 / 6100, rel=1e-5)
    assert any("re460-ic" in note for note in found.notes)
    assert "re460-ic" in found.text.partition("schema_version")[0]


def test_the_train_of_railtoolkit_has_its_resistance_by_the_formula_of_its_source() -> None:
    """m_d·g·f0 + m_c·g·f1 + m·g·f2·((v + 15 km/h)/100 km/h)², by hand at 60 km/h; a load adds only mass."""
    train = import_train(BR642, "0.3").vehicle
    weight_n = 68_000 * 9.80665
    by_hand = 9.80665 * (45_333 * 3.0e-3 + 22_667 * 1.4e-3) + weight_n * 3.9e-3 * 0.75**2
    assert train.resistance.force_n(60 * KMH) == pytest.approx(by_hand, rel=1e-6)
    assert (train.mass_kg, train.loaded("empty").mass_kg) == (88_000.0, 68_000.0)
    assert train.loaded("empty").resistance.c0_n == pytest.approx(train.resistance.c0_n)
    assert train.traction_effort_n(np.array([50.5, 110.5]) * KMH) == pytest.approx([31_905.0, 14_385.0])


def test_the_least_running_time_from_goerlitz_to_dresden_is_that_of_trainruns() -> None:
    """TrainRuns.jl gives 3437.5 s for this train, as a point, with its effort table on 101.8 km."""
    line = load_route(DATA / "goerlitz-dresden.toml")
    section = build_section(line, import_train(BR642, "0.3").vehicle, options=SectionOptions(point_mass=True))
    assert section.fastest_run.time_to_go_s[0] == pytest.approx(3437.5286, rel=2e-3)


def test_a_train_of_several_vehicles_adds_them_up(tmp_path: Path) -> None:
    """A locomotive (80 t) and two coaches (40 t each, 10 t of load): mass, length, resistance and top speed by hand."""
    text = """schema: https://railtoolkit.org/schema/rolling-stock.json
schema_version: "2022.05"
trains: [{name: Two coaches, id: T1, formation: [loco, coach, coach]}, {name: Loco, id: T2, formation: [loco]}]
vehicles:
  - {name: L, id: loco, vehicle_type: traction unit, length: 18, mass: 80, speed_limit: 140, rotation_mass: 1.2,
     base_resistance: 3, air_resistance: 6, tractive_effort: [[0, 200000], [50, 200000], [140, 80000]]}
  - {name: C, id: coach, vehicle_type: passenger, length: 26, mass: 40, load_limit: 10, speed_limit: 120,
     rotation_mass: 1.05, base_resistance: 1.5, rolling_resistance: 0.5, air_resistance: 2}
"""
    train = imported(tmp_path, text, "two.yaml").vehicle
    assert (train.mass_kg, train.train_length_m) == (180_000.0, 70.0)
    assert train.max_speed_mps == pytest.approx(120 * KMH)
    assert train.rotating_mass_ratio == pytest.approx((80 * 0.2 + 80 * 0.05) / 160)
    g, air = 9.80665, 1.15**2
    coaches_n = 100_000 * g * (1.5e-3 + 0.5e-3 + 2e-3 * air)
    assert train.resistance.force_n(100 * KMH) == pytest.approx(80_000 * g * (3e-3 + 6e-3 * air) + coaches_n, rel=1e-6)
    assert imported(tmp_path, text, "two.yaml", train_id="T2").vehicle.mass_kg == 80_000.0
    with pytest.raises(DasError, match="no train 'T3'; it has T1, T2"):
        imported(tmp_path, text, "two.yaml", train_id="T3")


def test_a_csv_table_and_figures_with_units_make_a_train(tmp_path: Path) -> None:
    found = imported(tmp_path, CSV, "own.csv", figures=FIGURES)
    train = found.vehicle
    assert (train.mass_kg, train.train_length_m) == (440e3, 200.0)
    assert train.traction_effort_n(np.array([25.0, 105.0]) * KMH) == pytest.approx([200e3, 131.25e3])
    assert train.electric_brake_effort_n(25.0 * KMH) == pytest.approx(100e3)
    assert train.resistance.force_n(100 * KMH) == pytest.approx(2400 + 2000 + 5000)
    assert any("rotating mass is 6 %" in note for note in found.notes)
    read_again(tmp_path, found)


@pytest.mark.parametrize(
    ("header", "units"),
    [
        ("speed_kmh,force_kn", None),
        ("V (km/h)\tF (kN)", None),
        ("Geschwindigkeit in km/h;Zugkraft in kN", None),
        ("v,F", "km/h,kN"),
        ("SPEED (KM/H),EFFORT (KN)", None),
        ("", "km/h,kN"),
        ("speed km/h,effort kN", None),
    ],
)
def test_the_units_of_a_table_come_from_its_header_or_an_option(header: str, units: str | None, tmp_path: Path) -> None:
    separator = next((one for one in ";\t" if one in header), ",")
    rows = "".join(f"{v}{separator}{f}\n" for v, f in ((0, 200), (50, 200), (160, 60)))
    figures = Figures(**{**vars(FIGURES), "units": units})
    train = imported(tmp_path, f"{header}\n{rows}" if header else rows, "own.csv", figures=figures).vehicle
    assert train.traction_effort_n(105 * KMH) == pytest.approx(130e3)


def test_columns_of_a_table_are_modes(tmp_path: Path) -> None:
    table = "speed_kmh,25kV_kn,15kV_kn\n0,200,150\n160,60,50\n"
    train = imported(tmp_path, table, "own.csv", figures=FIGURES).vehicle
    assert (list(train.modes), train.mode) == (["25kV", "15kV"], "25kV")


@pytest.mark.parametrize(
    ("text", "newtons"),
    [("2.4 kN", 2400.0), ("240 daN", 2400.0), ("20 N/t", 8800.0), ("2 ‰", 0.002 * 440e3 * 9.81), ("0.02 N/kg", 8800.0)],
)
def test_a_resistance_has_any_usual_unit(text: str, newtons: float, tmp_path: Path) -> None:
    figures = Figures(**{**vars(FIGURES), "davis": f"{text}, 72 N·s/m, 6.48 N/(m/s)²"})
    train = imported(tmp_path, CSV, "own.csv", figures=figures).vehicle
    assert train.resistance.c0_n == pytest.approx(newtons)
    assert (train.resistance.c1_n_per_mps, train.resistance.c2_n_per_mps2) == pytest.approx((72.0, 6.48))


def of_figures(**changes: str | None) -> Figures:
    return Figures(**{**vars(FIGURES), **changes})


BAD_FIGURES: list[tuple[dict[str, str | None], str]] = [
    ({"mass": "440"}, "mass = '440': expected a number with its unit, like 440 t"),
    ({"mass": "440 kN"}, "mass = '440 kN': expected a number with its unit"),
    ({"mass": f"440{' ' * 300_000}t"}, "expected a number with its unit"),
    ({"mass": None}, "option --mass is missing: expected a figure with its unit, like 440 t"),
    ({"davis": None}, "option --davis is missing: expected three coefficients"),
    (
        {"davis": "2.4 kN, 0.02 kN, 1 N/(km/h)^2"},
        r"davis\[1\] = ' 0.02 kN': expected a number with its unit \(N/\(km/h\)",
    ),
    ({"units": "kN,km/h"}, "--units kN,km/h: expected the units of speed and force"),
]
BAD_CSV = [
    (CSV.replace("[km/h]", ""), "header of column 1 = 'v': expected a speed"),
    (CSV.replace("[kN]", "[kW]", 1), r"column 2 = 'F \[kW\]': expected a force"),
    ("0,200\n160,60\n", "no header, so that the units are not known; say --units"),
    (CSV.replace("brake", "F"), "header = 'v,F,F': expected a different name for each column"),
    (CSV.replace("50;200", "50;fast"), "line 3 = '50,fast,150': expected 3 numbers"),
    (CSV.replace("160;", "40;"), "rising speeds"),
]
BAD_STOCK: list[tuple[dict[str, Any], dict[str, Any], str]] = [
    ({}, {"losses": "diesel"}, "--losses diesel: expected lossless, a mean efficiency like 0.85, or the"),
    ({}, {"losses": "1.2"}, "--losses 1.2: expected a mean efficiency above 0 and at most 1"),
    ({}, {"figures": FIGURES}, "--mass: only a table needs it, o.json gives its own"),
    (
        {"effort_curves": {**stock()["effort_curves"], "default_mode": "3000V"}},
        {},
        r"effort_curves\.default_mode = '3000V': expected one of the modes thermal, 25000V",
    ),
    ({"gamma": 3}, {}, r"gamma = 'int': expected a table of keys"),
    ({"rolling_resistance": {"A": 1, "B": 2}}, {}, r"rolling_resistance\.C is missing: expected a number"),
    ({"inertia_coefficient": 0.05}, {}, "inertia_coefficient = 0.05: expected a number from 1 to 10"),
    ({"mass": 200}, {}, r"mass \(t\) = 0.2: expected 1 to 20000 t; to accept it, use --accept mass"),
]
LONG = BR642.read_text("utf-8").replace("mass: 68.0", f"mass: 0x{'f' * 9000}")
BAD_FILES: list[tuple[str, object, str]] = [
    ("o.json", {"stops": []}, "neither rolling stock of OSRD or railtoolkit nor a table of efforts"),
    ("o.json", "{", "not valid JSON"),
    ("o.yaml", "a: [", "not valid YAML"),
    ("o.yaml", "a: &x [1]\nb: *x\n", r"the reference \*x in the YAML, expected plain data"),
    ("o.yaml", "a: " + "[" * 60 + "]" * 60, "more than 100000 values or 30 tables within tables"),
    ("o.yaml", "- 1\n", "the file = 'list': expected a table of keys"),
    ("o.yaml", LONG, "of 36000 bits"),
    ("o.yaml", "mass: 440 t\n", "no rolling stock; expected a table of efforts as CSV"),
    (
        "o.yaml",
        "schema: https://railtoolkit.org/schema/running-path.json\n",
        "is a running path of railtoolkit, expected a train",
    ),
    ("o.xml", "<a/>", r"expected rolling stock \(\.json, \.yaml\) or a table \(\.csv\)"),
]
BAD: list[tuple[str, object, dict[str, Any], str]] = [
    *(("o.csv", CSV, {"figures": of_figures(**changes)}, message) for changes, message in BAD_FIGURES),
    *(("o.csv", text, {"figures": FIGURES}, message) for text, message in BAD_CSV),
    *(("o.json", stock(**changes), options, message) for changes, options, message in BAD_STOCK),
    *((file, content, {}, message) for file, content, message in BAD_FILES),
]


@pytest.mark.parametrize(("file", "content", "options", "message"), BAD, ids=[message for *_, message in BAD])
def test_a_bad_file_is_refused_in_one_line(
    file: str, content: object, options: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with pytest.raises(DasError, match=message) as caught:
        imported(tmp_path, content, file, **options)
    assert "\n" not in str(caught.value)


def test_an_implausible_value_is_accepted_by_name(tmp_path: Path) -> None:
    train = imported(tmp_path, stock(max_speed=170.0), accepted=["max_speed", "resistance_per_weight"]).vehicle
    assert train.max_speed_mps == pytest.approx(170.0)
