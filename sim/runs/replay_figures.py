"""The figures of a replay: energies compared with the optimum, all figures for JSON, and the table."""

from __future__ import annotations

import math
import shlex
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rich.table import Table

from das.command_line.printing import print_table, tell, typed
from das.domain.errors import DasError
from das.domain.units import NS, in_kwh, kwh
from das.solver.section import Section
from das.solver.solution import Fit
from sim.drive.above_optimum import NOT_COMPARABLE, AboveOptimum, EnergyBand, known_kwh, percent_of_optimum
from sim.drive.legs import ComparedLeg, LikelyRange, Smoothed, beside_optima, likely_range
from sim.recording.opening import DriveInputs
from sim.runs.replay import TICK_S, ReplayJob, ReplayOutcome, compared_legs, parts_of, smoothed_legs
from sim.trips.cleaning import FindingKind
from sim.trips.estimate import ESTIMATE_FOREIGN_RATIO, EnergyRange, doubt, energy_range
from sim.trips.report import direction_by_posts, doubt_words, part_words, unknowns
from sim.trips.trip import Trip

LEAST_CERTAIN_RATIO = 0.01
"""Share of the optimum below which an energy above it is within the error of inverse dynamics, which finds 0.5 % for a
driver who drove the optimum."""

TIMETABLE_FIGURES = (
    "timetable_time_left_s", "timetable_fit", "timetable_late_s", "timetable_energy_kwh", "departed_late_s", "late_s",
)  # fmt: skip
"""The figures of a replay that depend on its timetable; each is None without one."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TripEnergies:
    """The energies of a replayed trip and of the optimum with the same arrivals, leg by leg.

    `energy` and `likely` are the ranges of the energy as driven and of the energy above the optimum; `likely` is None
    if trip and optimum cannot be compared.
    """

    legs: tuple[ComparedLeg, ...]
    above: AboveOptimum
    energy: EnergyRange
    likely: LikelyRange | None


def trip_energies(job: ReplayJob) -> TripEnergies:
    """The energies of the trip of a replay, with their ranges."""
    trip, section = job.trip, job.front.section
    try:
        smoothed = compared_legs(trip, section)
        legs, above = beside_optimum(trip, section, smoothed)
    except DasError as error:  # no part of an open trip can be compared with this train
        smoothed = smoothed_legs(trip)
        legs = tuple(ComparedLeg.of(leg, job.front) for leg in job.legs)
        why_not = str(error).removeprefix(f"{trip.path}: {NOT_COMPARABLE}: ")
        above = AboveOptimum(sections=tuple(one.section_energy for one in legs), measured=False, why_not=why_not)
    likely = None if above.why_not else likely_range(legs, smoothed)
    if likely is not None:
        above = replace(above, likely=EnergyBand(likely.low_j, likely.high_j))
    energy = energy_range(section, parts_of(smoothed), doubt(job.driven.beyond_ratio, job.driven.lacking_ratio))
    return TripEnergies(legs=legs, above=above, energy=energy, likely=likely)


def beside_optimum(trip: Trip, section: Section, smoothed: Smoothed) -> tuple[tuple[ComparedLeg, ...], AboveOptimum]:
    """The legs of a trip with their optima, and its energy above the optimum, for the train of a section.

    `smoothed` returns the legs, as `compared_legs` finds them. Raises DasError if the train cannot run there.
    """
    vehicle = replace(section.vehicle, train_length_m=section.train_length_m)
    inputs = DriveInputs(route=trip.route, vehicle=vehicle, level=section.level, source=str(trip.path))
    legs = beside_optima(inputs, smoothed(1.0))
    sections = [one.section_energy for one in legs]
    return legs, AboveOptimum.of(sections, measured=False, direction_known=trip.direction_known)


def result(job: ReplayJob, outcome: ReplayOutcome, energies: TripEnergies) -> dict[str, Any]:
    """The replay's figures (times in s, energies in kWh at the current collector, without comfort systems).

    `energy_optimum_kwh` is the least energy for the same arrival as driven (that of the fastest trajectory if the train
    cannot arrive so early). `above_optimum_*` are None if trip and optimum cannot be compared; `likely_above_optimum`
    states whether all of the likely range is above the optimum. `timetable_*` are for the arrival by the timetable.
    """
    trip, traffic = job.trip, outcome.traffic
    return {
        "from": trip.start.name,
        "to": trip.end.name,
        "compared_part": energies.above.part or None,
        "trip_time_s": (job.arrived_ns - job.departed_ns) * NS,
        "whole_section": trip.whole,
        "direction_known": trip.direction_known,
        "direction_note": None if trip.direction_known else direction_by_posts(trip),
        "better_stops": trip.better_stops,
        "stops_on_the_way": list(trip.stops_on_the_way),
        "advices": traffic.ticks,
        "advices_given": traffic.counts.advised,
        "advices_withdrawn": traffic.counts.withdrawn,
        "advices_above_limit": traffic.counts.above_limit,
        **_energies(job, energies),
        **_timetable(job, energies),
        **_messages(outcome),
        **_matching(trip),
        "file": str(job.processes.out),
    }


def _energies(job: ReplayJob, found: TripEnergies) -> dict[str, Any]:
    energy, above, likely = found.energy, found.above, found.likely
    friction_j = None if likely is None or math.isnan(likely.by_friction_j) else likely.by_friction_j
    return {
        "min_time_s": sum(one.optimum.least_time_s for one in found.legs),
        "energy_low_kwh": kwh(energy.low_j),
        "energy_high_kwh": kwh(energy.high_j),
        "energy_unknowns": unknowns(energy.unknowns),
        "optimum_time_s": sum(one.optimum.time_s for one in found.legs),
        "driving_time_s": sum(one.leg.trip_s for one in found.legs),
        "optimum_fit": str(Fit.LATE if above.too_fast else found.legs[0].optimum.fit),
        **above.as_dict(),
        "above_optimum_likely_low_kwh": None if likely is None else kwh(likely.low_j),
        "above_optimum_likely_high_kwh": None if likely is None else kwh(likely.high_j),
        "above_optimum_by_friction_kwh": known_kwh(friction_j),
        "likely_above_optimum": likely is not None and likely_above(likely, above.optimum_j),
        "above_optimum_unknowns": [] if likely is None else unknowns(likely.unknowns),
        "sections": _sections(found),
        "beyond_vehicle_ratio": job.driven.beyond_ratio,
    }


def _sections(found: TripEnergies) -> list[dict[str, Any]]:
    return [
        {
            "from": one.start,
            "to": one.end,
            "trip_s": one.trip_s,
            "energy_kwh": kwh(one.driven_j),
            "energy_optimum_kwh": kwh(one.optimum_j),
            "optimum_fit": str(leg.optimum.fit),
        }
        for one, leg in zip(found.above.sections, found.legs, strict=True)
    ]


def _timetable(job: ReplayJob, found: TripEnergies) -> dict[str, Any]:
    if job.timing.own:
        return dict.fromkeys(TIMETABLE_FIGURES)
    left_s = (job.timing.arrival_ns - job.departed_ns) * NS
    front = found.legs[0].front if len(found.legs) == 1 else job.front
    wanted = front.trajectory(max(left_s, 1e-3))
    arrived = bool(job.legs[-1].end.arrived_ns)
    values = (
        left_s,
        str(wanted.fit),
        max(wanted.time_s - left_s, 0.0) if wanted.fit is Fit.LATE else 0.0,
        kwh(wanted.balance.input),
        (job.departed_ns - job.timing.departure_ns) * NS,
        (job.arrived_ns - job.timing.arrival_ns) * NS if arrived else None,
    )
    return dict(zip(TIMETABLE_FIGURES, values, strict=True))


def _messages(outcome: ReplayOutcome) -> dict[str, Any]:
    traffic = outcome.traffic
    return {
        **traffic.as_dict(),
        "replay_s": outcome.replay_s,
        "real_time_factor": traffic.ticks * TICK_S / outcome.replay_s if outcome.replay_s > 0 else None,
    }


def _matching(trip: Trip) -> dict[str, Any]:
    report = trip.matched.report
    return {
        "map_anchor": report.anchor,
        "map_stand_uncertainty_m": report.stand_uncertainty_m,
        "map_scale": report.scale,
        "map_median_cross_track_m": report.median_cross_track_m,
        "map_p95_cross_track_m": report.p95_cross_track_m,
        "map_max_cross_track_m": report.max_cross_track_m,
        "gps_dropout_points": int(np.count_nonzero(trip.matched.dropout)),
        "cleaning": report.cleaning.as_object(),
        "cleaning_summary": report.cleaning.summary,
        "gps_speed_lag_s": trip.run.speed_lag_s,
        "position_rms_m": trip.run.position_rms_m,
    }


def likely_above(likely: LikelyRange, optimum_j: float) -> bool:
    """Whether the trip took more than the optimum at the lower end of its likely range, or if friction alone braked."""
    return float(np.fmin(likely.low_j, likely.by_friction_j)) > LEAST_CERTAIN_RATIO * optimum_j


def print_result(found: dict[str, Any]) -> None:
    """Print the table at the end of a replay, with notes on its figures."""
    table = Table(title="replay", title_justify="left", show_header=False)
    table.add_column(no_wrap=True)
    table.add_column(justify="right", no_wrap=True)
    for name, value in figure_rows(found):
        table.add_row(name, value)
    print_table(table)
    for note in notes(found):
        tell(f"note: {note}")
    tell(f"written: {found['file']}")
    tell(f"view it: {typed('das-sim')} view {shlex.quote(found['file'])}")


def figure_rows(found: dict[str, Any]) -> list[tuple[str, str]]:
    """Name and value of every row of the table."""
    late = found["optimum_fit"] == Fit.LATE
    return [
        ("trip time", f"{found['trip_time_s']:.0f} s"),
        *late_rows(found),
        ("least possible time", f"{found['min_time_s']:.0f} s"),
        ("advice messages sent", f"{found['advices']} ({found['advices_withdrawn']} withdrawn)"),
        ("energy as driven (estimated)", f"{in_kwh(found['energy_kwh'])} kWh"),
        (
            "  possible range",
            f"{in_kwh(found['energy_low_kwh'], finer=-1)} to {in_kwh(found['energy_high_kwh'], finer=-1)} kWh",
        ),
        (
            f"energy of {'its fastest run' if late else 'the optimum, same arrival'}",
            f"{in_kwh(found['energy_optimum_kwh'])} kWh",
        ),
        *above_rows(found),
        *section_rows(found),
        ("messages recorded / lost", f"{found['messages_recorded']} / {found['messages_lost']}"),
        ("replayed at", f"{found['real_time_factor']:.0f} × real time"),
    ]


def late_rows(found: dict[str, Any]) -> list[tuple[str, str]]:
    """The rows on the lateness of departure and arrival, if the trip had a timetable."""
    lates = (("departed", found["departed_late_s"]), ("arrived", found["late_s"]))
    return [(f"{what} late (early < 0)", f"{late_s:.0f} s") for what, late_s in lates if late_s is not None]


def section_rows(found: dict[str, Any]) -> list[tuple[str, str]]:
    """The sections of a trip with stops on the way; for a trip without, the optimum for the timetable."""
    if len(found["sections"]) < 2:
        energy_kwh = found["timetable_energy_kwh"]
        return (
            [] if energy_kwh is None else [("energy of the optimum, arrival by timetable", f"{in_kwh(energy_kwh)} kWh")]
        )
    return [
        (
            f"  {one['from']} – {one['to']}",
            f"{in_kwh(one['energy_kwh'])} kWh, optimum {in_kwh(one['energy_optimum_kwh'])} kWh",
        )
        for one in found["sections"]
    ]


def above_rows(found: dict[str, Any]) -> list[tuple[str, str]]:
    """The rows about the energy above the optimum, with a figure only if all of its likely range is above 0."""
    doubted = found["beyond_vehicle_ratio"] > ESTIMATE_FOREIGN_RATIO
    what = "above the optimum, if it was this train" if doubted else "above the optimum"
    if found["above_optimum_kwh"] is None:
        return [(what, NOT_COMPARABLE)]
    ratio = found["above_optimum_ratio"]
    share = "" if ratio is None else f" ({percent_of_optimum(ratio)})"
    certain = (
        f"{in_kwh(found['above_optimum_kwh'], signed=True)} kWh{share}"
        if found["likely_above_optimum"]
        else "perhaps nothing"
    )
    low, high = (in_kwh(found[f"above_optimum_likely_{end}_kwh"], finer=-1) for end in ("low", "high"))
    rows = [(what, certain), ("  likely", f"{low} to {high} kWh")]
    friction = found["above_optimum_by_friction_kwh"]
    return rows if friction is None else [*rows, ("  if friction alone braked", f"{in_kwh(friction, finer=-1)} kWh")]


def notes(found: dict[str, Any]) -> list[str]:
    """Notes on the figures, one sentence each."""
    return [*_notes_of_figures(found), *_notes_of_trip(found)]


def _notes_of_figures(found: dict[str, Any]) -> list[str]:
    notes = []
    if found["compared_part"] is not None:
        notes.append(part_words(found["compared_part"]))
    if found["not_comparable"] is not None:
        notes.append(f"{NOT_COMPARABLE}: {found['not_comparable']}")
    if found["timetable_fit"] == Fit.LATE:
        late = found["timetable_late_s"]
        notes.append(f"the timetable's arrival is earlier than possible: the fastest run is {late:.1f} s late")
    if not found["whole_section"] and found["better_stops"]:
        notes.append(f"other stops may fit the trip: try {found['better_stops']}")
    if found["stops_on_the_way"]:
        names = ", ".join(found["stops_on_the_way"])
        notes.append(f"the train stood at {names} on the way: it is compared section by section with the same stands")
    if found["beyond_vehicle_ratio"] > ESTIMATE_FOREIGN_RATIO:
        share = 100 * found["beyond_vehicle_ratio"]
        notes.append(
            f"in {share:.0f} % of the time the trip needs more force than this vehicle has: das-sim trip finds other "
            "trains (--vehicles all)"
        )
        notes.append(doubt_words(found["energy_unknowns"]))
    if found["above_optimum_kwh"] is not None and not found["likely_above_optimum"]:
        notes.append("at the lower end of the likely range it took no more than the optimum, or only slightly more")
    if found["direction_note"]:
        notes.append(found["direction_note"])
    if found["advices_above_limit"]:
        notes.append(f"{found['advices_above_limit']} advice messages were above the limit: please report this")
    return notes


def _notes_of_trip(found: dict[str, Any]) -> list[str]:
    notes = []
    if found["map_stand_uncertainty_m"] > 0:
        beyond_m = found["map_stand_uncertainty_m"]
        notes.append(f"only positions show that it stood at the record's ends: up to {beyond_m:.1f} m beyond them")
    if found["map_anchor"] in ("start", "end"):
        notes.append(f"the kilometrage is anchored at the {found['map_anchor']} only (lengths differ by over 1 %)")
    for finding in found["cleaning"]["findings"]:
        if finding["kind"] == FindingKind.OTHER_WAY:
            notes.append(f"the trip runs in the other direction, and was replayed so: {finding['detail']}")
    if found["cleaning"]["findings"]:
        notes.append(f"the trip was cleaned: {found['cleaning_summary']}")
    return notes
