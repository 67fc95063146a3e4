"""What is in a trip, as an object: cleaning, matching, stands, energies, and what cannot be known."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import numpy as np

from das.domain.units import KMH, KN, NS, kwh
from das.solver.section import Section
from sim.trips.estimate import EnergyRange, energy_range, estimate_run, strongest_held_n
from sim.trips.findings import FindingKind
from sim.trips.settings import SMOOTHING
from sim.trips.trip import Trip


def describe(trip: Trip, section: Section | None) -> dict[str, Any]:
    """What is in a trip, as an object (times in s, distances in m, energies in kWh at the current collector).

    Energies are without comfort systems. Without a section, that is without a vehicle, there are no energies.
    """
    run, report = trip.run, trip.matched.report
    return {
        "file": str(trip.path),
        "format": trip.format,
        "route": trip.route.name,
        "reversed": trip.reversed,
        "direction_known": trip.direction_known,
        "line_not_used": line_not_used(trip),
        "from": trip.start.name,
        "to": trip.end.name,
        "whole_section": trip.whole,
        "departure": _iso(run.start_time_ns),
        "trip_time_s": float(run.time_s[-1]),
        "distance_m": float(run.s_m[-1] - run.s_m[0]),
        "max_speed_kmh": float(run.speed_mps.max() / KMH),
        "cleaning": report.cleaning.as_object(),
        "cleaning_summary": report.cleaning.summary,
        "matching": {
            "anchor": report.anchor,
            "stand_uncertainty_m": report.stand_uncertainty_m,
            "scale": report.scale,
            "offset_m": report.offset_m,
            "median_m": report.median_cross_track_m,
            "p95_m": report.p95_cross_track_m,
            "max_m": report.max_cross_track_m,
            "along_rms_m": run.position_rms_m,
            "speed_lag_s": run.speed_lag_s,
        },
        "stands": _stands(trip),
        "energy": None if section is None else _energy(trip, section),
        "not_known": _not_known(trip, section),
    }


def _stands(trip: Trip) -> list[dict[str, Any]]:
    """Every stand, with the running time since the departure before."""
    rows: list[dict[str, Any]] = []
    left_ns = None
    for stand in trip.stands:
        running = None if left_ns is None or stand.arrival_ns is None else (stand.arrival_ns - left_ns) * NS
        rows.append(
            {
                "stop": stand.stop,
                "position_m": stand.s_m,
                "off_m": stand.off_m,
                "arrival": None if stand.arrival_ns is None else _iso(stand.arrival_ns),
                "departure": None if stand.departure_ns is None else _iso(stand.departure_ns),
                "dwell_s": stand.dwell_s,
                "running_time_s": running,
            }
        )
        left_ns = stand.departure_ns
    return rows


def _energy(trip: Trip, section: Section) -> dict[str, Any]:
    run = trip.run
    driven = estimate_run(section, run.time_s, run.s_m, run.speed_mps)
    spread = energy_range(section, trip.matched)
    traction_n, braking_n = strongest_held_n(driven)
    ledger = {name: kwh(value) for name, value in vars(driven.ledger).items()}
    return {
        "vehicle": section.vehicle.name,
        "level": str(section.level),
        **{f"{name}_kwh": value for name, value in ledger.items()},
        "input_low_kwh": kwh(spread.low_j),
        "input_high_kwh": kwh(spread.high_j),
        "unknowns": unknowns(spread),
        "strongest_traction_kn": traction_n / KN,
        "strongest_braking_kn": braking_n / KN,
        "beyond_vehicle_ratio": driven.beyond_ratio,
    }


def unknowns(spread: EnergyRange) -> list[dict[str, Any]]:
    """Each unknown with the energies at its ends, for JSON."""
    return [
        {"name": u.name, "assumed": u.assumed, "low_kwh": kwh(u.low_j), "high_kwh": kwh(u.high_j)}
        for u in spread.unknowns
    ]


def _not_known(trip: Trip, section: Section | None) -> list[str]:
    """What no record of positions tells, a sentence each, with figures where there are any."""
    notes = []
    if not trip.direction_known:
        notes.append(direction_by_posts(trip))
    unseen_s = _unseen_s(trip)
    if unseen_s > 0:
        share = unseen_s / max(float(trip.run.time_s[-1]), 1e-9)
        notes.append(
            f"what happened in gaps of {unseen_s:.0f} s in all ({100 * share:.0f} % of the run): inertia leads through"
        )
    if not trip.whole:
        better = f" (try {trip.better_stops})" if trip.better_stops else ""
        notes.append(f"how the rest of the section was driven: the trip does not stand at both its stops{better}")
    if section is None:
        return [*notes, "forces and energies: give a --vehicle"]
    notes += [
        "the true train and its load, the wind, and how brakes were blended: their ranges are in the table",
        "what auxiliaries drew: those of the vehicle's file are in the estimate",
    ]
    comfort_w = section.vehicle.comfort_power_w
    if comfort_w > 0:
        added = kwh(comfort_w * float(trip.run.time_s[-1]))
        notes.append(
            f"whether comfort systems ran: at the vehicle's full {comfort_w / 1e3:.0f} kW {added:.1f} kWh more"
        )
    return notes


def direction_by_posts(trip: Trip) -> str:
    """A sentence that says what kilometre posts leave open, and how the user can settle it."""
    turned = any(f.kind == FindingKind.OTHER_WAY for f in trip.matched.report.cleaning.findings)
    posts = "turn the list of posts round and " if turned else ""
    right, wrong = ("--reverse", "--no-reverse") if trip.reversed else ("--no-reverse", "--reverse")
    return (
        f"kilometre posts do not tell which way the trip ran: {trip.start.name} to {trip.end.name} is taken; "
        f"{posts}give {right} if it is so, {wrong} if not"
    )


def line_not_used(trip: Trip) -> str | None:
    """A sentence that says why kilometre posts were not needed; None if they were."""
    if trip.line_not_used is None:
        return None
    return f"--line {trip.line_not_used} is not used: {trip.path} has positions on the route"


def _unseen_s(trip: Trip) -> float:
    """Time between points of the run that are far apart."""
    matched = trip.matched
    moving = slice(matched.ends.departure, matched.ends.arrival + 1)
    steps = np.diff(matched.elapsed_s()[moving][~matched.invalid[moving]])
    return float(steps[steps > SMOOTHING.max_position_gap_s].sum())


def _iso(time_ns: int) -> str:
    """A time (ns) as UTC text, to the second."""
    return f"{datetime.fromtimestamp(round(time_ns * NS), UTC):%Y-%m-%d %H:%M:%S}"
