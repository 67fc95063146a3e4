"""Figures of a scenario: one value, or a range from which every seed draws."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from das.domain.errors import MISSING
from das.domain.files.reading import Fields, number
from das.domain.units import to_si


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """A figure that every seed draws evenly between `low` and `high`; it is fixed if they are equal."""

    low: float
    high: float

    def draw(self, random: np.random.Generator) -> float:
        return float(random.uniform(self.low, self.high))


def read_range(table: Fields, key: str) -> Drawn:
    """Read a figure in the unit of its key: `delay_s = 90` or `delay_s = {min = 30, max = 180}`.

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
    """Read a quantity, or a range of it, in SI; its key ends in its unit. Raises InputError for anything else."""
    key = key_of(table, name, dimension)
    if not isinstance(table.data.get(key), Mapping):
        value = table.quantity(name, dimension, default, unbounded=True)
        return Drawn(low=value, high=value)
    if more := [x for x in table.quantity_keys({name: dimension}) if x in table.data and x != key]:
        raise table.error(more[0], table.data[more[0]], f"only one of {key} and {more[0]}")
    unit, drawn = key[len(name) + 1 :], read_range(table, key)
    return Drawn(low=to_si(drawn.low, unit, dimension), high=to_si(drawn.high, unit, dimension))


def key_of(table: Fields, name: str, dimension: str) -> str:
    """The key under which the file gives a quantity; the bare name of the quantity if the file does not give it."""
    return next((key for key in table.quantity_keys({name: dimension}) if key in table.data), name)
