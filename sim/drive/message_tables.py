"""The messages of a topic as plain columns with units and meanings, and their bytes as CSV and Parquet."""

from __future__ import annotations

import csv
import importlib.util
import io
import json
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

from das.bus.recorder import comments
from das.bus.recording import Stamped
from das.domain.errors import DasError
from sim.recording.course import stated_ns

UNITS: Final = {
    "_mps2": "m/s²",
    "_mps": "m/s",
    "_deg": "°",
    "_ratio": "1",
    "_per_min": "1/min",
    "_ns": "ns",
    "_m": "m",
    "_s": "s",
    "_n": "N",
    "_j": "J",
}
"""Units by the suffix of a column's name."""
RENAMED: Final = {
    "foxglove.LocationFix": {"latitude": "latitude_deg", "longitude": "longitude_deg", "altitude": "altitude_m"},
}
"""New names, with the unit as suffix, for fields of Foxglove messages, whose own names do not state a unit."""
LEFT_OUT: Final = {
    "foxglove.LocationFix": ("timestamp", "position_covariance", "position_covariance_type", "color", "heading"),
    "foxglove.Log": ("timestamp", "file", "line"),
}
"""Fields that our programs do not fill, and times that have a column of their own."""
LOG_TIME, TIME, SINCE_START = "log_time_ns", "time_ns", "time_s"
ON_THE_CLOCK: Final = (
    "on the drive's clock: 0 at the timetable's first departure, or at the first position if there is no timetable"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Column:
    """A column: its name with the unit as suffix, its values (None: missing), and its meaning.

    `kind` is one of int, float, bool, text, choice (the name of a value of an enumeration) and floats (a list).
    """

    name: str
    kind: str
    values: list[Any]
    meaning: str = ""

    @property
    def unit(self) -> str:
        """The unit by the column's name; empty if there is none."""
        return next((unit for end, unit in UNITS.items() if self.name.endswith(end)), "")


@dataclass(frozen=True, kw_only=True, eq=False)
class DataTable:
    """A table: its name, and columns of equal length."""

    name: str
    columns: list[Column] = field(default_factory=list)

    def __getitem__(self, name: str) -> Column:
        return next(one for one in self.columns if one.name == name)

    def __len__(self) -> int:
        return len(self.columns[0].values) if self.columns else 0

    def only(self, keep: Sequence[bool]) -> DataTable:
        """The table with some of its rows."""
        return replace(
            self,
            columns=[
                replace(x, values=[one for one, kept in zip(x.values, keep, strict=True) if kept]) for x in self.columns
            ],
        )


def tables_of(name: str, entries: Sequence[Stamped], zero_ns: int) -> list[DataTable]:
    """The table of a topic, and one more for each list of messages within its messages (such as a journey's stops).

    `zero_ns` is the moment at which the column `time_s` is 0 (ns since 1970).
    """
    times = [stated_ns(one) for one in entries]
    head = _times([one.log_time_ns for one in entries], times, zero_ns)
    messages = [one.message for one in entries]
    table = DataTable(name=name, columns=[*head, *_columns(messages, "")])
    return [table, *_inner_tables(name, entries, times, zero_ns)]


def _times(log_ns: list[int], time_ns: list[int], zero_ns: int) -> list[Column]:
    return [
        Column(name=LOG_TIME, kind="int", values=log_ns, meaning="when it was recorded, since 1970 (UTC)"),
        Column(name=TIME, kind="int", values=time_ns, meaning="the time that the message states, since 1970 (UTC)"),
        Column(name=SINCE_START, kind="float", values=[(t - zero_ns) / 1e9 for t in time_ns], meaning=ON_THE_CLOCK),
    ]


def _columns(messages: Sequence[Any | None], prefix: str) -> Iterator[Column]:
    """The columns of messages of one kind; None stands for a missing message."""
    some = next((one for one in messages if one is not None), None)
    if some is None:
        return
    kind = some.DESCRIPTOR
    for one in kind.fields:
        if (one.name == TIME and not prefix) or one.name in LEFT_OUT.get(kind.full_name, ()):
            continue
        name = f"{prefix}{RENAMED.get(kind.full_name, {}).get(one.name, one.name)}"
        if one.message_type is not None:
            if not one.is_repeated:
                yield from _columns(_inner(messages, one.name), f"{name}_")
        else:
            yield _column(one, messages, name, _meaning(one))


def _inner(messages: Sequence[Any | None], name: str) -> list[Any | None]:
    return [getattr(one, name) if one is not None and one.HasField(name) else None for one in messages]


def _column(description: Any, messages: Sequence[Any | None], name: str, meaning: str) -> Column:
    values = [None if one is None else getattr(one, description.name) for one in messages]
    if description.enum_type is not None:
        return Column(name=name, kind="choice", values=_named(values, description.enum_type), meaning=meaning)
    cpp = description.cpp_type
    kinds = {description.CPPTYPE_STRING: "text", description.CPPTYPE_BOOL: "bool"}
    kinds |= {description.CPPTYPE_DOUBLE: "float", description.CPPTYPE_FLOAT: "float"}
    kind = kinds.get(cpp, "int")
    if description.is_repeated:
        kind, values = "floats", [None if one is None else list(one) for one in values]
    elif name.endswith("_ns"):
        values = [one or None for one in values]  # a time of 0 means that it is not set
    return Column(name=name, kind=kind, values=values, meaning=meaning)


def _named(values: list[Any], enumeration: Any) -> list[str | None]:
    """The names of an enumeration's values in lower case, without their common prefix."""
    names = {number: one.name for number, one in enumeration.values_by_number.items()}
    # Their common beginning ends in an underscore: MODE_ of MODE_NONE and MODE_COAST.
    common = os.path.commonprefix(list(names.values()))  # noqa: RUF071  # of words, not of paths
    begin = common.rfind("_") + 1 if len(names) > 1 else 0
    return [None if x is None else names.get(x, str(x))[begin:].lower() for x in values]


def _inner_tables(name: str, entries: Sequence[Stamped], times: list[int], zero_ns: int) -> Iterator[DataTable]:
    """A table for each list of inner messages: a row for each inner message, with the time of its outer message."""
    if not entries:
        return
    for path, get in _lists(entries[0].message.DESCRIPTOR, "", lambda one: one):
        rows = [(i, number, inner) for i, one in enumerate(entries) for number, inner in enumerate(get(one.message), 1)]
        if not rows:
            continue
        head = _times([entries[i].log_time_ns for i, _, _ in rows], [times[i] for i, _, _ in rows], zero_ns)
        number = Column(name="number", kind="int", values=[n for _, n, _ in rows], meaning="place in the list, from 1")
        inner = list(_columns([one for _, _, one in rows], ""))
        yield DataTable(name=f"{name}_{path}", columns=[*head, number, *inner])


def _lists(kind: Any, prefix: str, get: Callable[[Any], Any]) -> Iterator[tuple[str, Callable[[Any], Any]]]:
    for one in kind.fields:
        if one.message_type is None or not one.message_type.full_name.startswith("das."):
            continue

        def inner(message: Any, name: str = one.name) -> Any:
            return getattr(get(message), name)

        if one.is_repeated:
            yield f"{prefix}{one.name}", inner
        else:
            yield from _lists(one.message_type, f"{prefix}{one.name}_", inner)


def _meaning(field: Any) -> str:
    """The meaning of a field: the comment in das.proto, without the unit, which has its own column."""
    return re.sub(r"^\[[^]]*\] ?", "", comments().get(field.full_name, ""))


def require_parquet() -> None:
    """Raise DasError if the package that writes Parquet is not installed."""
    if importlib.util.find_spec("pyarrow") is None:
        raise DasError(
            "pyarrow is not installed: pip install '.[export]' in the checkout, or write CSV alone (--format csv)"
        )


def as_csv(table: DataTable) -> bytes:
    """A table as CSV (UTF-8): one header line, an empty cell where nothing is known, lists as JSON."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([one.name for one in table.columns])
    writer.writerows(zip(*([_cell(value) for value in one.values] for one in table.columns), strict=True))
    return out.getvalue().encode()


def _cell(value: Any) -> Any:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(value)
    return json.dumps([None if math.isnan(x) else x for x in value]) if isinstance(value, list) else value


def as_parquet(table: DataTable, about: Mapping[str, str]) -> bytes:
    """A table as Parquet; each column's unit and meaning are in its metadata, `about` in the table's."""
    import pyarrow as pa
    from pyarrow import parquet

    fields = [pa.field(one.name, _type(one, pa), metadata=_metadata(one)) for one in table.columns]
    schema = pa.schema(fields, metadata={**about, "table": table.name})
    arrays = [pa.array(one.values, type=entry.type) for one, entry in zip(table.columns, fields, strict=True)]
    out = io.BytesIO()
    parquet.write_table(pa.Table.from_arrays(arrays, schema=schema), out, compression="zstd")
    return out.getvalue()


def _metadata(column: Column) -> dict[str, str]:
    return {key: text for key, text in (("unit", column.unit), ("meaning", column.meaning)) if text}


def _type(column: Column, pa: Any) -> Any:
    return {
        "int": pa.int64(),
        "float": pa.float64(),
        "bool": pa.bool_(),
        "text": pa.string(),
        "choice": pa.string(),
        "floats": pa.list_(pa.float64()),
    }[column.kind]


def columns_table(tables: list[DataTable]) -> DataTable:
    """A table of all columns, with the table, kind, unit and meaning of each."""
    rows = [(table.name, one.name, one.kind, one.unit, one.meaning) for table in tables for one in table.columns]
    names = ("table", "column", "kind", "unit", "meaning")
    columns = [Column(name=name, kind="text", values=[row[i] for row in rows]) for i, name in enumerate(names)]
    return DataTable(name="columns", columns=columns)
