"""Reader of quantities in parsed files; every error names the file, the key and the value."""

from __future__ import annotations

import dataclasses
import json
import math
import stat
import tomllib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from das.domain.errors import MISSING, DasError, InputError, is_seen, one_of
from das.domain.units import FACTORS, MEGABYTE, to_si

MOST_BYTES = 5_000_000
"""Largest file (bytes) of a vehicle, route, journey or loss map. A route of 1000 km with a geometry point every 10 m
has about 3 MB."""
MOST_BYTES_OF_TEXT = 200_000_000
"""Largest text file (bytes) of any kind. A recorded trip has about 5 MB for 24 hours at one row a second."""
MOST_ROWS = 20_000
"""Largest number of rows of a list: 1000 km of track with a gradient every 50 m."""
MOST_OF_A_NAME = 200
"""Longest name (characters) of a vehicle, route, journey or place."""
LARGEST = 1e12
"""Largest number in a file, in SI units, so that computations remain finite. The largest quantity of a railway, the
power of a network, is smaller."""
SHORTEST_TRAIN_M = 0.1
"""Shortest length (m) of a train that is not a point; gradients are averaged over the length."""
LARGEST_LENGTH_M = 1e9
"""Largest position or length (m) in a file; `das.domain.plausibility` then applies narrower limits."""
Kind = TypeVar("Kind", bound=StrEnum)
Made = TypeVar("Made")


def read_text(path: Path, most_bytes: int = MOST_BYTES_OF_TEXT) -> str:
    """Text of a UTF-8 file; DasError if it cannot be read, is not a regular file or has more than `most_bytes`."""
    try:
        if not stat.S_ISREG(path.stat().st_mode) and not path.is_dir():
            raise DasError(f"{path}: not a regular file")  # opening a pipe would wait for its other end
        with path.open("rb") as file:
            content = file.read(most_bytes + 1)
    except OSError as error:
        raise DasError(f"{path}: cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise DasError(f"{path}: cannot be read ({error})") from error
    if len(content) > most_bytes:
        raise DasError(f"{path}: more than {most_bytes / MEGABYTE:g} MB, expected a smaller file")
    try:
        return content.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        raise DasError(f"{path}: not a UTF-8 text file ({error.reason} at byte {error.start})") from error


def read_json(path: Path, most_bytes: int = MOST_BYTES) -> Fields:
    """Parse a JSON object; DasError if the file cannot be read, has a duplicate key, or is not a JSON object."""
    try:
        data = json.loads(read_text(path, most_bytes), object_pairs_hook=_each_key_once)
    except (ValueError, RecursionError) as error:
        raise DasError(f"{path}: not valid JSON ({error})") from error
    return Fields.of(path, data)


def _each_key_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """The object made of the pairs; ValueError for a duplicate key, whose first value would be lost silently."""
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"duplicate key {next(name for name in names if names.count(name) > 1)!r}")
    return found


def read_toml(path: Path) -> Fields:
    """Parse a TOML document; DasError if the file cannot be read or is not TOML."""
    try:
        data = tomllib.loads(read_text(path, MOST_BYTES))
    except (ValueError, RecursionError) as error:
        raise DasError(f"{path}: not valid TOML ({error})") from error
    return Fields.of(path, data)


