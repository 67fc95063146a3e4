"""The health of a recording: its contents, the speed of the advice, and its faults."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das import __version__
from das.advice.regimes import Regime
from das.bus import topics
from das.bus.recording import Contents, Recording, Stamped, read_contents, recording_of
from das.bus.topics import TOPICS, Topic
from das.domain.units import NS
from das.estimate.estimate import STALE_AFTER_S
from sim.recording.course import DriveClock, Floats, Times, times_of, utc
from sim.recording.opening import is_session, missing_files, versions


@dataclass(frozen=True, kw_only=True)
class Rate:
    """The rate of a topic: number of messages, messages per second, and usual and longest interval between two (s).

    None: not known, because there is only one message, or all have one time.
    """

    messages: int
    per_s: float | None
    interval_s: float | None
    longest_gap_s: float


def rate_of(recording: Recording, topic: Topic) -> Rate | None:
    """The rate of a topic; None if it has no messages."""
    time_ns = np.sort(times_of(recording, topic))
    if not len(time_ns):
        return None
    steps_s = np.diff(time_ns) * NS
    span_s = float(time_ns[-1] - time_ns[0]) * NS
    return Rate(
        messages=len(time_ns),
        per_s=len(steps_s) / span_s if span_s > 0 else None,
        interval_s=float(np.median(steps_s)) if len(steps_s) else None,
        longest_gap_s=float(steps_s.max(initial=0.0)),
    )


LATE_AFTER_S = 1.0
"""Least delay (s) from time stamp to recording of advice that counts as late for the driver as well."""
SLOW_AFTER_S = 1.0
"""Computing time (s) above which advice comes only when the next advice is due."""
LONGEST_GAP_S = STALE_AFTER_S
"""Longest gap (s) of the positions with advice; in a longer one the node withdraws the advice: a blank display."""
GAP_INTERVALS = 2.5
"""Number of usual intervals without a message from which a topic slower than once a second has a gap."""
CYCLIC = (topics.POSITION, topics.CONTROL, topics.ADVICE, topics.STATUS, topics.TRUTH, topics.CAB)
"""The topics on which messages come regularly."""
OF_A_SESSION = (topics.JOURNEY, topics.RESTRICTION, topics.POSITION, topics.ADVICE, topics.STATUS)
OF_A_TRIP = (topics.POSITION,)
"""Topics that a recording must have: `OF_A_SESSION` with a node at work, `OF_A_TRIP` for a trip without a node."""
MOST_OF_A_KIND = 5
"""Largest number of gaps of a topic that are reported one by one."""


class CheckKind(StrEnum):
    """The kinds of findings about a recording."""

    DAMAGE = "damage"
    CUT_OFF = "cut-off"
    MISSING_MESSAGES = "missing-messages"
    UNCHECKED = "unchecked"
    NO_TOPIC = "no-topic"
    GAP = "gap"
    DISORDER = "disorder"
    UNANSWERED = "unanswered"
    STALE = "stale-position"
    EXPIRED = "expired-advice"
    LATE = "late-advice"
    SLOW = "slow-advice"
    DROPPED = "dropped-messages"
    VERSIONS = "versions"
    INPUT = "input-file"


class CheckFinding(NamedTuple):
    """A fault: its kind, a sentence about it, and its time (ns since 1970; 0: it has no time)."""

    kind: CheckKind
    text: str
    time_ns: int = 0


def find(recording: Recording) -> Iterator[CheckFinding]:
    """All faults of a recording: of its file, topics and advice, then of the programs and files behind it."""
    yield from _of_the_file(recording)
    for topic in OF_A_SESSION if is_session(recording) else OF_A_TRIP:
        if not recording.of(topic):
            yield CheckFinding(CheckKind.NO_TOPIC, f"there is no message on the topic {topic.name}")
    yield from _gaps(recording)
    for topic in (topics.POSITION, topics.CONTROL, topics.ADVICE):  # each topic has one sender
        time_ns = times_of(recording, topic)
        text = f"{topic.name}: {{}} messages have an earlier time than the one before"
        yield from _counted(CheckKind.DISORDER, text, np.diff(time_ns) < 0, time_ns[1:])
    yield from _unanswered(recording)
    yield from _of_the_advice(recording)
    dropped = recording.metadata.get(topics.RECORDER.name, {}).get("dropped", "0")
    if dropped != "0":
        text = f"the recorder could not write {dropped} messages: too many came at once, or the disk was slow"
        yield CheckFinding(CheckKind.DROPPED, text)
    used = versions(recording)
    if len(set(used.values())) > 1:
        text = "programs of different versions: " + ", ".join(f"{who} {version}" for who, version in used.items())
        yield CheckFinding(CheckKind.VERSIONS, text)
    for kind in missing_files(recording):
        text = f"the {kind.replace('_', ' ')} of the run is not among the attached files"
        yield CheckFinding(CheckKind.INPUT, text)


def _counted(kind: CheckKind, text: str, wrong: NDArray[np.bool_], time_ns: Times) -> Iterator[CheckFinding]:
    """A finding at the time of the first wrong message, if one is wrong; `{}` in its text is their number."""
    if wrong.any():
        yield CheckFinding(kind, text.format(np.count_nonzero(wrong)), int(time_ns[np.argmax(wrong)]))


def _of_the_file(recording: Recording) -> Iterator[CheckFinding]:
    health = recording.health
    for one in health.damage:
        yield CheckFinding(CheckKind.DAMAGE, f"{one}{', which is left out' if one.lost else ''}", one.from_ns)
    if health.missing:
        text = f"{health.missing} messages are missing, according to their sequence numbers"
        yield CheckFinding(CheckKind.MISSING_MESSAGES, text)
    if not health.complete:
        last_ns = max(entries[-1].log_time_ns for entries in recording.messages.values())
        text = "the file was cut off: its recorder was killed, its disk was full, or it is still recording"
        yield CheckFinding(CheckKind.CUT_OFF, text, last_ns)
    for what in health.unchecked:
        yield CheckFinding(CheckKind.UNCHECKED, f"no checksum covers the {what}: damage would go unnoticed")


def _gaps(recording: Recording) -> Iterator[CheckFinding]:
    for topic in CYCLIC:
        time_ns = np.sort(times_of(recording, topic))
        if len(time_ns) < 2:
            continue
        steps_s = np.diff(time_ns) * NS
        gaps = np.flatnonzero(steps_s > max(LONGEST_GAP_S, GAP_INTERVALS * float(np.median(steps_s))))
        for i in gaps[:MOST_OF_A_KIND]:
            yield CheckFinding(CheckKind.GAP, f"{topic.name}: nothing for {steps_s[i]:.1f} s", int(time_ns[i]))
        if len(gaps) > MOST_OF_A_KIND:
            text = f"{topic.name}: {len(gaps) - MOST_OF_A_KIND} more gaps"
            yield CheckFinding(CheckKind.GAP, text, int(time_ns[gaps[MOST_OF_A_KIND]]))


def _unanswered(recording: Recording) -> Iterator[CheckFinding]:
    """Ticks of a simulation that the node did not answer; the last Control does not ask for an answer."""
    control = recording.columns(topics.CONTROL, "tick", "time_ns", "command")
    asked = control["command"] == 0
    ticks = control["tick"][asked]
    missing = ~np.isin(ticks, recording.columns(topics.ADVICE, "tick")["tick"])
    if missing.any():
        text = f"{{}} of {len(ticks)} ticks have no advice, the first is tick {ticks[np.argmax(missing)]}"
        yield from _counted(CheckKind.UNANSWERED, text, missing, control["time_ns"][asked])


def _of_the_advice(recording: Recording) -> Iterator[CheckFinding]:
    """Advice based on an old position, expired before the next advice (a blank display), or late."""
    data = recording.columns(topics.ADVICE, "time_ns", "valid_until_ns", "mode")
    status = recording.columns(topics.STATUS, "time_ns", "last_advice_s")
    based_ns, age_s = _position_ages(recording)
    text = (
        f"{{}} advice messages were based on a position older than {STALE_AFTER_S:g} s, the oldest of {_most(age_s)} s"
    )
    yield from _counted(CheckKind.STALE, text, age_s > STALE_AFTER_S, based_ns)
    over_s = (data["time_ns"][1:] - data["valid_until_ns"][:-1]) * NS
    over_s[data["mode"][:-1] == Regime.NONE] = 0.0
    text = f"{{}} times advice expired before the next came, by up to {_most(over_s)} s"
    yield from _counted(CheckKind.EXPIRED, text, over_s > 0, data["valid_until_ns"])
    late_s = to_recorder_s(recording)
    text = f"{{}} advice messages came over {LATE_AFTER_S:g} s late, by up to {_most(late_s)} s"
    yield from _counted(CheckKind.LATE, text, late_s > LATE_AFTER_S, data["time_ns"])
    took_s = status["last_advice_s"]
    text = f"{{}} advice messages took over {SLOW_AFTER_S:g} s, up to {_most(took_s)} s"
    yield from _counted(CheckKind.SLOW, text, took_s > SLOW_AFTER_S, status["time_ns"])


def _most(values_s: Floats) -> str:
    return f"{values_s.max(initial=0.0):.1f}"


def _position_ages(recording: Recording) -> tuple[Times, Floats]:
    data = recording.columns(topics.ADVICE, "time_ns", "position_time_ns", "mode")
    used = (data["mode"] != Regime.NONE) & (data["position_time_ns"] > 0)
    return data["time_ns"][used], (data["time_ns"][used] - data["position_time_ns"][used]) * NS


def to_recorder_s(recording: Recording) -> Floats:
    """The time (s) of each advice message to the recorder; empty for a simulation, whose clock waits meanwhile."""
    if recording.of(topics.CONTROL):
        return np.zeros(0)
    data = recording.columns(topics.ADVICE, "time_ns")
    return np.asarray((data["log_time_ns"] - data["time_ns"]) * NS, dtype=np.float64)


RATE_COLUMNS = ("topic", "messages", "a second", "usual interval", "longest gap")
"""The columns of `Checked.rate_rows`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Checked:
    """The result of a check: figures (`numbers`), the rate of each topic, the faults (`findings`), and `notes`."""

    recording: Recording
    numbers: dict[str, Any]
    rates: dict[str, Rate]
    findings: tuple[CheckFinding, ...]
    notes: tuple[str, ...]

    @property
    def figures(self) -> dict[str, str]:
        """The figures in words, by name."""
        recording, found = self.recording, self.numbers
        first_ns, last_ns, missing = found["from_ns"], found["to_ns"], found["missing_messages"]
        rows = {
            "train": recording.train,
            "kind": "an active node" if found["node_at_work"] else "a trip without a node",
            "from, to (UTC)": f"{utc(first_ns)} – {utc(last_ns)[11:]}",
            "lasts": f"{(last_ns - first_ns) * NS:.0f} s",
            "size": f"{found['size_bytes'] / 1e6:.2f} MB, {found['messages']} messages",
            "checksums": "all right" if found["checksums_right"] else "see below",
            "end of the file": "there" if recording.complete else "missing",
            "sequence numbers": "none" if missing is None else f"{missing} missing" if missing else "without a hole",
            "versions": ", ".join(f"{who} {version}" for who, version in found["versions"].items()) or "not said",
            "input files attached": ", ".join(found["attached_files"]) or "none",
        }
        return {**rows, **{words: _up_to(found[name]) for name, words in TIMES.items() if name in found}}

    def as_dict(self) -> dict[str, Any]:
        """The result for programs; moments in ns since 1970, durations in s."""
        return {
            "file": str(self.recording.path),
            "train": self.recording.train,
            "sound": not self.findings,
            "complete": self.recording.complete,
            "figures": self.numbers,
            "topics": {name: vars(rate) for name, rate in self.rates.items()},
            "findings": [
                {"kind": str(one.kind), "text": one.text, **({"time_ns": one.time_ns} if one.time_ns else {})}
                for one in self.findings
            ],
            "notes": list(self.notes),
        }

    def rate_rows(self) -> list[tuple[str, str, str, str, str]]:
        """A row of texts for each topic, under `RATE_COLUMNS`."""
        rows = []
        for name, rate in self.rates.items():
            per_s = "–" if rate.per_s is None else f"{rate.per_s:.2f}"
            # A topic with a single message has no gap.
            times = (rate.interval_s, rate.longest_gap_s)
            interval, gap = ("–" if rate.interval_s is None else f"{value:.1f} s" for value in times)
            rows.append((name, str(rate.messages), per_s, interval, gap))
        return rows

    def lines(self) -> list[str]:
        """The notes and the findings as sentences, and the number of findings at the end."""
        noted = [f"note: {note}" for note in self.notes]
        clock = DriveClock.of_recording(self.recording)
        wrong = [_line(one, clock) for one in self.findings]
        count = f"{len(wrong)} finding{'s' if len(wrong) > 1 else ''}"
        return [*noted, *wrong, count if wrong else "no fault was found in this recording"]


