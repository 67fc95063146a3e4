"""What is wrong with a recording, each with the time at which it was, and how often its messages came."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from das.advice.regimes import Regime
from das.bus import topics
from das.bus.recorder import message_time_ns
from das.bus.recording import Recording
from das.bus.topics import Topic
from das.domain.units import NS
from das.estimate.settings import STALE_AFTER_S


@dataclass(frozen=True, kw_only=True)
class Rate:
    """How many messages there are, in how many a second they came, the usual and the longest time between two (s)."""

    messages: int
    per_s: float
    interval_s: float
    longest_gap_s: float


def times_of(recording: Recording, topic: Topic) -> NDArray[Any]:
    """The times (ns) that the messages of a topic state, in the order recorded; where one states none, the log's."""
    entries = recording.of(topic)
    return np.array([message_time_ns(one.message) or one.log_time_ns for one in entries], dtype=np.int64)


def rate_of(recording: Recording, topic: Topic) -> Rate | None:
    """The rate of a topic; None where it has no messages."""
    time_ns = np.sort(times_of(recording, topic))
    if not len(time_ns):
        return None
    steps_s = np.diff(time_ns) * NS
    span_s = float(time_ns[-1] - time_ns[0]) * NS
    return Rate(
        messages=len(time_ns),
        per_s=len(steps_s) / span_s if span_s > 0 else float("nan"),
        interval_s=float(np.median(steps_s)) if len(steps_s) else float("nan"),
        longest_gap_s=float(steps_s.max()) if len(steps_s) else 0.0,
    )


LATE_AFTER_S = 1.0
"""An advice that is recorded later than this after its time has come late to the driver as well (s)."""
SLOW_AFTER_S = 1.0
"""An advice that takes longer than this to compute is later than the next one is due (s)."""
LONGEST_GAP_S = STALE_AFTER_S
"""Without positions for longer than this the node withdraws its advice, and without advice the display shows none."""
GAP_INTERVALS = 2.5
"""What comes more rarely than once a second has a gap where so many of its usual intervals pass without it."""
CYCLIC = (topics.POSITION, topics.CONTROL, topics.ADVICE, topics.STATUS, topics.TRUTH, topics.CAB)
"""The topics that come all the time."""
OF_A_SESSION = (topics.JOURNEY, topics.RESTRICTION, topics.POSITION, topics.ADVICE, topics.STATUS)
OF_A_TRIP = (topics.POSITION,)
"""What a recording must hold: one of a node at work, and one of a trip without a node."""
MOST_OF_A_KIND = 5
"""So many gaps of one topic are told one by one."""


class CheckKind(StrEnum):
    """What can be wrong with a recording."""

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


@dataclass(frozen=True, kw_only=True)
class CheckFinding:
    """Something that is wrong: what, in words, and when (ns since 1970; 0: it has no time)."""

    kind: CheckKind
    text: str
    time_ns: int = 0


def is_session(recording: Recording) -> bool:
    """Whether a node was at work, so that there must be its words."""
    return any(recording.of(topic) for topic in (topics.ADVICE, topics.STATUS, topics.CONTROL))


def find(recording: Recording) -> list[CheckFinding]:
    """All that is wrong with a recording, in the order of the checks."""
    checks: tuple[Callable[[Recording], Iterator[CheckFinding]], ...] = (
        _of_the_file,
        _topics,
        _gaps,
        _disorder,
        _unanswered,
        _stale,
        _expired,
        _late,
        _slow,
        _dropped,
        _versions,
    )
    return [finding for check in checks for finding in check(recording)]


def _of_the_file(recording: Recording) -> Iterator[CheckFinding]:
    health = recording.health
    for one in health.damage:
        lost = ", which is left out" if one.lost else ""
        yield CheckFinding(kind=CheckKind.DAMAGE, text=f"{one}{lost}", time_ns=one.from_ns)
    if health.missing:
        text = f"{health.missing} messages are missing, by their running numbers"
        yield CheckFinding(kind=CheckKind.MISSING_MESSAGES, text=text)
    if not health.complete:
        last_ns = max(entries[-1].log_time_ns for entries in recording.messages.values())
        text = "the file was cut off: its recorder was killed, its disk was full, or it is still recording"
        yield CheckFinding(kind=CheckKind.CUT_OFF, text=text, time_ns=last_ns)
    for what in health.unchecked:
        yield CheckFinding(kind=CheckKind.UNCHECKED, text=f"no checksum covers the {what}: damage would not be seen")


def _topics(recording: Recording) -> Iterator[CheckFinding]:
    for topic in OF_A_SESSION if is_session(recording) else OF_A_TRIP:
        if not recording.of(topic):
            yield CheckFinding(kind=CheckKind.NO_TOPIC, text=f"there is no message on the topic {topic.name}")


def _gaps(recording: Recording) -> Iterator[CheckFinding]:
    for topic in CYCLIC:
        rate = rate_of(recording, topic)
        if rate is None:
            continue
        gaps = list(_gaps_of(recording, topic, rate))
        yield from gaps[:MOST_OF_A_KIND]
        if len(gaps) > MOST_OF_A_KIND:
            text = f"{topic.name}: {len(gaps) - MOST_OF_A_KIND} more gaps"
            yield CheckFinding(kind=CheckKind.GAP, text=text, time_ns=gaps[MOST_OF_A_KIND].time_ns)


