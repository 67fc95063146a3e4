"""What a recording says that its drive took above the optimum, in words: the likely range, and the worst case apart."""

from __future__ import annotations

import math
from typing import Final

from das.bus import topics
from das.bus.recording import Recording
from das.domain.units import kwh
from sim.trips.saving import NOT_COMPARABLE

SAID_BY_THE_RECORDING: Final = "the recording says so of its trip and the optimum"


def not_comparable_by_record(recording: Recording) -> bool:
    """Whether the recording says that its drive and the optimum cannot be compared; False where it says nothing."""
    return any(not entry.message.comparable for entry in recording.of(topics.SAVING)[-1:])


def saving_rows(recording: Recording) -> list[tuple[str, str]]:
    """The recorded saving, by name; empty where none was recorded (older recordings, and those of a node alone)."""
    rows: list[tuple[str, str]] = []
    for entry in recording.of(topics.SAVING)[-1:]:
        found = entry.message
        name = "advice would have saved" if not found.measured else "above the optimum of the true train"
        if not found.comparable:
            rows.append((name, NOT_COMPARABLE))
            continue
        rows.append((name, f"{kwh(found.driven_j - found.optimum_j):.1f} of {kwh(found.driven_j):.1f} kWh"))
        if not found.measured:
            rows.append((f"{name}, likely", _range(found.likely_low_j, found.likely_high_j)))
            rows.append((f"{name}, every unknown at its worst", _range(found.worst_low_j, found.worst_high_j)))
        rows += [
            (
                f"{name}, {one.start} – {one.end}",
                f"{kwh(one.driven_j - one.optimum_j):.1f} of {kwh(one.driven_j):.1f} kWh",
            )
            for one in found.sections
            if len(found.sections) > 1
        ]
    return rows


def _range(low_j: float, high_j: float) -> str:
    return "not known" if math.isnan(low_j + high_j) else f"{kwh(low_j):z.0f} to {kwh(high_j):z.0f} kWh"
