"""Reports on a trip: JSON for programs, tables and notes for people, and the cleaned record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import numpy as np
from rich.table import Table

from das.command_line.printing import print_table, tell
from das.domain.files.writing import write_whole
from das.domain.route import Floats
from das.domain.trajectory import PART_WORDS
from das.domain.units import KM, KMH, KN, MS, NS, in_kwh, kwh
from das.solver.section import Section
from sim.trips.cleaning import CleaningReport, FindingKind
from sim.trips.estimate import (
    ESTIMATE_FOREIGN_RATIO,
    ESTIMATE_HELD_S,
    MASS,
    RESISTANCE,
    SmoothedParts,
    Unknown,
    doubt,
    energy_range,
    estimate_run,
    strongest_held_n,
)
from sim.trips.profile import SMOOTHING_MAX_POSITION_GAP_S
from sim.trips.trip import Trip

LEGEND: Final = {"from, to": "least and greatest possible energy, with all unknowns at their limits"}
"""Explanations that are printed below the table of energies."""
COLUMNS = ("time_ms", "position_m", "speed_mps", "speed_from_positions", "latitude_deg", "longitude_deg")
_NS_PER_MS = round(MS / NS)


def describe(
    trip: Trip, section: Section | None, parts: SmoothedParts | None, compared_part: str = ""
) -> dict[str, Any]:
    """The content of a trip, for JSON (times in s, distances in m, energies in kWh at the current collector).

    Energies are given for its parts, without comfort systems: from stop to stop, or of the part of an open trip that is
    compared with an optimum, if there is one. Without a section, that is without a vehicle, `energy` is None.
    """
    run, report, (departed_ns, arrived_ns) = trip.run, trip.matched.report, trip.ran_ns
    return {
        "file": str(trip.path),
        "format": trip.format,
        "route": trip.route.name,
        "route_data": trip.route.credit,
        "reversed": trip.reversed,
        "direction_known": trip.direction_known,
        "from": trip.start.name,
        "to": trip.end.name,
        "whole_section": trip.whole,
        "departure": _iso(departed_ns),
        "trip_time_s": (arrived_ns - departed_ns) * NS,
        "distance_m": float(run.s_m[-1] - run.s_m[0]),
        "max_speed_kmh": run.top_mps / KMH,
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
        "compared_part": compared_part or None,
        "energy": None if section is None or parts is None else _energy(trip, section, parts),
        "not_known": _not_known(trip, section),
    }


def _stands(trip: Trip) -> list[dict[str, Any]]:
    """Every stand for JSON, with the running time since the last departure before it."""
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


def _energy(trip: Trip, section: Section, parts: SmoothedParts) -> dict[str, Any]:
    run = trip.run
    driven = estimate_run(section, run.time_s, run.s_m, run.speed_mps)
    spread = energy_range(section, parts, doubt(driven.beyond_ratio, driven.lacking_ratio))
    traction_n, braking_n = strongest_held_n(driven, run.inferred)
    terms = [estimate_run(section, *part).balance.as_kwh() for part in parts(1.0)]
    return {
        "vehicle": section.vehicle.name,
        "level": str(section.level),
        **{f"{'energy' if name == 'input' else name}_kwh": sum(one[name] for one in terms) for name in terms[0]},
        "energy_low_kwh": kwh(spread.low_j),
        "energy_high_kwh": kwh(spread.high_j),
        "unknowns": unknowns(spread.unknowns),
        "strongest_traction_kn": traction_n / KN,
        "strongest_braking_kn": braking_n / KN,
        "beyond_vehicle_ratio": driven.beyond_ratio,
    }


def unknowns(found: Sequence[Unknown]) -> list[dict[str, Any]]:
    """Each unknown with the energies at its ends, for JSON."""
    return [{"name": u.name, "assumed": u.assumed, "low_kwh": kwh(u.low_j), "high_kwh": kwh(u.high_j)} for u in found]


def doubt_words(assumed: Sequence[Mapping[str, Any]]) -> str:
    """A sentence on the ranges of a trip that needs more force than its train has, by its `unknowns`."""
    off = [f"a {one['name']} {one['assumed']}" for one in assumed if one["name"] in (MASS, RESISTANCE)]
    return (
        f"it may have been another train: the ranges are for {' and '.join(off)}, wider than for a known train by the "
        "share of the missing force"
    )


def _not_known(trip: Trip, section: Section | None) -> list[str]:
    """A sentence for each quantity that a record of positions leaves unknown, with figures if there are any."""
    notes = []
    if not trip.direction_known:
        notes.append(direction_by_posts(trip))
    steps_s = _steps_s(trip)
    unseen_s = float(steps_s[steps_s > SMOOTHING_MAX_POSITION_GAP_S].sum())
    if unseen_s > 0:
        share = unseen_s / max(float(trip.run.time_s[-1]), 1e-9)
        notes.append(
            f"the motion in gaps of {unseen_s:.0f} s in all ({100 * share:.0f} % of the run): "
            "bridged by inertia, and not used for highest values"
        )
    for step_s, what in ((steps_s[0], "departed"), (steps_s[-1], "arrived")):
        if step_s > SMOOTHING_MAX_POSITION_GAP_S:
            notes.append(f"when the train {what}: there is a gap next to that end of the run")
    if not trip.whole:
        better = f" (try {trip.better_stops})" if trip.better_stops else ""
        notes.append(f"the driving on the rest of the section: the trip does not stand at both its stops{better}")
    if section is None:
        return [*notes, "forces and energies: give a --vehicle, or find the train with --vehicles all"]
    notes += [
        "the true train and its load, the wind, and the blending of brakes: their ranges are in the table",
        "the energy of auxiliaries: the estimate uses those of the vehicle's file",
    ]
    comfort_w = section.vehicle.comfort_power_w
    if comfort_w > 0:
        added = kwh(comfort_w * float(trip.run.time_s[-1]))
        notes.append(
            f"the energy of comfort systems: at the vehicle's full {comfort_w / 1e3:.0f} kW {in_kwh(added)} kWh more"
        )
    return notes


def direction_by_posts(trip: Trip) -> str:
    """The sentence that kilometre posts do not show the direction, and how the user can state it."""
    turned = any(f.kind == FindingKind.OTHER_WAY for f in trip.matched.report.cleaning.findings)
    posts = "turn the list of posts round and " if turned else ""
    right, wrong = ("--reverse", "--no-reverse") if trip.reversed else ("--no-reverse", "--reverse")
    return (
        f"kilometre posts do not show the direction of the trip: {trip.start.name} to {trip.end.name} is assumed; "
        f"{posts}give {right} if it is so, {wrong} if not"
    )


def part_words(part: str) -> str:
    """A sentence on the part of an open trip that is compared; `part` has its ends."""
    return (
        f"the trip does not stand at both its stops: the energies are those of its longest part between equal speeds, "
        f"{part}, compared with an optimum with the same speeds there"
    )


def _steps_s(trip: Trip) -> Floats:
    """Times (s) between the points of the run."""
    matched = trip.matched
    moving = slice(matched.ends.departure, matched.ends.arrival + 1)
    return np.diff(matched.elapsed_s()[moving][~matched.invalid[moving]])


def _iso(time_ns: int) -> str:
    """A time (ns) as UTC text, to the second."""
    return f"{datetime.fromtimestamp(round(time_ns * NS), UTC):%Y-%m-%d %H:%M:%S}"


def print_description(found: dict[str, Any], report: CleaningReport) -> None:
    """Print the tables and notes of `das-sim trip`."""
    tell(f"{found['format']}, {found['route']}: {found['from']} – {found['to']}")
    print_table(cleaning_table(report))
    print_table(_matching_table(found))
    print_table(_stands_table(found["stands"]))
    if found["energy"] is not None:
        print_table(_energy_table(found["energy"]), LEGEND)
    if found["compared_part"] and not found.get("trains"):
        tell(f"note: {part_words(found['compared_part'])}")
    for note in found["not_known"]:
        tell(f"not known: {note}")
    if not found.get("trains") and found["energy"] and found["energy"]["beyond_vehicle_ratio"] > ESTIMATE_FOREIGN_RATIO:
        share = 100 * found["energy"]["beyond_vehicle_ratio"]
        tell(f"note: in {share:.0f} % of the time the trip needs more force than this vehicle has")
        tell(f"note: {doubt_words(found['energy']['unknowns'])}")


def cleaning_table(report: CleaningReport) -> Table:
    """The table of cleaning, one row for each kind of finding."""
    table = Table(title=f"cleaning: {report.kept} of {report.read} points kept", title_justify="left")
    for name, right in (("count", True), ("finding", False), ("action", False), ("first at", False), ("detail", False)):
        table.add_column(name, justify="right" if right else "left")
    for f in report.findings:
        table.add_row(str(f.count), f.kind.words, f.kind.done, f"{f.first}, {f.first_time[11:]}", f.detail)
    if not report.findings:
        table.add_row("0", "nothing to clean", "", "", "")
    if report.unread:
        table.caption = f"columns not read: {', '.join(report.unread)}"
    return table


def _matching_table(found: dict[str, Any]) -> Table:
    table = Table(title="trip", title_justify="left", show_header=False)
    matching = found["matching"]
    table.add_row("departure (UTC)", found["departure"])
    table.add_row("time, distance", f"{found['trip_time_s']:.0f} s, {found['distance_m'] / KM:.2f} km")
    table.add_row("highest speed", f"{found['max_speed_kmh']:.0f} km/h")
    if matching["median_m"] is not None:
        figures = " / ".join(f"{matching[name]:.1f}" for name in ("median_m", "p95_m", "max_m"))
        table.add_row("distance from the line, median / 95 % / most", f"{figures} m")
    anchored = {
        "route": "the route's geometry",
        "stops": "coordinates of the route's stops",
        "positions": "positions of the record",
    }
    anchor = anchored.get(matching["anchor"], f"stands at {matching['anchor']}, scale {matching['scale']:.5f}")
    table.add_row("position from", anchor)
    if matching["stand_uncertainty_m"] > 0:
        table.add_row("stands at the ends known to", f"{matching['stand_uncertainty_m']:.1f} m")
    table.add_row("deviation from the smoothed run, RMS", f"{matching['along_rms_m']:.1f} m")
    table.add_row("lag of the reported speed", f"{matching['speed_lag_s']:.2f} s")
    if found["route_data"]:
        table.add_row("data of the line", found["route_data"])
    return table


def _stands_table(stands: list[dict[str, Any]]) -> Table:
    table = Table(title="stops", title_justify="left")
    for name in ("stop", "km", "off by", "arrival", "departure", "stood", "running time"):
        table.add_column(name, justify="left" if name == "stop" else "right")
    for s in stands:
        table.add_row(
            s["stop"] or "on the line",
            f"{s['position_m'] / KM:.3f}",
            "" if s["off_m"] is None else f"{round(s['off_m'])} m",
            "" if s["arrival"] is None else s["arrival"][11:19],
            "" if s["departure"] is None else s["departure"][11:19],
            "" if s["dwell_s"] is None else f"{s['dwell_s']:.0f} s",
            "" if s["running_time_s"] is None else f"{s['running_time_s']:.0f} s",
        )
    return table


def _energy_table(energy: dict[str, Any]) -> Table:
    title = f"energy as driven, estimated: {energy['vehicle']}, level {energy['level']}"
    table = Table(title=title, title_justify="left")
    for name in ("kWh at the current collector", "estimate", "from", "to"):
        table.add_column(name, justify="left" if "kWh" in name else "right")
    low, high = energy["energy_low_kwh"], energy["energy_high_kwh"]
    table.add_row("net input", in_kwh(energy["energy_kwh"]), in_kwh(low), in_kwh(high))
    for u in energy["unknowns"]:
        table.add_row(f"  by {u['name']} ({u['assumed']})", "", in_kwh(u["low_kwh"]), in_kwh(u["high_kwh"]))
    for name, words in PART_WORDS.items():
        share = in_kwh(energy[f"{name}_kwh"])
        if float(share):  # A part that rounds to 0 is not shown.
            table.add_row(f"  of which {words}", share, "", "")
    table.add_row(
        f"strongest traction / braking held for {ESTIMATE_HELD_S} s, kN",
        f"{energy['strongest_traction_kn']:.0f}",
        "",
        f"{energy['strongest_braking_kn']:.0f}",
    )
    return table


def write_cleaned(path: Path, trip: Trip) -> None:
    """Write the points that cleaning kept, with positions as in the route's file, to 1 µm.

    Points that a recording calls invalid are left out. Raises DasError if the file cannot be written.
    """
    matched = trip.matched
    s_m = trip.route.length_m - matched.s_m if trip.reversed else matched.s_m
    lines = [",".join(COLUMNS)]
    for i in np.flatnonzero(~matched.invalid):
        cells = (
            _milliseconds(int(matched.time_ns[i])),
            f"{round(s_m[i], 6) + 0.0:.6f}",
            f"{matched.speed_mps[i]:.6f}",
            f"{matched.dropout[i]:d}",
            _degrees(matched.latitude_deg[i]),
            _degrees(matched.longitude_deg[i]),
        )
        lines.append(",".join(cells))
    write_whole(path, ("\n".join(lines) + "\n").encode())


def _milliseconds(time_ns: int) -> str:
    """A time (ns) in ms: whole milliseconds and, if there is one, their fraction digit by digit."""
    whole, rest = divmod(time_ns, _NS_PER_MS)
    return f"{whole}.{rest:06d}".rstrip("0") if rest else f"{whole}"


def _degrees(angle: float) -> str:
    return "" if np.isnan(angle) else repr(float(angle))
