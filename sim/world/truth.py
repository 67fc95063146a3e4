"""What is true on the day and the plan does not know: another train or load, other losses, another resistance."""

from __future__ import annotations

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

RATIOS = ("mass", "resistance", "receptivity", "adhesion")


@dataclass(frozen=True, kw_only=True)
class Truth:
    """The true train against the plan's: None means as planned.

    `conditions` multiply the true train's figures; `adhesive_mass_kg` is its mass on driven axles where its file gives
    none; `loss_map` is the file of its losses (level L3).
    """

    conditions: Conditions
    adhesive_mass_kg: float | None = None
    vehicle: str | None = None
    load: str | None = None
    level: Level | None = None
    loss_map: Path | None = None

    def train(self, planned: Vehicle, planned_level: Level) -> tuple[Vehicle, Level]:
        """The true train and the level of its losses; DasError for files that cannot be used."""
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
    """The table `[truth]` of a scenario; raises DasError or InputError for anything unusable."""
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
    """A bundled name as it is; a file's path is taken from the scenario's folder."""
    return str(folder / name) if Path(name).suffix else name


def _conditions(table: Fields) -> Conditions:
    given = {f"{name}_ratio": table.quantity(name, "ratio", 1.0) for name in RATIOS}
    head_wind_mps = table.quantity("head_wind", "speed", 0.0)
    try:
        return Conditions(head_wind_mps=head_wind_mps, **given)
    except DasError as error:
        raise DasError(f"{table.source}: {str(error).replace('conditions: ', 'truth.', 1)}") from None


def _adhesive_mass(table: Fields) -> float | None:
    key = next((key for key in table.quantity_keys({"adhesive_mass": "mass"}) if table.has(key)), None)
    if key is None:
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
