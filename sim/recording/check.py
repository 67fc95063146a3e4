"""The health of a recording: what it holds, how fast the advice was, and what is wrong."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from math import isnan
from pathlib import Path
from typing import Any

import numpy as np

from das import __version__
from das.bus import topics
from das.bus.contents import Contents, read_contents
from das.bus.recording import Recording, Stamped, recording_of
from das.bus.topics import TOPICS
from das.cab.outputs import NodeState
from das.domain.units import NS
from sim.recording.clock import DriveClock
from sim.recording.findings import CheckFinding, CheckKind, Rate, find, is_session, rate_of, to_recorder_s, versions

HASH = "_sha256"
"""Ending of the metadata keys that hold the hash of an input file."""
ELSEWHERE = ("trip_sha256", "what_if_of_sha256")
"""Keys for the hashes of files that are not attached to a recording."""


RATE_COLUMNS = ("topic", "messages", "a second", "usual interval", "longest gap")
"""The columns of `Checked.rate_rows`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Checked:
    """The result of a check: figures by name, the rate of each topic, what is wrong (`findings`), and other `notes`."""

    recording: Recording
    figures: dict[str, str]
    rates: dict[str, Rate]
    findings: tuple[CheckFinding, ...]
    notes: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """The same for JSON; times in ns since 1970."""
        return {
            "file": str(self.recording.path),
            "train": self.recording.train,
            "sound": not self.findings,
            "complete": self.recording.complete,
            "figures": self.figures,
            "topics": {
                name: {key: None if isnan(value) else value for key, value in vars(rate).items()}
                for name, rate in self.rates.items()
            },
            "findings": [
                {"kind": str(one.kind), "text": one.text, **({"time_ns": one.time_ns} if one.time_ns else {})}
                for one in self.findings
            ],
            "notes": list(self.notes),
        }

    def rate_rows(self) -> list[tuple[str, str, str, str, str]]:
        """Every topic: its messages, how many a second, the usual interval and the longest gap."""
        rows = []
        for name, rate in self.rates.items():
            times = (rate.interval_s, rate.longest_gap_s)
            # A topic with a single message has no gap.
            interval, gap = ("–" if isnan(value) or rate.messages < 2 else f"{value:.1f} s" for value in times)
            rows.append((name, str(rate.messages), "–" if isnan(rate.per_s) else f"{rate.per_s:.2f}", interval, gap))
        return rows

    def lines(self) -> list[str]:
        """The notes and the findings in words, and at the end the number of findings."""
        noted = [f"note: {note}" for note in self.notes]
        clock = DriveClock.of_recording(self.recording)
        wrong = [_line(one, clock) for one in self.findings]
        count = f"{len(wrong)} finding{'s' if len(wrong) > 1 else ''}"
        return [*noted, *wrong, count if wrong else "nothing is wrong with this recording"]


def check_file(path: Path, train: str | None = None) -> Checked:
    """Check a recording; raises DasError for a file with no messages of a train, and where `read_contents` does."""
    contents = read_contents(path)
    return check_contents(contents, recording_of(contents, train))


def check_contents(contents: Contents, recording: Recording) -> Checked:
    """Check a recording that has been read: the contents of its file, and the recording of one train in it."""
    hashes = _hashes(contents)
    findings = [*find(recording), *_inputs(recording, hashes)]
    found = {topic.name: rate_of(recording, topic) for topic in TOPICS}
    return Checked(
        recording=recording,
        figures=_figures(contents, recording),
        rates={name: rate for name, rate in found.items() if rate is not None},
        findings=tuple(findings),
        notes=tuple(_notes(contents, recording)),
    )


def _figures(contents: Contents, recording: Recording) -> dict[str, str]:
    log_ns = np.array([one.log_time_ns for entries in recording.messages.values() for one in entries])
    first_ns, last_ns = int(log_ns.min()), int(log_ns.max())
    health = contents.health
    rows = {
        "train": recording.train,
        "kind": "a node at work" if is_session(recording) else "a trip without a node",
        "from, to (UTC)": f"{utc(first_ns)} – {utc(last_ns)[11:]}",
        "lasts": f"{(last_ns - first_ns) * NS:.0f} s",
        "size": f"{health.size_bytes / 1e6:.2f} MB, {len(log_ns)} messages",
        "checksums": "all right" if not health.damage and not health.unchecked else "see below",
        "end of the file": "there" if health.complete else "missing",
        "running numbers": _numbers(health.missing),
        "versions": ", ".join(f"{who} {version}" for who, version in versions(recording).items()) or "not said",
        "input files attached": ", ".join(recording.attachments) or "none",
    }
    return {**rows, **_speed_of_advice(recording)}


