"""What a seed draws from a scenario: figures in a range, the true train, and the human driver."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from das.domain.conditions import Conditions
from das.domain.errors import MISSING, DasError, InputError
from das.domain.files.load import load_vehicle
from das.domain.files.reading import Fields, number
from das.domain.files.vehicles import read_loss_map
from das.domain.levels import Level
from das.domain.units import to_si
from das.domain.vehicle import Vehicle
from sim.drivers.parameters import HumanParameters, Participant


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """A figure that each seed draws uniformly between `low` and `high`; fixed if the two are equal."""

    low: float
    high: float

    def draw(self, random: np.random.Generator) -> float:
        return float(random.uniform(self.low, self.high))


def read_range(table: Fields, key: str) -> Drawn:
    """Read a figure as it is written: `delay_s = 90` or `delay_s = {min = 30, max = 180}`.

    Raises InputError for anything else.
    """
    if not isinstance(table.data.get(key), Mapping):
        value = number(table.source, f"{table.prefix}{key}", table.data.get(key, MISSING))
        return Drawn(low=value, high=value)
    ends = table.table(key)
    ends.check_keys(["min", "max"])
    for end in ("min", "max"):
        if not ends.has(end):
            raise ends.error(end, MISSING, "a number")
    low, high = (number(table.source, f"{ends.prefix}{end}", ends.data[end]) for end in ("min", "max"))
    if not low <= high:
        raise table.error(key, table.data[key], "{min = …, max = …} in this order")
    return Drawn(low=low, high=high)


def read_quantity(table: Fields, name: str, dimension: str, default: float | None = None) -> Drawn:
    """Read a quantity, or a range of it, in SI units; the key ends in the unit that the file uses.

    Raises InputError for anything else.
    """
    key = key_of(table, name, dimension)
    if not isinstance(table.data.get(key), Mapping):
        value = table.quantity(name, dimension, default, unbounded=True)
        return Drawn(low=value, high=value)
    if more := [x for x in table.quantity_keys({name: dimension}) if x in table.data and x != key]:
        raise table.error(more[0], table.data[more[0]], f"only one of {key} and {more[0]}")
    unit, drawn = key[len(name) + 1 :], read_range(table, key)
    return Drawn(low=to_si(drawn.low, unit, dimension), high=to_si(drawn.high, unit, dimension))


def key_of(table: Fields, name: str, dimension: str) -> str:
    """The key under which the file gives a quantity; the bare name of the quantity if it does not."""
    return next((key for key in table.quantity_keys({name: dimension}) if key in table.data), name)


TRUTH_STREAM = 5
"""Number of the random stream of a seed from which the conditions are drawn."""
RATIOS = ("mass", "resistance", "receptivity", "adhesion")


@dataclass(frozen=True, kw_only=True)
class Truth:
    """How the true train differs from the planned one; None means as planned.

    `conditions` are the ranges from which each seed draws its `Conditions`, by the names of the fields.
    `adhesive_mass_kg` is the mass on driven axles; it replaces the one in the vehicle's file. `loss_map` is the file of
    the true train's losses (L3).
    """

    conditions: Mapping[str, Drawn]
    adhesive_mass_kg: float | None = None
    vehicle: str | None = None
    load: str | None = None
    level: Level | None = None
    loss_map: Path | None = None

    @property
    def changes_adhesion(self) -> bool:
        """Whether the adhesion can differ from the adhesion of a dry rail."""
        adhesion = self.conditions["adhesion_ratio"]
        return (adhesion.low, adhesion.high) != (1.0, 1.0)

    @property
    def is_as_planned(self) -> bool:
        """Whether train, load and losses are as in the plan; the conditions of a day may still differ."""
        others = (self.adhesive_mass_kg, self.vehicle, self.load, self.level, self.loss_map)
        return all(one is None for one in others)

    @property
    def of_every_day(self) -> Conditions | None:
        """The conditions of every day; None if each seed draws its own."""
        if any(drawn.low != drawn.high for drawn in self.conditions.values()):
            return None
        return Conditions(**{name: drawn.low for name, drawn in self.conditions.items()})

    def draw(self, seed: int) -> Conditions:
        """Draw the conditions of a seed's day."""
        random = np.random.default_rng([seed, TRUTH_STREAM])
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
    """The name of a bundled file unchanged, or the path of a file, resolved from the scenario's folder."""
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
    level = table.choice("level", Level)
    if table.has("loss_map") and level is not Level.L3:
        raise table.error("level", str(level), f"{Level.L3}, the level of a loss map")
    return level


HUMAN_STREAM = 4
"""Number of the random stream of a seed from which the driver is drawn."""
TRIPS = "trips"
COUNTED = ("notches",)
"""Parameters that are whole numbers."""


@dataclass(frozen=True, kw_only=True)
class HumanRange:
    """What a scenario says about human drivers: parameters by name, and `trips`, the trips already made.

    Parameters that are not given have their defaults.
    """

    given: Mapping[str, Drawn]

    def draw(self, seed: int) -> tuple[HumanParameters, dict[str, float]]:
        """The driver of a seed, and the drawn values of the given parameters."""
        random = np.random.default_rng([seed, HUMAN_STREAM])
        drawn = {name: figure.draw(random) for name, figure in self.given.items()}
        return _driver(drawn), drawn

    def of(self, seed: int, who: Participant | None, source: Path) -> tuple[HumanParameters, dict[str, float]]:
        """The parameters of the participant, or of the seed's driver if there is none, and the values behind them."""
        return self.draw(seed) if who is None else self.participant(who, source)

    def participant(self, who: Participant, source: Path) -> tuple[HumanParameters, dict[str, float]]:
        """The parameters of a participant, and the values behind them.

        Values of the scenario (`source`) replace those of the population. Raises DasError if the values contradict each
        other, or if the scenario gives a range, because each seed would then draw another driver.
        """
        for name, figure in self.given.items():
            if figure.low != figure.high:
                expected = "expected one value, because a participant stays the same on every day"
                raise DasError(f"{source}: human.{name} is a range: {expected}")
        fixed = {name: figure.low for name, figure in self.given.items()}
        values = who.population.draw(who.number) | fixed
        try:
            return _driver(values), {"participant": who.number, **values}
        except InputError as error:
            raise DasError(f"{who.population.source}: participant {who.number}: {error}") from None


def read_human(table: Fields) -> HumanRange:
    """Read the table `[human]` of a scenario; raises InputError or DasError for anything unusable."""
    table.check_keys([TRIPS, *(item.name for item in fields(HumanParameters))])
    given = {name: read_range(table, name) for name in table.data}
    for name, figure in given.items():
        if name in COUNTED and figure.low != figure.high:
            raise table.error(name, table.data[name], "one whole number")
    lows = {name: figure.low for name, figure in given.items()}
    highs = {name: figure.high for name, figure in given.items()}
    # The mean time between glances must exceed the least one even for the closest values that a seed can draw.
    nearest = lows | {name: highs[name] for name in ("glance_least_s",) if name in highs}
    for ends in (nearest, highs):
        try:
            _driver(ends)
        except InputError as error:
            raise DasError(f"{table.source}: {str(error).replace('human driver: ', table.prefix, 1)}") from None
    return HumanRange(given=given)


def _driver(values: Mapping[str, float]) -> HumanParameters:
    of_driver: dict[str, Any] = {name: value for name, value in values.items() if name != TRIPS}
    counted = {name: int(of_driver[name]) for name in COUNTED if name in of_driver and of_driver[name] % 1 == 0}
    return HumanParameters(**(of_driver | counted)).after(values.get(TRIPS, 0.0))