def check_file(path: Path, train: str | None = None) -> Checked:
    """Check a recording; raises DasError for a file without messages of a train, and as `read_contents` does."""
    contents = read_contents(path)
    return check_contents(contents, recording_of(contents, train))


def check_contents(contents: Contents, recording: Recording) -> Checked:
    """Check a recording that has been read: the contents of its file, and one train's recording in it."""
    found = {topic.name: rate_of(recording, topic) for topic in TOPICS}
    return Checked(
        recording=recording,
        numbers=_figures(contents, recording),
        rates={name: rate for name, rate in found.items() if rate is not None},
        findings=tuple(find(recording)),
        notes=tuple(_notes(contents, recording)),
    )


def _figures(contents: Contents, recording: Recording) -> dict[str, Any]:
    """The figures of a recording by their names for programs; None: not known, or not measured."""
    log_ns = np.array([one.log_time_ns for entries in recording.messages.values() for one in entries])
    health = contents.health
    return {
        "node_at_work": is_session(recording),
        "from_ns": int(log_ns.min()),
        "to_ns": int(log_ns.max()),
        "size_bytes": health.size_bytes,
        "messages": len(log_ns),
        "checksums_right": not health.damage and not health.unchecked,
        "missing_messages": health.missing,
        "versions": versions(recording),
        "attached_files": list(recording.attachments),
        **_speed_of_advice(recording),
    }


