"""A small study with people on a flat line of 6 km, and a participant who takes part as the page does, by script."""

from __future__ import annotations

import csv
import http.client
import json
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from threading import Barrier
from types import TracebackType
from typing import Any, Final
from urllib.parse import urlsplit

import pytest
from websockets.sync.client import connect

from das.bus import das_pb2
from das.bus.recording import read_recording
from das.bus.topics import ACTION
from sim.experiment.design import freeze, load_design, read_design
from sim.experiment.people.journal import read_journal
from sim.experiment.people.session import Sitting, serve
from sim.experiment.study_files import recording_file
from sim.experiment.trials import trials_of
from tests.support.desk_page import STRONGEST_MPS2

ANSWERS: Final = {"tlx": "40", "kss": "3", "sus": "4", "trust": "5"}
Message = dict[str, Any]

DESIGN: Final = """
schema_version = 1
[experiment]
name = "people"
title = "Does the guide help people?"
seed = 7
[participants]
count = 4
[procedure]
practice_trials = 1
break_after = 2
break_s = 1
[fixed]
scenario = "flat-6km"
driver = "desk"
[[factors]]
name = "presentation"
levels = ["none", "guide"]
[analysis]
measures = ["energy_kwh", "running_time_s", "stops_missed", "tlx"]
[desk]
consent = "consent.md"
instructions = "instructions.md"
debriefing = "debriefing.md"
before = ["kss"]
after_trial = ["tlx"]
after = ["sus"]
practice_criterion_kmh = 3
practice_hold_s = 5
practice_most = 1
pace = 10
"""


def study(folder: Path, *changes: tuple[str, str]) -> Path:
    """The design file of the study in a folder, with its texts, and with some lines replaced."""
    folder.mkdir(exist_ok=True)
    text = DESIGN
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    (folder / "consent.md").write_text("# Do you want to take part?\n\nYou may *stop* at any time.\n", encoding="utf-8")
    (folder / "instructions.md").write_text("Drive <script>alert(1)</script> on time.\n", encoding="utf-8")
    (folder / "debriefing.md").write_text("We compared displays.\n", encoding="utf-8")
    path = folder / "people.toml"
    path.write_text(text, encoding="utf-8")
    return path


class Participant:
    """A page at the desk by script; use with `with`. `seen` has all texts that the browser has received.

    The experimenter's page has another `socket`.
    """

    def __init__(self, address: str, socket: str = "/desk") -> None:
        parts = urlsplit(address)
        self.host, self.seen, self.steps, self.said = parts.netloc, list[str](), list[Message](), list[Message]()
        self._path = socket
        door = http.client.HTTPConnection(self.host, timeout=20)
        door.request("GET", f"{parts.path}?{parts.query}")
        answer = door.getresponse()
        assert answer.status == 303, answer.status
        self._cookie = str(answer.headers["Set-Cookie"]).partition(";")[0]
        self._k = self._looks = 0
        self._ratio = 0.0

    def __enter__(self) -> Participant:
        self._opened = connect(
            f"ws://{self.host}{self._path}", origin=f"http://{self.host}",  # type: ignore[arg-type]
            additional_headers={"Cookie": self._cookie}, compression=None, max_queue=None,
        )  # fmt: skip
        self._socket = self._opened.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._opened.__exit__(kind, error, trace)

    def say(self, kind: str, **fields: Any) -> None:
        """Send a message as the page does."""
        self.said.append({"t": kind, **fields})
        self._socket.send(json.dumps({"t": kind, **fields}))

    def hear(self, for_s: float = 60.0) -> Message:
        """The next message to the page; while it drives, the answer to a cab is sent at once."""
        text = str(self._socket.recv(timeout=for_s))
        self.seen.append(text)
        message: Message = json.loads(text)
        if message["t"] == "hello":
            self._k, self._ratio = message["seq"], message["lever"]
        elif message["t"] == "step":
            self.steps.append(message)
        elif message["t"] == "cab":
            self._drive(message["cab"])
        return message

    def until(self, fits: Callable[[Message], bool], for_s: float = 240.0) -> Message:
        """The first message that fits; nothing is answered but cabs."""
        end = time.monotonic() + for_s
        while time.monotonic() < end:
            message = self.hear()
            if fits(message):
                return message
        raise AssertionError(f"waited {for_s:.0f} s; the last message: {message}")

    def step(self, name: str = "") -> Message:
        """The next step, which must be the named one."""
        found = self.until(lambda one: one["t"] == "step")
        assert not name or found["id"] == name, found
        return found

    def goes_on(self, step: Message, consent: str = "yes") -> None:
        """Answer all items of a step, and go on."""
        if step["wait_s"] > 0:
            time.sleep(step["wait_s"] + 0.1)
        if step["kind"] == "consent":
            self.say("answer", step=step["id"], item="consent", value=consent, at=1.0)
        for item in step["items"]:
            value = ANSWERS.get(step["id"].rpartition("-")[2], "1")
            self.say("answer", step=step["id"], item=item["id"], value=value, at=1.0)
        self.say("next", step=step["id"], at=2.0)

    def goes_until(self, name: str) -> Message:
        """Take part until a step shows, which is returned."""
        while True:
            found = self.step()
            if found["id"] == name:
                return found
            self.goes_on(found)

    def _drive(self, cab: Message) -> None:
        self._looks += 1
        if self._looks % 3 == 0:
            self.say("drawn", look=cab["look"])
        wanted = round(max(min(wanted_ratio(cab), 1.0), -1.0), 1)
        if wanted != self._ratio:
            self._k, self._ratio = self._k + 1, wanted
            self.say("lever", k=self._k, ratio=wanted, at=time.time() * 1000, by="key", look=cab["look"])


