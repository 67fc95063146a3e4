"""Topics side by side in one table: a row for each moment, or one for each step along the way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from das.domain.units import NS
from sim.drive.export.columns import ON_THE_CLOCK, SINCE_START, TIME, Column, DataTable

STEP_M: Final = 10.0
"""Distance between two rows of the table along the way."""
MOVING: Final = ("truth", "position")
"""Topics that say where the train is: the first that is there counts. Their numbers change steadily between two
messages; those of other topics hold until the next message."""
JOINED: Final = ("truth", "position", "advice", "cab", "effort", "delay", "estimate", "status")
LASTING: Final = ("delay", "estimate")
"""What holds until it is said anew, however long that takes."""
LONGEST_S: Final = 3.0
"""What comes all the time is not taken for more than so many seconds: then nothing is known (empty)."""
KINDS: Final = ("float", "int", "bool", "choice")


def by_time(tables: Mapping[str, DataTable], zero_ns: int) -> DataTable | None:
    """One row for each message that says where the train is; None where there are none."""
    base = _base(tables)
    if base is None:
        return None
    at_ns = np.unique(_times(base))
    return DataTable(name="by_time", columns=[*_moments(at_ns, zero_ns), *_joined(tables, at_ns)])


def by_position(tables: Mapping[str, DataTable], zero_ns: int, step_m: float = STEP_M) -> DataTable | None:
    """One row every `step_m` along the way as driven; None where the train did not move.

    The time is when the train was first there, so that a stand counts where it begins. Where nothing is recorded of the
    train for longer than `LONGEST_S`, there are no rows.
    """
    base = _base(tables)
    if base is None:
        return None
    time_ns, s_m = _first_there(base)
    if len(s_m) < 2:
        return None
    places = np.arange(np.ceil(s_m[0] / step_m), np.floor(s_m[-1] / step_m) + 1) * step_m
    if len(places):
        at_ns = time_ns[0] + np.rint(np.interp(places, s_m, (time_ns - time_ns[0]).astype(np.float64))).astype(np.int64)
        there = _between_neighbours(np.sort(_times(base)), at_ns)
        places, at_ns = places[there], at_ns[there]
    if not len(places):
        return None
    lasts = [*(np.diff(at_ns) * NS).tolist(), None]
    columns = [
        Column(name="s_m", kind="float", values=places.tolist(), meaning="position of the train's head on the route"),
        *_moments(at_ns, zero_ns),
        Column(name="to_next_s", kind="float", values=lasts, meaning="time from this row to the next, stands included"),
        *_joined(tables, at_ns),
    ]
    return DataTable(name="by_position", columns=columns)


def _first_there(base: DataTable) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Times (ns) and positions (m) at which the train was further than ever before, in the order of the times."""
    time_ns, s_m = _times(base), np.array(base["s_m"].values, dtype=np.float64)
    order = np.argsort(time_ns, kind="stable")
    order = order[np.isfinite(s_m[order])]
    time_ns, s_m = time_ns[order], s_m[order]
    ahead = np.ones(len(s_m), dtype=bool)
    ahead[1:] = s_m[1:] > np.maximum.accumulate(s_m)[:-1]
    return time_ns[ahead], s_m[ahead]


def _base(tables: Mapping[str, DataTable]) -> DataTable | None:
    return next((tables[name] for name in MOVING if name in tables and len(tables[name])), None)


def _times(table: DataTable) -> NDArray[np.int64]:
    return np.array(table[TIME].values, dtype=np.int64)


def _moments(at_ns: NDArray[np.int64], zero_ns: int) -> list[Column]:
    return [
        Column(name=TIME, kind="int", values=at_ns.tolist(), meaning="since 1970 (UTC)"),
        Column(name=SINCE_START, kind="float", values=((at_ns - zero_ns) / 1e9).tolist(), meaning=ON_THE_CLOCK),
    ]


def _joined(tables: Mapping[str, DataTable], at_ns: NDArray[np.int64]) -> list[Column]:
    """The columns of all topics at some moments, each with its topic's name in front."""
    columns = []
    for name in JOINED:
        if name in tables and len(tables[name]):
            columns += _at(tables[name], at_ns)
    return columns


def _at(table: DataTable, at_ns: NDArray[np.int64]) -> list[Column]:
    order = np.argsort(_times(table), kind="stable")
    time_ns = _times(table)[order]
    last = np.searchsorted(time_ns, at_ns, side="right") - 1
    age_s = (at_ns - time_ns[np.maximum(last, 0)]) * NS
    known = (last >= 0) & ((age_s <= LONGEST_S) | (table.name in LASTING))
    near = known & _between_neighbours(time_ns, at_ns)
    columns = []
    for one in table.columns[3:]:  # behind the times
        if one.kind not in KINDS:
            continue
        ordered = [one.values[i] for i in order]
        values = _steady(ordered, time_ns, at_ns) if table.name in MOVING and one.kind == "float" else None
        held: Sequence[Any] = values if values is not None else [ordered[i] for i in np.maximum(last, 0)]
        kept = [x if there else None for x, there in zip(held, known if values is None else near, strict=True)]
        columns.append(Column(name=f"{table.name}_{one.name}", kind=one.kind, values=kept, meaning=one.meaning))
    return columns


def _between_neighbours(time_ns: NDArray[np.int64], at_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether moments lie on a message or between two that are not far from each other: elsewhere a piece is lost."""
    last = np.maximum(np.searchsorted(time_ns, at_ns, side="right") - 1, 0)
    following = np.minimum(last + 1, len(time_ns) - 1)
    near: NDArray[np.bool_] = (time_ns[last] == at_ns) | ((time_ns[following] - time_ns[last]) * NS <= LONGEST_S)
    return near


def _steady(values: list[Any], time_ns: NDArray[np.int64], at_ns: NDArray[np.int64]) -> list[float]:
    """Numbers at some moments, on straight lines between those that are known."""
    numbers = np.array([np.nan if one is None else one for one in values], dtype=np.float64)
    zero = time_ns[0]
    return [float(x) for x in np.interp((at_ns - zero).astype(float), (time_ns - zero).astype(float), numbers)]
