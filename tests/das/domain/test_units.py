"""Units against hand figures; every unit a file may name is in the table."""

from __future__ import annotations

import pytest

from das.domain.units import FACTORS, kmh, kwh, to_si

HAND_FIGURES = [
    ("length", 12.5, 12.5, "m"),
    ("length", 1.5, 1500.0, "km"),
    ("area", 42.0, 42.0, "m^2 m2"),
    ("speed", 25.0, 25.0, "m/s mps"),
    ("speed", 90.0, 25.0, "km/h kmh"),
    ("speed", 100.0, 44.704, "mph"),
    ("acceleration", 1.1, 1.1, "m/s^2 mps2"),
    ("time", 90.0, 90.0, "s"),
    ("time", 2.5, 150.0, "min"),
    ("time", 250.0, 0.25, "ms"),
    ("mass", 84.0, 84.0, "kg"),
    ("mass", 84.0, 84_000.0, "t"),
    ("force", 300.0, 300.0, "N n"),
    ("force", 213.9, 213_900.0, "kN kn"),
    ("force", 450.0, 4_500.0, "daN dan"),
    ("power", 5.0, 5.0, "W w"),
    ("power", 6100.0, 6.1e6, "kW kw"),
    ("power", 6.1, 6.1e6, "MW"),
    ("voltage", 1500.0, 1500.0, "V v"),
    ("voltage", 25.0, 25000.0, "kV kv"),
    ("ratio", 0.06, 0.06, "- ratio"),
    ("ratio", 6.0, 0.06, "% percent"),
    ("gradient", 12.5, 0.0125, "permil permille ‰"),
    ("gradient", 1.25, 0.0125, "% percent"),
    ("gradient", 0.0125, 0.0125, "ratio -"),
    ("resistance_1", 38.8, 38.8, "N/(m/s) n_per_mps"),
    ("resistance_1", 0.0388, 38.8, "kN/(m/s) kn_per_mps"),
    ("resistance_1", 0.01, 36.0, "kN/(km/h) kn_per_kmh"),
    ("resistance_1", 10.0, 36.0, "N/(km/h) n_per_kmh"),
    ("resistance_2", 8.6, 8.6, "N/(m/s)^2 n_per_mps2"),
    ("resistance_2", 0.0086, 8.6, "kN/(m/s)^2 kn_per_mps2"),
    ("resistance_2", 0.001, 12.96, "kN/(km/h)^2 kn_per_kmh2"),
    ("resistance_2", 1.0, 12.96, "N/(km/h)^2 n_per_kmh2"),
    ("frequency", 50.0, 50.0, "Hz hz"),
    ("frequency_per_speed", 2.5, 2.5, "hz_per_mps"),
    ("frequency_per_speed", 0.5, 1.8, "hz_per_kmh"),
    ("angle", 47.0, 47.0, "deg"),
]


@pytest.mark.parametrize(
    ("dimension", "value", "si", "unit"),
    [(d, x, si, unit) for d, x, si, units in HAND_FIGURES for unit in units.split()],
)
def test_a_unit_is_converted(dimension: str, value: float, si: float, unit: str) -> None:
    assert to_si(value, unit, dimension) == pytest.approx(si, rel=1e-12)


def test_the_hand_figures_cover_every_unit() -> None:
    assert {(d, unit) for d, _, _, units in HAND_FIGURES for unit in units.split()} == {
        (dimension, unit) for dimension, factors in FACTORS.items() for unit in factors
    }


@pytest.mark.parametrize(("dimension", "unit"), [("length", "mile"), ("speed", "m"), ("force", ""), ("weight", "kg")])
def test_an_unknown_unit_is_refused(dimension: str, unit: str) -> None:
    with pytest.raises(KeyError):
        to_si(1.0, unit, dimension)


def test_outputs_go_back_to_customary_units() -> None:
    assert kmh(25.0) == pytest.approx(90.0)
    assert kwh(7.2e6) == pytest.approx(2.0)