@dataclass(frozen=True)
class Fields:
    """A table of a file, its place in the file, and typed access to its values."""

    source: Path
    prefix: str
    data: Mapping[str, Any]

    @classmethod
    def of(cls, source: Path, data: object, prefix: str = "") -> Fields:
        """The fields of a parsed table; InputError if `data` is something else."""
        if not isinstance(data, Mapping):
            raise InputError(source, prefix.rstrip(".") or "the file", type(data).__name__, "a table of keys")
        return cls(source, prefix, data)

    def error(self, key: str, value: object, expected: str) -> InputError:
        """The error for a value of this table."""
        return InputError(self.source, self.prefix + key, value, expected)

    def has(self, key: str) -> bool:
        """Whether the table has a key."""
        return key in self.data

    def table(self, key: str) -> Fields:
        """The table under a key; InputError if there is none."""
        if key not in self.data:
            raise self.error(key, MISSING, "a table")
        return Fields.of(self.source, self.data[key], f"{self.prefix}{key}.")

    def optional_table(self, key: str) -> Fields:
        """The table under a key, or an empty table if the key is missing; InputError for anything else."""
        return self.table(key) if self.has(key) else Fields(self.source, f"{self.prefix}{key}.", {})

    def tables(self, key: str, most: int, *, needed: bool = False) -> list[Fields]:
        """The tables [[key]], at most `most`. Without any, the list is empty, or InputError is raised if `needed`."""
        entries = self.data.get(key, MISSING if needed else [])
        if not isinstance(entries, list):
            raise self.error(key, entries, f"a list of [[{key}]]")
        self.check_count(key, entries, most)
        return [Fields.of(self.source, entry, f"{self.prefix}{key}[{i}].") for i, entry in enumerate(entries)]

    def text(self, key: str, default: str | None = None) -> str:
        """The text under a key; InputError if it is missing and has no default, or is not a text."""
        value = self.data.get(key, default)
        if not isinstance(value, str):
            raise self.error(key, self.data.get(key, MISSING), "a string")
        return value

    def name(self, key: str, default: str | None = None) -> str:
        """A text that fits on a line: without control characters, of at most `MOST_OF_A_NAME` characters."""
        value = self.text(key, default)
        if not is_seen(value) or len(value) > MOST_OF_A_NAME:
            raise self.error(key, value, f"a string of at most {MOST_OF_A_NAME} characters without control characters")
        return value

    def flag(self, key: str, default: bool) -> bool:
        """The truth value under a key; InputError for anything else."""
        value = self.data.get(key, default)
        if not isinstance(value, bool):
            raise self.error(key, value, "true or false")
        return value

    def whole(self, key: str, ends: tuple[int, int], default: int | None = None) -> int:
        """The whole number under a key, between the two bounds (inclusive); InputError for anything else."""
        value = self.data.get(key, MISSING if default is None else default)
        if isinstance(value, bool) or not isinstance(value, int) or not ends[0] <= value <= ends[1]:
            raise self.error(key, value, f"a whole number from {ends[0]} to {ends[1]}")
        return value

    def choice(self, key: str, kind: type[Kind], default: Kind | None = None) -> Kind:
        """The member of an enumeration named under a key; InputError for anything else."""
        value = self.text(key, default)
        if value not in list(kind):
            raise self.error(key, value, one_of(kind, value))
        return kind(value)

    def names(self, key: str, known: Collection[str]) -> list[str]:
        """The list of names under a key, empty if the key is missing; InputError for an unknown name."""
        names = self.data.get(key, [])
        if not isinstance(names, list) or any(name not in known for name in names):
            raise self.error(key, names, f"a list of names from {', '.join(known)}")
        return names

    def check_schema_version(self, supported: int) -> None:
        """Raise InputError unless the file states the supported version of its format."""
        value = self.data.get("schema_version", MISSING)
        if isinstance(value, bool) or value != supported:
            raise self.error("schema_version", value, f"{supported}")

    def check_keys(self, allowed: Sequence[str]) -> None:
        """Raise InputError for a key that is not allowed, for example a misspelt optional key."""
        for key in self.data:
            if key not in allowed:
                raise self.error(key, self.data[key], one_of(sorted(allowed), key, "the keys "))

    def quantity(self, name: str, dimension: str, default: float | None = None, *, unbounded: bool = False) -> float:
        """A number whose key ends in its unit (`mass_t = 440`), in SI.

        Any unit of the dimension is accepted. Raises InputError for two keys of one quantity, for a missing key without
        a default and, unless `unbounded`, for a number that is infinite or too large (see `in_si`).
        """
        found = self.given_keys(name, dimension)
        if len(found) > 1:
            raise self.error(found[1], self.data[found[1]], f"only one of {found[0]} and {found[1]}")
        if not found:
            if default is not None:
                return default
            raise self.error(name, MISSING, " or ".join(self.quantity_keys({name: dimension})))
        unit = found[0][len(name) + 1 :]
        key, value = self.prefix + found[0], self.data[found[0]]
        return in_si(self.source, key, value, (unit, dimension), unbounded=unbounded)

    def made(self, kind: type[Made], *beside: str, **given: object) -> Made:
        """An instance of a dataclass from a table of its quantities: `mass_t = 440` for the field `mass_kg`.

        A field with a default may be missing; `beside` are other keys that the table may have, `given` other fields.
        Raises InputError for any other key, and for the errors that the dataclass raises, with the key of the file.
        """
        every = dataclasses.fields(kind)  # type: ignore[arg-type]
        wanted = {one.name: one.default for one in every if "float" in str(one.type)}
        names = {field: quantity_of(field) for field in wanted if field not in given}
        self.check_keys(["source", *beside, *self.quantity_keys(dict(names.values()))])
        values = dict(given)
        for field, (name, dimension) in names.items():
            default = wanted[field]
            if default is dataclasses.MISSING or self.given_keys(name, dimension):
                values[field] = self.quantity(name, dimension)
        maker: Callable[..., Made] = kind
        try:
            return maker(**values)
        except InputError as error:
            raise self.error(error.key, error.value, error.expected) from None

    def within(self, name: str, dimension: str, default: float, ends: tuple[float, float]) -> float:
        """A finite quantity within its bounds (SI); InputError for any other."""
        value = self.quantity(name, dimension, default, unbounded=True)
        if not ends[0] <= value <= ends[1] or math.isinf(value):
            (key,) = self.given_keys(name, dimension)
            raise self.error(key, self.data[key], range_expected(key[len(name) + 1 :], dimension, ends))
        return value

    def quantity_keys(self, quantities: Mapping[str, str]) -> list[str]:
        """All keys under which the given quantities (name → dimension) may appear: `mass_kg`, `mass_t`."""
        return [f"{name}_{unit}" for name, dimension in quantities.items() for unit in key_units(dimension)]

    def given_keys(self, name: str, dimension: str) -> list[str]:
        """The keys of the table that give a quantity: at most one in a valid table; `quantity` rejects more."""
        return [key for key in self.quantity_keys({name: dimension}) if key in self.data]

    def rows(self, key: str, what: str, most: int = MOST_ROWS) -> list[Any]:
        """The list under a key; InputError for an empty list, more than `most` entries, or anything else."""
        rows = self.data.get(key, MISSING)
        if not isinstance(rows, list) or not rows:
            raise self.error(key, rows, what)
        self.check_count(key, rows, most)
        return rows

    def check_count(self, key: str, entries: Sequence[object], most: int = MOST_ROWS) -> None:
        """Raise InputError if a list of this table has more than `most` entries."""
        if len(entries) > most:
            raise InputError(self.source, f"number of {self.prefix}{key}", len(entries), f"at most {most}")

    def number_rows(
        self, key: str, wanted: Mapping[str, str], *, unbounded: Collection[str] = (), most: int = MOST_ROWS
    ) -> list[tuple[float, ...]]:
        """The rows of a list with units in its column names: {columns = ["position_km", …], rows = [[…], …]} in SI.

        `wanted` maps each quantity to its dimension; quantities in `unbounded` may be infinite or of any size.
        """
        table = self.table(key)
        table.check_keys(["source", "columns", "rows"])
        names = table.data.get("columns", MISSING)
        if not isinstance(names, list) or len(names) != len(wanted):
            raise table.error("columns", names, f"{len(wanted)} names: {', '.join(wanted)}, each with its unit")
        rows = table.rows("rows", "a list of rows", most)
        columns: list[list[float]] = []
        for index, (name, dimension) in enumerate(wanted.items()):
            unit, free = _column_unit(table, str(names[index]), name, dimension), name in unbounded
            keys = (f"{table.prefix}rows[{i}].{name}" for i in range(len(rows)))
            cells = (_cell(table, i, row, index) for i, row in enumerate(rows))
            found = zip(keys, cells, strict=True)
            columns.append([in_si(self.source, key, x, (unit, dimension), unbounded=free) for key, x in found])
        return list(zip(*columns, strict=True))

    def optional_rows(
        self, key: str, wanted: Mapping[str, str], *, unbounded: Collection[str] = (), most: int = MOST_ROWS
    ) -> list[tuple[float, ...]]:
        """The rows of a list, as for `number_rows`; empty if the key is missing."""
        return self.number_rows(key, wanted, unbounded=unbounded, most=most) if self.has(key) else []


