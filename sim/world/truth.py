"""What is true on the day without the plan knowing it: another train or load, other losses, another resistance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from das.domain.conditions import Conditions
from das.domain.errors import DasError
from das.domain.files.load import load_vehicle
from das.domain.files.loss_map_csv import read_loss_map
from das.domain.files.reading import Fields
from das.domain.losses import Level
from das.domain.vehicle import Vehicle
from sim.world.drawn import Drawn, key_of, read_quantity

STREAM = 5
"""Number of the stream of random numbers, among those of a seed, from which the conditions are drawn."""
RATIOS = ("mass", "resistance", "receptivity", "adhesion")


@dataclass(frozen=True, kw_only=True)
class Truth:
    """How the true train differs from the plan's; None means as planned.

    `conditions` multiply the true train's figures, by the names of `Conditions`; every seed draws its own.
    `adhesive_mass_kg` is the mass on driven axles where the file gives none. `loss_map` is the file of its losses (L3).
    """

    conditions: Mapping[str, Drawn]
    adhesive_mass_kg: float | None = None
    vehicle: str | None = None
    load: str | None = None
    level: Level | None = None
    loss_map: Path | None = None

    @property
    def changes_adhesion(self) -> bool:
        """Whether the rail differs from a dry one on any day."""
        adhesion = self.conditions["adhesion_ratio"]
        return (adhesion.low, adhesion.high) != (1.0, 1.0)

    @property
    def is_as_planned(self) -> bool:
        """Whether train, load and losses are those of the plan; the conditions of a day may differ all the same."""
        others = (self.adhesive_mass_kg, self.vehicle, self.load, self.level, self.loss_map)
        return all(one is None for one in others)

    def draw(self, seed: int) -> Conditions:
        """Draw the conditions of a seed's day."""
        random = np.random.default_rng([seed, STREAM])
        return Conditions(**{name: drawn.draw(random) for name, drawn in self.conditions.items()})

    def train(self, planned: Vehicle, planned_level: Level) -> tuple[Vehicle, Level]:
        """The true train and the level of its losses; raises DasError for files that cannot be used."""
        vehicle = planned if self.vehicle is None else load_vehicle(self.vehicle)
        vehicle = vehicle if self.load is None else vehicle.loaded(self.load)
        level = planned_level if self.level is None else self.level
        if self.loss_map is not None:
            vehicle, level = vehicle.with_loss_map(read_loss_map(self.loss_map)), Level.L3
        if self.adhesive_mass_kg is not None:
            vehicle = replace(vehicle, adhesive_mass_kg=self.adhesive_mass_kg)
        vehicle.loss_model(level)
        return vehicle, level


def read_truth(table: Fields) -> Truth:
    """Read the table `[truth]` of a scenario; raises DasError or InputError for anything unusable."""
    others = {"head_wind": "speed", "adhesive_mass": "mass"}
    quantities = table.quantity_keys({**dict.fromkeys(RATIOS, "ratio"), **others})
    table.check_keys([*quantities, "vehicle", "load", "level", "loss_map"])
    folder = table.source.parent
    return Truth(
        conditions=_conditions(table),
        adhesive_mass_kg=_adhesive_mass(table),
        vehicle=beside(folder, table.text("vehicle")) if table.has("vehicle") else None,
        load=table.text("load") if table.has("load") else None,
        level=_level(table),
        loss_map=folder / table.text("loss_map") if table.has("loss_map") else None,
    )


def beside(folder: Path, name: str) -> str:
    """The name of a bundled file as it is, or the path of a file, which is taken from the scenario's folder."""
    return str(folder / name) if Path(name).suffix else name


def _conditions(table: Fields) -> dict[str, Drawn]:
    given = {f"{name}_ratio": read_quantity(table, name, "ratio", 1.0) for name in RATIOS}
    given["head_wind_mps"] = read_quantity(table, "head_wind", "speed", 0.0)
    for end in ("low", "high"):
        try:
            Conditions(**{name: getattr(drawn, end) for name, drawn in given.items()})
        except DasError as error:
            raise DasError(f"{table.source}: {str(error).replace('conditions: ', 'truth.', 1)}") from None
    return given


def _adhesive_mass(table: Fields) -> float | None:
    key = key_of(table, "adhesive_mass", "mass")
    if not table.has(key):
        return None
    mass_kg = table.quantity("adhesive_mass", "mass")
    if not 0 < mass_kg < np.inf:
        raise table.error(key, table.data[key], "a finite mass > 0")
    return mass_kg


def _level(table: Fields) -> Level | None:
    if not table.has("level"):
        return None
    name = table.text("level")
    if name not in list(Level):
        raise table.error("level", name, "one of " + ", ".join(Level))
    if table.has("loss_map") and name != Level.L3:
        raise table.error("level", name, f"{Level.L3}, the level of a loss map")
    return Level(name)
