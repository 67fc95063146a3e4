"""Leaves out of tables who drove and where: names, texts, places on the map, the day, and the zero of the route."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

from sim.drive.export.columns import Column, DataTable

DROPPED_TABLES: Final = ("location",)
"""Tables that are left out as a whole: they say where the train was on the map."""
POSITIONS: Final = ("s_m", "start_m", "end_m", "signal_m")
"""Columns that are positions on the route; those count from the first stop then."""
TIMES_END: Final = "_ns"
"""Columns that end so are moments; they count from the departure then, so that the day is not told."""


def anonymous(table: DataTable, zero_ns: int, zero_m: float) -> DataTable | None:
    """The table without who and where; None for one that is left out.

    Texts are left out, since reasons and remarks may name stops. Values of enumerations stay. `zero_ns` (ns since 1970)
    and `zero_m` become 0.
    """
    if table.name in DROPPED_TABLES:
        return None
    kept = [_shifted(one, zero_ns, zero_m) for one in table.columns if one.kind != "text"]
    return replace(table, columns=kept)


def _shifted(column: Column, zero_ns: int, zero_m: float) -> Column:
    bare = column.name
    if bare.endswith(TIMES_END):
        values: list[Any] = [None if not value else value - zero_ns for value in column.values]
        return replace(column, values=values, meaning=f"{column.meaning or 'a moment'}; counted from the departure")
    if bare in POSITIONS:
        return replace(column, values=[_minus(value, zero_m) for value in column.values])
    return column


def _minus(value: Any, zero_m: float) -> Any:
    if isinstance(value, list):
        return [one - zero_m for one in value]
    return None if value is None else value - zero_m