@cache
def quantity_of(field: str) -> tuple[str, str]:
    """The name and the dimension of the quantity in a field whose name ends in the SI unit, which may have several
    words (`n_per_mps`); a field in `_ratio` is a ratio, not a gradient.
    """
    units = {unit: dimension for dimension in reversed(FACTORS) for unit in key_units(dimension, si=True)}
    unit = max((unit for unit in units if field.endswith(f"_{unit}")), key=len)
    return field.removesuffix(f"_{unit}"), units[unit]


def key_units(dimension: str, *, si: bool = False) -> list[str]:
    """The units of a dimension that can end a key of a file: `mps` and `kmh`, but not `km/h`; `si`: only SI units."""
    factors = FACTORS[dimension].items()
    return [unit for unit, si_per in factors if unit.isidentifier() and unit.islower() and (si_per == 1.0 or not si)]


def in_si(source: Path, key: str, value: object, unit: tuple[str, str], *, unbounded: bool = False) -> float:
    """A number of a file in SI, from its unit and dimension.

    Raises InputError for a value that is not a number, is infinite or exceeds `LARGEST` (for a position or length
    `LARGEST_LENGTH_M`). An `unbounded` number may be infinite or of any size; the caller checks it.
    """
    result = to_si(number(source, key, value), *unit)
    largest = LARGEST_LENGTH_M if unit[1] == "length" else LARGEST
    if unbounded or abs(result) <= largest:
        return result
    if math.isinf(result):
        raise InputError(source, key, value, "a finite number")
    raise InputError(source, key, value, f"a number of at most {largest / to_si(1.0, *unit):.4g}")


