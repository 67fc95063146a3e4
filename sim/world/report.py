"""The figures of a run in closed loop, as tables."""

from __future__ import annotations

import shlex
from dataclasses import asdict
from typing import Any, Final

from rich.table import Table

from das.command_line.printing import print_table, tell, typed
from das.domain.conditions import Conditions
from sim.drivers.cab import AT_STOP_M
from sim.world.outcome import SHARES

STOP_LEGEND: Final = {
    "due, arrived, departed": "minutes and seconds since the timetable's first departure",
    "missed": "by how much the train stood beyond the stop (before it: negative)",
}
"""What is said below the table of stops."""
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


def print_result(found: dict[str, Any]) -> None:
    """Print the stops, the figures, and what should be known about them."""
    print_table(_stops(found), STOP_LEGEND)
    table = Table(show_header=False)
    table.add_column()
    table.add_column(justify="right", no_wrap=True)
    for row in _rows(found):
        table.add_row(*row)
    print_table(table)
    for note in _notes(found):
        tell(f"note: {note}")
    if found["file"] is not None:
        tell(f"written: {found['file']}")
        tell(f"view it: {typed('das-sim')} view {shlex.quote(found['file'])}")


def _stops(found: dict[str, Any]) -> Table:
    title = f"{found['scenario']}, seed {found['seed']}, driver {found['driver']}, advice {found['advice']}"
    table = Table(title=title, title_justify="left")
    table.add_column("stop")
    for name in ("due", "arrived", "departed", "late", "missed"):
        table.add_column(name, justify="right")
    for stop in found["stops"]:
        table.add_row(
            stop["name"],
            _clock(stop["due_s"]),
            _clock(stop["arrived_s"]),
            _clock(stop["departed_s"]),
            f"{stop['late_s']:+.0f} s",
            "" if stop["arrived_s"] is None else f"{stop['missed_m']:+.1f} m",
        )
    return table


def _clock(time_s: float | None) -> str:
    """A time on the run's clock as minutes and seconds."""
    if time_s is None:
        return ""
    minutes, seconds = divmod(round(time_s), 60)
    return f"{minutes}:{seconds:02d}"


def _rows(found: dict[str, Any]) -> list[tuple[str, str]]:
    """Energies, where they went, and the messages."""
    beyond = found["beyond_hindsight_ratio"]
    rows = [
        ("energy, departures to arrivals", f"{found['energy_kwh']:.1f} kWh"),
        ("  optimum of the plan", f"{found['energy_planned_kwh']:.1f} kWh"),
        ("  optimum for the times as driven", f"{found['energy_hindsight_kwh']:.1f} kWh"),
        ("  beyond that optimum", "–" if beyond is None else f"{100 * beyond:+.1f} %"),
    ]
    for name in SHARES:
        rows.append((LABELS[name], f"{found[f'{name}_kwh']:.1f} kWh  {100 * found[f'{name}_ratio']:4.1f} %"))
    advices = f"{found['advices_given']} given, {found['advices_withdrawn']} withdrawn"
    rows.append(("advices", f"{advices}, {found['advices_unheard']} not heard"))
    if found["file"] is not None:
        rows.append(("messages recorded / lost", f"{found['messages_recorded']} / {found['messages_lost']}"))
    rows.append(("simulated", f"{found['simulated_s']} s at {found['real_time_factor']:.0f} × real time"))
    return rows


def _notes(found: dict[str, Any]) -> list[str]:
    """What should be known about the figures."""
    notes = [f"on this day: {found['happens']}"]
    human = found["drawn"]["human"] if found["driver"] == "human" else {}
    if human:
        notes.append("the driver: " + ", ".join(f"{name} {value:.4g}" for name, value in human.items()))
    truth = {name: value for name, value in found["drawn"]["truth"].items() if value != UNCHANGED[name]}
    if truth:
        notes.append("the true train: " + ", ".join(f"{name} {value:.4g}" for name, value in truth.items()))
    for stop in found["stops"]:
        if stop["missed_m"] > AT_STOP_M:
            notes.append(f"the train came to stand {stop['missed_m']:.0f} m beyond {stop['name']}")
    if found["signals_passed"]:
        notes.append(f"signals passed at danger: {found['signals_passed']}, by up to {found['beyond_signal_m']:.0f} m")
    if found["over_limit_s"]:
        notes.append(f"{found['over_limit_s']:.0f} s above limits, by up to {found['over_limit_kmh']:.0f} km/h")
    if found["hindsight_faster_than_possible"]:
        notes.append("a section took less time than the plan's train can: its optimum is the fastest run")
    if found["advices_above_limit"]:
        notes.append(f"{found['advices_above_limit']} advices were above the limit: please report this")
    return notes
