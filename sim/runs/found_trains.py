"""The trains that were tried on a trip, with the energy that each would have taken, as JSON and as a table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from rich.table import Table

from das.command_line.printing import new_table, print_table, tell
from das.domain.errors import DasError
from das.domain.units import TONNE, in_kwh
from das.domain.vehicle import Vehicle
from das.solver.section import Section
from sim.drive.above_optimum import NOT_COMPARABLE
from sim.options import TripOptions
from sim.runs.replay import compared_legs
from sim.runs.replay_figures import beside_optimum
from sim.trips.find_train import FoundTrain, find_train, shares
from sim.trips.report import part_words
from sim.trips.trip import Trip, section_with

TRAINS_LEGEND: Final = {
    "likely": "if one of them drove, all equally likely beforehand; no: it cannot have driven this record",
    "mass, resistance": "best fit, with one standard deviation; the resistance is a multiple of the file's",
    "beyond": "share of the time in which the train would need more effort than it has (unexplained)",
    "kWh, above": "energy as driven by the fitted train, and its excess over the optimum, also in % of the optimum",
}
"""Explanations that are printed below the table of trains."""


def described_trains(
    trip: Trip, trains: Sequence[tuple[str, Vehicle]], options: TripOptions
) -> tuple[list[dict[str, Any]], Section | None]:
    """Every train that was tried on a trip, for JSON, the likeliest first; and the section for that train as fitted.

    There is no section if no train can have made the trip, or none of them can run there. Energies and optima are those
    of the train with the mass and the resistance found. Raises DasError for a trip that is too short.
    """
    found = find_train(trip, trains)
    likely = shares(found)
    rows, first = [], None
    for one in found:
        section, why_not = None, one.why_not
        if one.possible:
            try:
                section = section_with(trip, one.fitted, options)
            except DasError as error:
                why_not = str(error)
        first = first or section
        rows.append({**_found(one, likely.get(one.names[0])), **_energies(trip, section, why_not)})
    return rows, first


def _found(one: FoundTrain, share: float | None) -> dict[str, Any]:
    return {
        "names": list(one.names),
        "vehicle": one.vehicle.name,
        "possible": one.possible,
        "why_not": one.why_not or None,
        "probability": share,
        "mass_t": one.mass_ratio * one.vehicle.mass_kg / TONNE,
        "mass_ratio": one.mass_ratio,
        "mass_sd": one.mass_sd,
        "mass_known": one.mass_known,
        "resistance_ratio": one.resistance_ratio,
        "resistance_sd": one.resistance_sd,
        "unexplained_ratio": one.beyond_ratio,
    }


def _energies(trip: Trip, section: Section | None, why_not: str) -> dict[str, Any]:
    if section is not None:
        try:
            _, above = beside_optimum(trip, section, compared_legs(trip, section))
            return {"compared_part": above.part or None, **above.as_dict()}
        except DasError as error:
            why_not = str(error).removeprefix(f"{trip.path}: {NOT_COMPARABLE}: ")
    names = ("compared_part", "energy_kwh", "energy_optimum_kwh", "above_optimum_kwh", "above_optimum_ratio")
    return {**dict.fromkeys(names), "not_comparable": why_not}


def print_trains(trains: list[dict[str, Any]]) -> None:
    """Print the table of the trains that were tried, and the notes on them."""
    print_table(trains_table(trains), TRAINS_LEGEND)
    for note in notes_on_trains(trains):
        tell(f"note: {note}")


def trains_table(trains: list[dict[str, Any]]) -> Table:
    """The table of the trains that were tried, the likeliest first."""
    figures = ("likely", "mass, t", "resistance", "beyond", "kWh", "above")
    table = new_table("which train it was", (), figures, whole=("train",), lines=True)
    for one in trains:
        names = "\n".join(Path(name).stem for name in one["names"])
        beyond = f"{100 * one['unexplained_ratio']:.0f} %"
        if not one["possible"]:
            table.add_row(names, "no", "", "", beyond, "", "")
            continue
        mass = f"{one['mass_t']:.0f} ± {one['mass_t'] / one['mass_ratio'] * one['mass_sd']:.0f}"
        resistance = f"{one['resistance_ratio']:.2f} ± {one['resistance_sd']:.2f}"
        driven, above = "", ""
        if one["above_optimum_kwh"] is not None:
            driven = in_kwh(one["energy_kwh"], finer=-1)
            above = (
                f"{in_kwh(one['above_optimum_kwh'], signed=True, finer=-1)} ({100 * one['above_optimum_ratio']:.0f} %)"
            )
        table.add_row(names, f"{100 * one['probability']:.0f} %", mass, resistance, beyond, driven, above)
    return table


def notes_on_trains(trains: list[dict[str, Any]]) -> list[str]:
    """Notes on the trains that were tried, one sentence each."""
    possible = [one for one in trains if one["possible"]]
    names = {id(one): Path(one["names"][0]).stem for one in trains}
    notes = [f"{names[id(one)]} cannot have driven this record: {one['why_not']}" for one in trains if one["why_not"]]
    if not possible:
        return [*notes, "none of these trains can have made this trip: try others"]
    if not possible[0]["mass_known"]:
        notes.append("the record contains little information on the mass: that needs full effort and long coasting")
    reasons: dict[str, list[str]] = {}
    for one in possible:
        if one["not_comparable"] is not None:
            reasons.setdefault(one["not_comparable"], []).append(names[id(one)])
    notes += [f"{NOT_COMPARABLE} with {', '.join(which)}: {why}" for why, which in reasons.items()]
    part = next((one["compared_part"] for one in possible if one["compared_part"] is not None), None)
    return notes if part is None else [*notes, part_words(part)]
