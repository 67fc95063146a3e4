"""The wind and the rail that a scenario states reach the simulated train, where it states them and nowhere else."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from das.domain.units import KMH
from sim.plant.kernels import PlantState
from sim.plant.plant import Plant
from sim.world.scenario import read_scenario
from sim.world.service import make_day, prepare_service

ADHESIVE = "[truth]\nadhesive_mass_t = 84\n"
PATCHES = """
[[disturbances]]
kind = "slippery-rail"
from_km = 0
to_km = 2
adhesion_percent = 40

[[disturbances]]
kind = "head-wind"
from_km = 3
to_km = 5
wind_kmh = 54
"""


def plant_of(path: Path) -> Plant:
    return make_day(prepare_service(read_scenario(path)), 0).plant


def weather(plant: Plant, s_m: float) -> tuple[float, float]:
    """State of the rail and head wind (m/s) for a train with its head at a position."""
    return plant.weather(PlantState(time_s=0.0, s_m=s_m, speed_mps=0.0))


def test_slippery_rail_and_head_wind_are_on_their_stretches(flat: Callable[..., Path]) -> None:
    plant = plant_of(flat(ADHESIVE + PATCHES))
    length_m = plant.vehicle.train_length_m
    assert weather(plant, 0.0) == (pytest.approx(0.4), 0.0)  # Under the whole train at the first stop.
    assert weather(plant, 1_999.0) == (pytest.approx(0.4), 0.0)
    assert weather(plant, 2_000.0 + 0.5 * length_m) == (pytest.approx(0.7), 0.0)
    assert weather(plant, 2_001.0 + length_m) == (1.0, 0.0)
    assert weather(plant, 4_500.0) == (1.0, pytest.approx(54 * KMH))
    assert weather(plant, 5_500.0 + length_m) == (1.0, 0.0)


def test_wind_and_rail_of_the_whole_day_are_everywhere(flat: Callable[..., Path]) -> None:
    plant = plant_of(flat(ADHESIVE + "adhesion_percent = 80\nhead_wind_kmh = 18\n"))
    for s_m in (0.0, 3_000.0, 6_000.0):
        assert weather(plant, s_m) == (pytest.approx(0.8), pytest.approx(18 * KMH))
    assert weather(plant_of(flat(ADHESIVE)), 3_000.0) == (1.0, 0.0)