def rows(path: Path) -> list[dict[str, str]]:
    """The rows of a table."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def wanted_ratio(cab: Message) -> float:
    """The setting of the lever by somebody who knows the train and looks at nothing but limit and stop."""
    speed, way = cab["speed_mps"], cab["stop_m"] - cab["s_m"]
    if not cab["may_depart"] or cab["interlock"] == das_pb2.Cab.INTERLOCK_SILENCE:
        return 0.0
    if way <= 1.0:
        return -1.0
    need = speed**2 / (2 * max(way - 4.0, 1.0)) / STRONGEST_MPS2
    if need > 0.3:
        return -need
    return 0.7 if need < 0.12 and speed < min(cab["limit_mps"], 32.0) - 1.0 and way > 10 else 0.0


@contextmanager
def session_of(design: Path, folder: Path, who: int = 1) -> Iterator[tuple[str, str]]:
    """The session of a participant in a thread of this process, until its last step; yields the two addresses."""
    read = load_design(str(design))
    freeze(read, folder)
    sitting = Sitting(design=read, folder=folder, who=who, language="en", command="a test")
    address, came, failed = list[str](), threading.Event(), list[BaseException]()

    def tell(page: str, watch: str) -> None:
        address.extend((page, watch))
        came.set()

    def run() -> None:
        try:
            serve(sitting, 0, tell)
        except BaseException as error:
            failed.append(error)
            came.set()

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    assert came.wait(60)
    if failed:
        raise failed[0]
    yield address[0], address[1]
    thread.join(60)
    assert not thread.is_alive()
    if failed:
        raise failed[0]


def at_once(takes_part: Callable[[str, Barrier], list[Message]]) -> list[list[Message]]:
    """Let P1 and P2 take part at the same time; returns what `takes_part` returns, the settings of their levers.

    They wait for each other with the barrier; a failure of one ends the wait of the other.
    """
    ready = Barrier(2)

    def part(who: str) -> list[Message]:
        try:
            return takes_part(who, ready)
        except BaseException:
            ready.abort()
            raise

    with ThreadPoolExecutor(2) as both:
        return list(both.map(part, ("P1", "P2")))


def check_at_once(design: Path, out: Path, levers: list[list[Message]]) -> None:
    """Of two sessions of two trials at the same time, each recording has only the lever of its page, and nothing is
    mixed in journals and tables."""
    planned = {(one.who, one.position): one for one in trials_of(read_design(design)) if one.who <= 2}
    trials = rows(out / "trials.csv")
    assert [(row["participant"], row["position"]) for row in trials] == [
        ("sub-01", "1"), ("sub-01", "2"), ("sub-02", "1"), ("sub-02", "2"),
    ]  # fmt: skip
    began = {}
    for row in trials:
        who = int(row["participant"][-2:])
        trial = planned[who, int(row["position"])]
        assert (row["trial"], row["condition"], row["seed"]) == (str(trial.number), trial.condition, str(trial.seed))
        journal = read_journal(out / "people" / f"P{who:02d}" / "session.jsonl")[0]
        (driven,) = [one for one in journal if one["what"] == "driven" and one["trial"] == trial.number]
        (left,) = [one for one in journal if one["what"] == "left" and one["step"] == f"trial-{trial.position}"]
        began[who, trial.position] = left["wall_ns"], driven["wall_ns"]
        assert float(row["energy_kwh"]) == driven["measures"]["energy_kwh"]
        mine = [one["what"] for one in journal if one.get("trial") == trial.number]
        assert row["braked"] == str(int("braked" in mine))
        assert {one["trial"] for one in journal if "trial" in one} == {
            t.number for t in planned.values() if t.who == who
        }
        recording = read_recording(out / recording_file(trial))
        assert recording.complete
        own = {round(one["at"] * 1e6): one["ratio"] for one in levers[who - 1]}
        actions = [one.message for one in recording.of(ACTION) if one.message.device != das_pb2.Action.DEVICE_DESK]
        assert len(actions) > 10
        assert all(own[one.browser_ns] == pytest.approx(one.lever_ratio) for one in actions)
    for position in (1, 2):
        (one, one_ended), (other, other_ended) = began[1, position], began[2, position]
        assert max(one, other) < min(one_ended, other_ended)
    assert {row["participant"] for row in rows(out / "answers.csv")} == {"sub-01", "sub-02"}