TIMES: Final = {
    "solve_s": "solving a section",
    "advice_s": "computing advice",
    "advice_to_recorder_s": "advice, from its time to the recorder",
    "position_age_s": "age of the position behind the advice",
}
"""The times of the node, by name and in words."""


def _speed_of_advice(recording: Recording) -> dict[str, dict[str, float] | None]:
    """The times of solving, advising and transfer to the recorder (s): median and maximum.

    None: not measured, because a simulation gives the time. A time without messages is left out.
    """
    status = recording.columns(topics.STATUS, "solve_s", "last_advice_s")
    measured = {"solve_s": status["solve_s"], "advice_s": status["last_advice_s"]}
    taken = {name: values if values.any() else None for name, values in measured.items() if len(values)}
    others = {"advice_to_recorder_s": to_recorder_s(recording), "position_age_s": _position_ages(recording)[1]}
    taken |= {name: values for name, values in others.items() if len(values)}
    return {
        name: None if values is None else {"median": float(np.median(values)), "most": float(values.max())}
        for name, values in taken.items()
    }


def _up_to(taken_s: Mapping[str, float] | None) -> str:
    if taken_s is None:
        return "not measured (clock of a simulation)"
    return f"median {taken_s['median'] * 1000:.0f} ms, at most {taken_s['most'] * 1000:.0f} ms"


def _notes(contents: Contents, recording: Recording) -> list[str]:
    notes = []
    restarts = len(restarts_of(recording.of(topics.STATUS)))
    if restarts:
        notes.append(f"the node was restarted {restarts} time{'s' if restarts > 1 else ''}")
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
    """Indices of the first status after each restart of the node, which then counts its advice from 0 again."""
    found, most = [], 0
    for i, one in enumerate(statuses):
        if one.message.state == one.message.STATE_STOPPING:  # sent by the process, which counts no advice
            continue
        if one.message.advices < most:
            found.append(i)
        most = one.message.advices
    return found


def _line(one: CheckFinding, clock: DriveClock) -> str:
    when = f" at {clock.shown(one.time_ns)}, {utc(one.time_ns)} UTC" if one.time_ns else ""
    return f"finding ({one.kind}){when}: {one.text}"