def train_length_m(source: Path, value: float) -> float:
    """A train's length (m), 0 for a point; InputError if it is too short for means over the length."""
    if 0 < value < SHORTEST_TRAIN_M:
        raise InputError(source, "vehicle.length", value, f"0 m (a point), or at least {SHORTEST_TRAIN_M:g} m")
    return value


def number(source: Path, key: str, value: object) -> float:
    """A real number that is not NaN (a straight track has a radius of inf); InputError for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(source, key, value, "a number")
    try:
        result = float(value)
    except OverflowError:
        raise InputError(source, key, _long_integer(int(value)), "a smaller number") from None
    if math.isnan(result):
        raise InputError(source, key, value, "a number")
    return result


def _long_integer(value: int) -> str:
    """A short form of an integer too large for a float; Python does not print one of more than 4300 digits."""
    try:
        return f"{str(value)[:12]}… ({len(str(value))} digits)"
    except ValueError:
        return f"an integer of {value.bit_length()} bits"


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


def range_expected(unit: str, dimension: str, ends: tuple[float, float]) -> str:
    """A range (SI) as text, in the unit of the file."""
    low, high = (end / FACTORS[dimension][unit] for end in ends)
    return f"a finite number >= {low:g}" if math.isinf(high) else f"a number from {low:g} to {high:g}"
