"""A recording in words: the text beside the plots."""

from __future__ import annotations

from datetime import UTC, datetime
from textwrap import wrap

from das.bus import topics
from das.bus.recording import Recording
from das.domain.units import KM, NS, kwh
from sim.drive.drive import Drive
from sim.world.disturbances import NOTHING

LETTERS = 150
"""Most letters in a line under the headline of a picture."""


def summary(drive: Drive, filled_from: str = "") -> str:
    """A short Markdown text: train, route, trip, inputs and whatever metadata the recorder wrote.

    `filled_from` says what is estimated because it was not recorded.
    """
    recording = drive.recording
    lines = [f"### Train {recording.train}", ""]
    if not recording.complete:
        lines += ["**This recording was cut off; it holds what was written before.**", ""]
    lines += [f"**Damaged: {one}.**\n" for one in recording.health.damage]
    lines += [f"**{filled_from[0].upper()}{filled_from[1:]}.**\n"] if filled_from else []
    if len(recording.trains) > 1:
        lines += [f"Also recorded, not shown: {', '.join(recording.trains[1:])}", ""]
    lines += _table("Trip", _trip(drive))
    for name, entries in recording.metadata.items():
        lines += _table(name.capitalize(), [readable(key, value) for key, value in entries.items()])
    return "\n".join(lines)


def headline(drive: Drive) -> str:
    """One line: train, what was run, where, how long and with how much energy, as far as it is known."""
    recording = drive.recording
    run = recording.metadata.get("run", {})
    told = [f"{key} {run[key]}" for key in ("driver", "advice", "seed") if key in run]
    parts = [recording.train, *filter(None, [run.get("scenario")]), *told]
    rows = dict(_trip(drive))
    parts += [rows[key] for key in ("stops", "driven", "time", "energy at the collector") if key in rows]
    return " · ".join(parts)


def on_this_day(recording: Recording) -> list[str]:
    """What is wrong with the recording, and what happened by the scenario, in lines for a picture; none if nothing."""
    happens = recording.metadata.get("run", {}).get("happens", NOTHING)
    lines = [f"of the recording: {text}" for text in recording.health.warnings()]
    if happens != NOTHING:
        lines.append(f"on this day (times from the timetable's departure): {happens}")
    return [part for line in lines for part in wrap(line, LETTERS)]


def _trip(drive: Drive) -> list[tuple[str, str]]:
    recording, rows = drive.recording, list[tuple[str, str]]()
    for entry in recording.of(topics.JOURNEY)[-1:]:
        journey = entry.message
        rows += [
            ("route", journey.route_id + (" (reversed)" if journey.reversed else "")),
            ("vehicle", journey.vehicle_id),
            ("stops", " – ".join(stop.name for stop in journey.stops)),
        ]
    where = recording.columns(topics.TRUTH, "time_ns", "s_m", "energy_input_j")
    if len(where["s_m"]):
        rows += [
            ("start (UTC)", f"{datetime.fromtimestamp(where['time_ns'][0] * NS, UTC):%Y-%m-%d %H:%M:%S}"),
            ("driven", f"{(where['s_m'][-1] - where['s_m'][0]) / KM:.2f} km"),
            ("time", f"{(where['time_ns'][-1] - where['time_ns'][0]) * NS:.0f} s"),
            ("energy at the collector", f"{kwh(where['energy_input_j'][-1]):.1f} kWh"),
        ]
    rows += [] if drive.said is None else drive.said.rows()
    rows += [(name.strip(), value) for name, value in drive.stability.rows()]
    rows += [("warning", drive.stability.warning)] if drive.stability.warning is not None else []
    for status in recording.of(topics.STATUS)[-1:]:
        rows += [("node", f"version {status.message.version}, {status.message.advices} advices")]
    rows += [("messages", str(sum(len(entries) for entries in recording.messages.values())))]
    return [*rows, ("attachments", ", ".join(recording.attachments) or "none")]


def readable(key: str, value: str) -> tuple[str, str]:
    """An entry of the metadata, energies in kWh and hashes short."""
    if key.endswith("_j"):
        try:
            return key[:-2].replace("_", " "), f"{kwh(float(value)):.1f} kWh"
        except ValueError:
            return key, value
    return key.replace("_", " "), value[:12] + "…" if "sha256" in key and len(value) > 12 else value


def _table(title: str, rows: list[tuple[str, str]]) -> list[str]:
    body = [f"| {name} | {value.replace('|', '/')} |" for name, value in rows]
    return [f"| {title} | |", "|---|---|", *body, ""]
