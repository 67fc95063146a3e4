"""The figures of a run in closed loop, as tables."""

from __future__ import annotations

import shlex
from dataclasses import asdict
from typing import Final

from rich.table import Table

from das.command_line.printing import print_table, tell, typed
from das.domain.conditions import Conditions
from das.domain.units import kmh, kwh
from sim.drive.above_optimum import NOT_COMPARABLE
from sim.drive.calls import KeptCall, as_rows
from sim.drivers.cab import AT_STOP_M
from sim.drivers.kinds import DriverKind
from sim.recording.clock import minutes
from sim.world.outcome import SHARES, DayResult, shares

STOP_LEGEND: Final = {
    "due, arrived, departed": "minutes and seconds since the timetable's first departure",
    "missed": "by how much the train stood beyond the stop (before it: negative)",
}
"""What is said below the table of stops."""
TIMES: Final = ("due", "arrived", "departed")
"""Columns of times in the table of stops."""
LABELS: Final = {
    "component_loss": "component losses",
    "resistance": "running resistance",
    "friction_brake": "friction brake",
    "unreturned": "brake resistors",
    "comfort": "comfort systems",
}
"""Where the energy went, in words."""

UNCHANGED: Final = asdict(Conditions())
"""The conditions of a train and line that are as planned."""


def print_result(result: DayResult) -> None:
    """Print the stops, the figures, and what should be known about them."""
    print_table(_stops(result), STOP_LEGEND)
    table = Table(show_header=False)
    table.add_column()
    table.add_column(justify="right", no_wrap=True)
    for row in _rows(result):
        table.add_row(*row)
    print_table(table)
    for note in _notes(result):
        tell(f"note: {note}")
    for warning in result.warnings:
        tell(f"warning: {warning}")
    if result.recorded is not None:
        tell(f"written: {result.recorded.file}")
        tell(f"view it: {typed('das-sim')} view {shlex.quote(result.recorded.file)}")


def _stops(result: DayResult) -> Table:
    found = result.outcome
    title = f"{found.scenario}, seed {found.seed}, driver {result.driver}, advice {result.advice}"
    table = Table(title=title, title_justify="left")
    table.add_column("stop")
    for name in (*TIMES, "late", "missed"):
        table.add_column(name, justify="right")
    for call in as_rows(found.drive.calls):
        times = ("" if time_s is None else minutes(time_s) for time_s in (call[f"{one}_s"] for one in TIMES))
        missed = "" if call["arrived_s"] is None else f"{call['missed_m']:+.1f} m"
        table.add_row(call["name"], *times, f"{call['late_s']:+.0f} s", missed)
    return table


def _rows(result: DayResult) -> list[tuple[str, str]]:
    """Energies, where they went, and the messages."""
    found, energies = result.outcome, result.outcome.energies
    braking = "this driver" if result.driver is DriverKind.HUMAN else "advised"
    rows = [
        ("energy, departures to arrivals", f"{kwh(energies.driven_j):.1f} kWh"),
        ("  optimum of the plan", f"{kwh(energies.planned_j):.1f} kWh"),
        ("  optimum for the times as driven", f"{kwh(energies.optimum_as_driven_j):.1f} kWh"),
        ("  above that optimum", energies.above.words),
        ("    friction where motors could brake", f"{kwh(energies.blending_j):+.1f} kWh"),
        ("    speed profile", f"{kwh(energies.profile_j):+.1f} kWh"),
        (f"  optimum braking as {braking}", f"{kwh(energies.own_braking_j):.1f} kWh"),
    ]
    parts = shares(found.balance)
    rows += [(LABELS[name], f"{kwh(parts[name][0]):.1f} kWh  {100 * parts[name][1]:4.1f} %") for name in SHARES]
    counts, recorded = found.counts, result.recorded
    rows.append(("advices", f"{counts.advised} given, {counts.withdrawn} withdrawn, {counts.unheard} not heard"))
    rows += found.drive.stability.rows()
    if recorded is not None:
        rows.append(("messages recorded / lost", f"{recorded.messages_recorded} / {recorded.messages_lost}"))
    rows.append(("simulated", f"{found.simulated_s} s at {result.real_time_factor:.0f} × real time"))
    return rows


def _notes(result: DayResult) -> list[str]:
    """What should be known about the figures."""
    found, violations = result.outcome, result.outcome.drive.violations
    notes = [f"on this day: {result.happens}"]
    human = result.drawn["human"] if result.driver is DriverKind.HUMAN else {}
    if human:
        notes.append("the driver: " + ", ".join(f"{name} {value:.4g}" for name, value in human.items()))
    truth = {name: value for name, value in result.drawn["truth"].items() if value != UNCHANGED[name]}
    if truth:
        notes.append("the true train: " + ", ".join(f"{name} {value:.4g}" for name, value in truth.items()))
    notes += [_beyond(call) for call in found.drive.calls if call.missed_m > AT_STOP_M]
    if violations.signals_passed:
        beyond_m = violations.beyond_signal_m
        notes.append(f"signals passed at danger: {violations.signals_passed}, by up to {beyond_m:.0f} m")
    if violations.over_limit_s:
        over_kmh = kmh(violations.over_limit_mps)
        notes.append(f"{violations.over_limit_s:.0f} s above limits, by up to {over_kmh:.0f} km/h")
    if found.energies.above.why_not:
        notes.append(f"{NOT_COMPARABLE}: {found.energies.above.why_not}")
    if found.counts.above_limit:
        notes.append(f"{found.counts.above_limit} advices were above the limit: please report this")
    return notes


def _beyond(call: KeptCall) -> str:
    return f"the train came to stand {call.missed_m:.0f} m beyond {call.name}"