def _gaps_of(recording: Recording, topic: Topic, rate: Rate) -> Iterator[CheckFinding]:
    longest_s = max(LONGEST_GAP_S, GAP_INTERVALS * rate.interval_s)
    time_ns = np.sort(times_of(recording, topic))
    steps_s = np.diff(time_ns) * NS
    for i in np.nonzero(steps_s > longest_s)[0]:
        text = f"{topic.name}: nothing for {steps_s[i]:.1f} s"
        yield CheckFinding(kind=CheckKind.GAP, text=text, time_ns=int(time_ns[i]))


def _disorder(recording: Recording) -> Iterator[CheckFinding]:
    """Times that go back within what one sender says."""
    for topic in (topics.POSITION, topics.CONTROL, topics.ADVICE):
        time_ns = times_of(recording, topic)
        back = np.nonzero(np.diff(time_ns) < 0)[0]
        if len(back):
            text = f"{topic.name}: {len(back)} messages have an earlier time than the one before"
            yield CheckFinding(kind=CheckKind.DISORDER, text=text, time_ns=int(time_ns[back[0] + 1]))


def _unanswered(recording: Recording) -> Iterator[CheckFinding]:
    """Ticks of a simulation that the node did not answer; the last Control asks for nothing."""
    asked = recording.columns(topics.CONTROL, "tick", "time_ns", "command")
    ticks = asked["tick"][asked["command"] == 0]
    answered = set(recording.columns(topics.ADVICE, "tick")["tick"].tolist())
    missing = [i for i, tick in enumerate(ticks.tolist()) if tick not in answered]
    if missing:
        text = f"{len(missing)} of {len(ticks)} ticks have no advice, the first is tick {ticks[missing[0]]}"
        yield CheckFinding(kind=CheckKind.UNANSWERED, text=text, time_ns=int(asked["time_ns"][missing[0]]))


def _stale(recording: Recording) -> Iterator[CheckFinding]:
    data = recording.columns(topics.ADVICE, "time_ns", "position_time_ns", "mode")
    age_s = (data["time_ns"] - data["position_time_ns"]) * NS
    stale = np.nonzero((data["mode"] != Regime.NONE) & (data["position_time_ns"] > 0) & (age_s > STALE_AFTER_S))[0]
    if len(stale):
        text = f"{len(stale)} advices were given on a position older than {STALE_AFTER_S:g} s"
        text += f", the oldest of {age_s[stale].max():.1f} s"
        yield CheckFinding(kind=CheckKind.STALE, text=text, time_ns=int(data["time_ns"][stale[0]]))


def _expired(recording: Recording) -> Iterator[CheckFinding]:
    """Advice that was not valid any more when the next one came: the display had nothing to show."""
    data = recording.columns(topics.ADVICE, "time_ns", "valid_until_ns", "mode")
    late_s = (data["time_ns"][1:] - data["valid_until_ns"][:-1]) * NS
    expired = np.nonzero((data["mode"][:-1] != Regime.NONE) & (late_s > 0))[0]
    if len(expired):
        text = f"{len(expired)} times advice had run out before the next came, by up to {late_s[expired].max():.1f} s"
        yield CheckFinding(kind=CheckKind.EXPIRED, text=text, time_ns=int(data["valid_until_ns"][expired[0]]))


def _late(recording: Recording) -> Iterator[CheckFinding]:
    late_s = to_recorder_s(recording)
    late = np.nonzero(late_s > LATE_AFTER_S)[0]
    if len(late):
        text = f"{len(late)} advices came later than {LATE_AFTER_S:g} s after their time, by up to {late_s.max():.1f} s"
        yield CheckFinding(
            kind=CheckKind.LATE, text=text, time_ns=int(recording.columns(topics.ADVICE)["time_ns"][late[0]])
        )


def to_recorder_s(recording: Recording) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """How long each advice took from its time to the recorder (s); none by the clock of a simulation, which stands."""
    if recording.of(topics.CONTROL):
        return np.zeros(0)
    data = recording.columns(topics.ADVICE, "time_ns")
    return np.asarray((data["log_time_ns"] - data["time_ns"]) * NS, dtype=np.float64)


def _slow(recording: Recording) -> Iterator[CheckFinding]:
    data = recording.columns(topics.STATUS, "time_ns", "last_advice_s")
    slow = np.nonzero(data["last_advice_s"] > SLOW_AFTER_S)[0]
    if len(slow):
        text = f"{len(slow)} advices took longer than {SLOW_AFTER_S:g} s, up to {data['last_advice_s'].max():.1f} s"
        yield CheckFinding(kind=CheckKind.SLOW, text=text, time_ns=int(data["time_ns"][slow[0]]))


def _dropped(recording: Recording) -> Iterator[CheckFinding]:
    dropped = recording.metadata.get(topics.RECORDER.name, {}).get("dropped", "0")
    if dropped != "0":
        text = f"the recorder could not write {dropped} messages: too many came at once, or the disk was slow"
        yield CheckFinding(kind=CheckKind.DROPPED, text=text)


def _versions(recording: Recording) -> Iterator[CheckFinding]:
    found = versions(recording)
    if len(set(found.values())) > 1:
        text = "programs of different versions: " + ", ".join(f"{who} {version}" for who, version in found.items())
        yield CheckFinding(kind=CheckKind.VERSIONS, text=text)


def versions(recording: Recording) -> dict[str, str]:
    """The versions of the programs that took part, by what they did."""
    nodes = sorted({one.message.version for one in recording.of(topics.STATUS) if one.message.version})
    found = {"node" if len(nodes) == 1 else f"node {i}": version for i, version in enumerate(nodes, 1)}
    run = recording.metadata.get("run", {})
    who = "recorder" if run.get("kind") == "session" else "simulator"
    return {**({who: run["version"]} if "version" in run else {}), **found}
