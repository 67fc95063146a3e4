"""Units against hand figures; every unit a file may name is in the table."""

from __future__ import annotations

from typing import Any

import pytest

from das.domain.units import FACTORS, kmh, kwh, kwh_figure, kwh_words, to_si

HAND_FIGURES = {
    "length": {"m": (12.5, 12.5), "km": (1.5, 1500.0)},
    "area": {"m^2 m2": (42.0, 42.0)},
    "speed": {"m/s mps": (25.0, 25.0), "km/h kmh": (90.0, 25.0), "mph": (100.0, 44.704)},
    "acceleration": {"m/s^2 mps2": (1.1, 1.1)},
    "time": {"s": (90.0, 90.0), "min": (2.5, 150.0), "ms": (250.0, 0.25)},
    "mass": {"kg": (84.0, 84.0), "t": (84.0, 84_000.0)},
    "force": {"N n": (300.0, 300.0), "kN kn": (213.9, 213_900.0), "daN dan": (450.0, 4_500.0)},
    "power": {"W w": (5.0, 5.0), "kW kw": (6100.0, 6.1e6), "MW": (6.1, 6.1e6)},
    "voltage": {"V v": (1500.0, 1500.0), "kV kv": (25.0, 25_000.0)},
    "ratio": {"- ratio": (0.06, 0.06), "% percent": (6.0, 0.06)},
    "gradient": {"permil permille ‰": (12.5, 0.0125), "% percent": (1.25, 0.0125), "ratio -": (0.0125, 0.0125)},
    "resistance_1": {
        "N/(m/s) n_per_mps": (38.8, 38.8),
        "kN/(m/s) kn_per_mps": (0.0388, 38.8),
        "kN/(km/h) kn_per_kmh": (0.01, 36.0),
        "N/(km/h) n_per_kmh": (10.0, 36.0),
    },
    "resistance_2": {
        "N/(m/s)^2 n_per_mps2": (8.6, 8.6),
        "kN/(m/s)^2 kn_per_mps2": (0.0086, 8.6),
        "kN/(km/h)^2 kn_per_kmh2": (0.001, 12.96),
        "N/(km/h)^2 n_per_kmh2": (1.0, 12.96),
    },
    "frequency": {"Hz hz": (50.0, 50.0)},
    "frequency_per_speed": {"hz_per_mps": (2.5, 2.5), "hz_per_kmh": (0.5, 1.8)},
    "angle": {"deg": (47.0, 47.0)},
}
"""A value in each unit of a dimension, and in SI."""


def test_every_unit_is_converted() -> None:
    for dimension, factors in FACTORS.items():
        figures = {unit: pair for units, pair in HAND_FIGURES[dimension].items() for unit in units.split()}
        assert figures.keys() == factors.keys()
        for unit, (value, si) in figures.items():
            assert to_si(value, unit, dimension) == pytest.approx(si, rel=1e-12), unit
    assert HAND_FIGURES.keys() == FACTORS.keys()


@pytest.mark.parametrize(("dimension", "unit"), [("length", "mile"), ("speed", "m"), ("force", ""), ("weight", "kg")])
def test_an_unknown_unit_is_refused(dimension: str, unit: str) -> None:
    with pytest.raises(KeyError):
        to_si(1.0, unit, dimension)


def test_outputs_go_back_to_customary_units() -> None:
    assert kmh(25.0) == pytest.approx(90.0)
    assert kwh(7.2e6) == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("energy_kwh", "rounding", "printed"),
    [(12.34, {}, "12.3"), (12.34, {"signed": True}, "+12.3"), (-0.04, {"signed": True}, "+0.0"), (-0.04, {}, "0.0"),
     (0.012, {"finer": 1}, "0.01"), (29.6, {"finer": -1}, "30")],
)  # fmt: skip
def test_an_energy_is_rounded_in_one_way(energy_kwh: float, rounding: Any, printed: str) -> None:
    assert kwh_figure(energy_kwh * 3.6e6, **rounding) == printed
    assert kwh_words(energy_kwh * 3.6e6, **rounding) == f"{printed} kWh"
