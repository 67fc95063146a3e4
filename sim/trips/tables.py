"""What is in a trip, as tables and notes for people."""

from __future__ import annotations

from typing import Any, Final

from rich.table import Table

from das.command_line.printing import print_table, tell
from das.domain.units import KM
from sim.trips.findings import CleaningReport
from sim.trips.settings import ESTIMATE

LEGEND: Final = {
    "from, to": "what the energy may have been at least and at most, whatever the unknowns are",
}
"""What is said below the table of energies."""

LEDGER_WORDS = {
    "resistance": "running resistance",
    "component_loss": "losses of the train and auxiliaries",
    "friction_brake": "friction brake",
    "unreturned": "braked, but not taken back by the line",
    "kinetic": "speed gained from start to end",
    "potential": "height gained from start to end",
}
"""The shares of a ledger in words; shares that round to 0 are not shown."""


def print_description(found: dict[str, Any], report: CleaningReport) -> None:
    """Print the tables and notes of `das-sim trip`."""
    tell(f"{found['format']}, {found['route']}: {found['from']} – {found['to']}")
    print_table(cleaning_table(report))
    print_table(_matching_table(found))
    print_table(_stands_table(found["stands"]))
    if found["energy"] is not None:
        print_table(_energy_table(found["energy"]), LEGEND)
    if found["line_not_used"]:
        tell(f"note: {found['line_not_used']}")
    for note in found["not_known"]:
        tell(f"not known: {note}")
    if found["energy"] is not None and found["energy"]["beyond_vehicle_ratio"] > ESTIMATE.foreign_ratio:
        share = 100 * found["energy"]["beyond_vehicle_ratio"]
        tell(f"note: in {share:.0f} % of the time the trip asks more force than this vehicle has")


def cleaning_table(report: CleaningReport) -> Table:
    """What was cleaned, kind by kind."""
    table = Table(title=f"cleaning: {report.kept} of {report.read} points kept", title_justify="left")
    for name, right in (("count", True), ("what", False), ("done", False), ("first at", False), ("seen", False)):
        table.add_column(name, justify="right" if right else "left")
    for f in report.findings:
        table.add_row(str(f.count), f.told.words, f.told.done, f"{f.first}, {f.first_time[11:]}", f.detail)
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
    anchored = {"route": "the route's geometry", "positions": "positions of the record"}
    anchor = anchored.get(matching["anchor"], f"stands at {matching['anchor']}, scale {matching['scale']:.5f}")
    table.add_row("position from", anchor)
    if matching["stand_uncertainty_m"] > 0:
        table.add_row("stands at the ends known to", f"{matching['stand_uncertainty_m']:.1f} m")
    table.add_row("record against its smooth run, RMS", f"{matching['along_rms_m']:.1f} m")
    table.add_row("reported speed comes late by", f"{matching['speed_lag_s']:.2f} s")
    return table


def _stands_table(stands: list[dict[str, Any]]) -> Table:
    table = Table(title="where it stood", title_justify="left")
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
    low, high = energy["input_low_kwh"], energy["input_high_kwh"]
    table.add_row("net input", f"{energy['input_kwh']:.1f}", f"{low:.1f}", f"{high:.1f}")
    for u in energy["unknowns"]:
        table.add_row(f"  by {u['name']} ({u['assumed']})", "", f"{u['low_kwh']:.1f}", f"{u['high_kwh']:.1f}")
    for name, words in LEDGER_WORDS.items():
        share = f"{energy[f'{name}_kwh']:z.1f}"
        if float(share):
            table.add_row(f"  of it {words}", share, "", "")
    table.add_row(
        f"strongest traction / braking held for {ESTIMATE.held_s} s, kN",
        f"{energy['strongest_traction_kn']:.0f}",
        "",
        f"{energy['strongest_braking_kn']:.0f}",
    )
    return table
