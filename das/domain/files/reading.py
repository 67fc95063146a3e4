"""Reading quantities out of parsed files with errors that name the file, the key and the value."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from das.domain.errors import MISSING, DasError, InputError
from das.domain.units import FACTORS, to_si


def read_text(path: Path) -> str:
    """Text of a UTF-8 file; DasError where it cannot be read."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise DasError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise DasError(f"{path}: not a UTF-8 text file ({error.reason} at byte {error.start})") from error


def read_json(path: Path) -> Fields:
    """Parse a JSON object."""
    try:
        data = json.loads(read_text(path))
    except (ValueError, RecursionError) as error:
        raise DasError(f"{path}: not valid JSON ({error})") from error
    return Fields.of(path, data)


def read_toml(path: Path) -> Fields:
    """Parse a TOML document."""
    try:
        data = tomllib.loads(read_text(path))
    except (ValueError, RecursionError) as error:
        raise DasError(f"{path}: not valid TOML ({error})") from error
    return Fields.of(path, data)


@dataclass(frozen=True)
class Fields:
    """A table of a file, its place in the file, and typed access to what is in it."""

    source: Path
    prefix: str
    data: Mapping[str, Any]

    @classmethod
    def of(cls, source: Path, data: object, prefix: str = "") -> Fields:
        if not isinstance(data, Mapping):
            raise InputError(source, prefix.rstrip(".") or "the file", type(data).__name__, "a table of keys")
        return cls(source, prefix, data)

    def error(self, key: str, value: object, expected: str) -> InputError:
        return InputError(self.source, self.prefix + key, value, expected)

    def has(self, key: str) -> bool:
        return key in self.data

    def table(self, key: str) -> Fields:
        if key not in self.data:
            raise self.error(key, MISSING, "a table")
        return Fields.of(self.source, self.data[key], f"{self.prefix}{key}.")

    def text(self, key: str, default: str | None = None) -> str:
        value = self.data.get(key, default)
        if not isinstance(value, str):
            raise self.error(key, self.data.get(key, MISSING), "a text")
        return value

    def flag(self, key: str, default: bool) -> bool:
        value = self.data.get(key, default)
        if not isinstance(value, bool):
            raise self.error(key, value, "true or false")
        return value

    def check_schema_version(self, supported: int) -> None:
        value = self.data.get("schema_version", MISSING)
        if isinstance(value, bool) or value != supported:
            raise self.error("schema_version", value, f"{supported}")

    def check_keys(self, allowed: Sequence[str]) -> None:
        """Refuse keys nobody reads: a misspelt optional key would be ignored in silence."""
        for key in self.data:
            if key not in allowed:
                raise self.error(key, self.data[key], f"one of the keys {', '.join(sorted(allowed))}")

    def quantity(self, name: str, dimension: str, default: float | None = None) -> float:
        """A number whose key ends in its unit (`mass_t = 440`), in SI.

        Any unit of the dimension will do; two keys for one quantity, or none without a default, are refused.
        """
        keys = self.quantity_keys({name: dimension})
        found, names = [key for key in keys if key in self.data], " or ".join(keys)
        if len(found) > 1:
            raise self.error(found[1], self.data[found[1]], f"only one of {found[0]} and {found[1]}")
        if not found:
            if default is not None:
                return default
            raise self.error(name, MISSING, names)
        unit = found[0][len(name) + 1 :]
        return to_si(number(self.source, self.prefix + found[0], self.data[found[0]]), unit, dimension)

    def quantity_keys(self, quantities: Mapping[str, str]) -> list[str]:
        """All keys under which the given quantities (name → dimension) may appear."""
        return [
            f"{name}_{unit}"
            for name, dimension in quantities.items()
            for unit in FACTORS[dimension]
            if unit.isidentifier() and unit.islower()
        ]

    def columns(self, key: str, wanted: Mapping[str, str]) -> dict[str, list[float]]:
        """A list with units in its column names: {columns = ["position_km", …], rows = [[…], …]} in SI.

        `wanted` maps each quantity to its dimension.
        """
        table = self.table(key)
        table.check_keys(["source", "columns", "rows"])
        names, rows = table.data.get("columns", MISSING), table.data.get("rows", MISSING)
        if not isinstance(names, list) or len(names) != len(wanted):
            raise table.error("columns", names, f"{len(wanted)} names: {', '.join(wanted)}, each with its unit")
        if not isinstance(rows, list) or not rows:
            raise table.error("rows", rows, "a list of rows")
        result: dict[str, list[float]] = {}
        for index, (name, dimension) in enumerate(wanted.items()):
            unit = _column_unit(table, str(names[index]), name, dimension)
            result[name] = [
                to_si(
                    number(self.source, f"{table.prefix}rows[{i}].{name}", _cell(table, i, row, index)), unit, dimension
                )
                for i, row in enumerate(rows)
            ]
        return result


def number(source: Path, key: str, value: object) -> float:
    """A real number that is not NaN (inf is allowed: a straight track has it)."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(source, key, value, "a number")
    try:
        result = float(value)
    except OverflowError:
        raise InputError(source, key, f"{str(value)[:12]}… ({len(str(value))} digits)", "a number that fits") from None
    if math.isnan(result):
        raise InputError(source, key, value, "a number")
    return result


def _column_unit(table: Fields, column: str, name: str, dimension: str) -> str:
    unit = column[len(name) + 1 :] if column.startswith(name + "_") else ""
    if unit not in FACTORS[dimension]:
        names = " or ".join(f"{name}_{u}" for u in FACTORS[dimension] if u.isidentifier())
        raise table.error("columns", column, names)
    return unit


def _cell(table: Fields, index: int, row: object, column: int) -> object:
    if not isinstance(row, list) or len(row) != len(table.data["columns"]):
        raise table.error(f"rows[{index}]", row, "a row with a value for every column")
    return row[column]