def _numbers(missing: int | None) -> str:
    if missing is None:
        return "none"
    return f"{missing} missing" if missing else "without a hole"


def _speed_of_advice(recording: Recording) -> dict[str, str]:
    """How long it took to solve, to advise and to reach the recorder, as far as these times were measured."""
    status = recording.columns(topics.STATUS, "solve_s", "last_advice_s")
    rows = {}
    for name, values in (("solving a section", status["solve_s"]), ("computing an advice", status["last_advice_s"])):
        if len(values):
            rows[name] = _up_to(values) if values.any() else "not measured (clock of a simulation)"
    way_s = to_recorder_s(recording)
    if len(way_s):
        rows["advice, from its time to the recorder"] = _up_to(way_s)
    age_s = _ages_s(recording)
    if len(age_s):
        rows["age of the position behind an advice"] = _up_to(age_s)
    return rows


def _up_to(values_s: Any) -> str:
    middle, most = float(np.median(values_s)), float(values_s.max())
    return f"median {middle * 1000:.0f} ms, at most {most * 1000:.0f} ms"


def _ages_s(recording: Recording) -> Any:
    data = recording.columns(topics.ADVICE, "time_ns", "position_time_ns", "mode")
    used = (data["mode"] != 0) & (data["position_time_ns"] > 0)
    return (data["time_ns"][used] - data["position_time_ns"][used]) * NS


def _hashes(contents: Contents) -> dict[str, str]:
    """Names of the attached files by their SHA-256."""
    return {hashlib.sha256(one.data).hexdigest(): one.name for one in contents.attachments}


def _inputs(recording: Recording, attached: dict[str, str]) -> list[CheckFinding]:
    """Findings about input files whose hash matches no attached file."""
    run = recording.metadata.get("run", {})
    named = {key: value for key, value in run.items() if key.endswith(HASH) and key not in ELSEWHERE}
    missing = [key[: -len(HASH)].replace("_", " ") for key, value in named.items() if value not in attached]
    return [
        CheckFinding(kind=CheckKind.INPUT, text=f"the {name} of the run is not among the attached files")
        for name in missing
    ]


def _notes(contents: Contents, recording: Recording) -> list[str]:
    notes = []
    restarts = len(restarts_of(recording.of(topics.STATUS)))
    if restarts:
        notes.append(f"the node was started anew {restarts} time{'s' if restarts > 1 else ''}")
    others = [name for name in recording.trains if name != recording.train]
    if others:
        notes.append(f"also recorded, not checked: {', '.join(others)} (--of-train)")
    notes += [f"{count} messages on {topic}, which is no topic of ours" for topic, count in contents.foreign.items()]
    recovered = recording.metadata.get("recovered", {})
    if recovered:
        notes.append(f"recovered from {recovered.get('file', '?')}: {recovered.get('lost', '?')}")
    used = set(versions(recording).values())
    if used and used != {__version__}:
        notes.append(f"made by version {', '.join(sorted(used))}; this is {__version__}")
    return notes


def restarts_of(statuses: Sequence[Stamped]) -> list[int]:
    """Indices of the first status after each restart of the node, whose count of advices then begins at 0 again."""
    found, most = [], 0
    for i, one in enumerate(statuses):
        if one.message.state == NodeState.STOPPING:  # sent by the process, which counts no advice
            continue
        if one.message.advices < most:
            found.append(i)
        most = one.message.advices
    return found


def _line(one: CheckFinding, clock: DriveClock) -> str:
    when = f" at {clock.shown(one.time_ns)}, {utc(one.time_ns)} UTC" if one.time_ns else ""
    return f"finding ({one.kind}){when}: {one.text}"


def utc(time_ns: int) -> str:
    """A time (ns since 1970) as date and time of day (UTC), to the second."""
    try:
        return f"{datetime.fromtimestamp(time_ns * NS, UTC):%Y-%m-%d %H:%M:%S}"
    except (OverflowError, ValueError, OSError):
        return f"{time_ns} ns"
