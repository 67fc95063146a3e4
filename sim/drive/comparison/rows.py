"""A comparison as plain rows: for tables, for JSON, for CSV and for the report."""

from __future__ import annotations

import csv
import io
import math
from typing import Any

import numpy as np

from das.domain.units import kmh, kwh
from sim.drive.comparison.aligned import AlignedDrives, place

TOLD_S, TOLD_KWH = 0.5, 0.05
"""Differences from these on are told in words."""


def as_dict(aligned: AlignedDrives) -> dict[str, Any]:
    """The comparison for programs: times in s, energies in kWh, positions in m; more than the first drive: > 0."""
    return {
        "from_m": float(aligned.s_m[0]),
        "to_m": float(aligned.s_m[-1]),
        "trains_differ": aligned.trains_differ,
        "drives": [drive_dict(aligned, index) for index in range(len(aligned.drives))],
    }


def drive_dict(aligned: AlignedDrives, index: int) -> dict[str, Any]:
    """One drive beside the first."""
    drive = aligned.drives[index]
    advised = None if index == 0 else aligned.first_different_advice(index)
    found: dict[str, Any] = {
        "recording": str(drive.recording.path),
        "label": drive.label,
        "train": drive.train,
        "time_s": float(aligned.time_s[index, -1]),
        "energy_kwh": kwh(float(aligned.energy_j[index, -1])),
        "energy_measured": drive.measured,
        "arrived_late_s": [_number(leg.end.arrived_late_s) for leg in drive.legs],
    }
    if index:
        found |= {
            "same": aligned.is_same(index),
            "more_time_s": float(aligned.time_s[index, -1] - aligned.time_s[0, -1]),
            "more_energy_kwh": kwh(float(aligned.energy_j[index, -1] - aligned.energy_j[0, -1])),
            "first_different_advice": None if advised is None else advised._asdict(),
            "stretches": [
                {
                    "start_m": one.start_m,
                    "end_m": one.end_m,
                    "more_time_s": one.time_s,
                    "more_energy_kwh": kwh(one.energy_j),
                    "more_lost_kwh": kwh(one.lost_j),
                }
                for one in aligned.stretches(index)
            ],
        }
    return found


def _number(value: float) -> float | None:
    return None if math.isnan(value) else value


def as_csv(aligned: AlignedDrives) -> bytes:
    """One row a position; a change of the limit is two rows. Columns of a drive end in its number, from 1 on.

    `clock_s` is on the drive's clock, `time_s` and the energies count from the first row.
    """
    columns = {"s_m": aligned.s_m, "limit_kmh": kmh(aligned.limit_mps)}
    for number in range(1, len(aligned.drives) + 1):
        i = number - 1
        columns |= {
            f"clock_s_{number}": aligned.clock_s[i],
            f"time_s_{number}": aligned.time_s[i],
            f"speed_kmh_{number}": kmh(aligned.speed_mps[i]),
            f"energy_kwh_{number}": kwh(aligned.energy_j[i]),
            f"lost_kwh_{number}": kwh(aligned.lost_j[i]),
        }
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(
        [f"{value:.6g}" if j else f"{value:.3f}" for j, value in enumerate(row)] for row in _transposed(columns)
    )
    return text.getvalue().encode()


def _transposed(columns: dict[str, Any]) -> Any:
    return np.column_stack(list(columns.values()))


def _more(value: float, unit: str, digits: int) -> str:
    return f"{abs(value):.{digits}f} {unit} {'more' if value >= 0 else 'less'}"


def sentences(aligned: AlignedDrives, index: int) -> list[str]:
    """How a drive differs from the first, in plain words."""
    first, other = aligned.drives[0], aligned.drives[index]
    if aligned.is_same(index):
        return [f"{other.label} does not differ from {first.label}: times, speeds, energies and advice are the same."]
    more_s = float(aligned.time_s[index, -1] - aligned.time_s[0, -1])
    more_kwh = kwh(float(aligned.energy_j[index, -1] - aligned.energy_j[0, -1]))
    told = [f"{other.label} took {_more(more_s, 's', 0)} and {_more(more_kwh, 'kWh', 1)} than {first.label}."]
    if abs(more_s) < TOLD_S and abs(more_kwh) < TOLD_KWH:
        told = [f"{other.label} took the same time and energy as {first.label}."]
    if other.train != first.train:
        told.append(f"They are different trains: {first.train} and {other.train}.")
    elif other.inputs.vehicle.mass_kg != first.inputs.vehicle.mass_kg:
        told.append("They have the same train, but of another mass.")
    if not (first.measured and other.measured):
        told.append("Energies are estimated where no train measured them.")
    advised = aligned.first_different_advice(index)
    if advised is None:
        told.append("The advice was the same everywhere.")
    else:
        told.append(
            f"The advice differs first at {place(advised.s_m)}: {advised.first} in {first.label}, "
            f"{advised.other} in {other.label}."
        )
    return told
