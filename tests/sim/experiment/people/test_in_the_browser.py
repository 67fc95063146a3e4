"""A whole session in Chromium, driven by keyboard: four trials, with reloads and kills between and within them."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("starlette", reason="the extra desk is not installed")

from das.bus.recording import read_recording
from sim.experiment.people.journal import read_journal
from tests.support.desk_page import DeskPage, chromium, desk_command, picture
from tests.support.people_study import rows, study

pytestmark = pytest.mark.nightly

CHANGES = [
    ("practice_trials = 1", "practice_trials = 0\nrepetitions = 2"),
    ("pace = 10", 'pace = 4\ntasks = ["pedal", "detection"]'),
    ('"tlx"]\n[desk]', '"tlx", "pedal_s", "detection_missed"]\n[desk]'),
]
LABELS = ("presentation = ", "guide_", "none_", "Does the guide help", "people.toml", "condition")

REACTION_S = 0.12
"""Time (s) after which a request is answered: an answer before 0.1 s would be an anticipation."""


@contextmanager
def at(design: Path, out: Path, who: str) -> Iterator[tuple[Any, str]]:
    arguments = (design.name, "-o", str(out), "--participant", who, "--language", "de")
    with desk_command(design.parent, *arguments, command=("experiment", "desk")) as found:
        yield found


class Person(DeskPage):
    """A participant at the page: reads, answers by keyboard, drives, and answers the tasks beside driving."""

    def __init__(self, context: Any, address: str) -> None:
        self.seen: list[str] = []
        self.asked_s: dict[str, float] = {}
        context.on("response", lambda one: self.seen.append(f"{one.url} {one.status}"))
        context.on("console", lambda one: self.seen.append(one.text))
        super().__init__(context, address)
        self.page.on("websocket", lambda one: one.on("framereceived", self._hear))

    def _hear(self, frame: Any) -> None:
        if '"t":"cab"' not in str(frame):
            self.seen.append(str(frame))

    def at_step(self, name: str) -> None:
        """Wait for a step."""
        self.until(lambda state: state["phase"] == "step" and state.get("step") == name, name)
        picture(self, f"session-{name}")

    def answer(self, name: str) -> None:
        """Answer every item of a questionnaire by keyboard, and go on."""
        self.at_step(name)
        keys = self.page.keyboard
        items = self.page.locator(".item").count()
        for _ in range(items):
            keys.press("Tab")
            keys.press("Space")
        keys.press("Tab")
        keys.press("Enter")

    def agree(self) -> None:
        """Press the button of the step."""
        self.page.click("#go")

    def depart(self, name: str) -> None:
        """Say ready, and drive off."""
        self.at_step(name)
        self.agree()
        self.lever = 0
        self.until(lambda state: state["phase"] == "driving" and "look" in state, "the first cab", 240)
        self.until(lambda state: state["may"] == "true", "the departure")
        self.until(self.pulls, "speed", 120)

    def pulls(self, state: dict[str, str]) -> bool:
        """Pull, again if a slow machine was braked for; whether the train is under way."""
        self.lever = round(int(state["lever"]) / 10)
        self.set(10)
        return float(state["speed"]) > 15

    def arrive(self) -> None:
        """Drive to the stop, and press the keys of the tasks when asked."""
        self.drive(self._looks)

    def _looks(self, state: dict[str, str]) -> None:
        if state["braked"] == "true":
            self.lever = 0
        for node, key in (("pedal", "v"), ("detection", "d")):
            if not self.page.is_visible(f"#{node}"):
                self.asked_s.pop(node, None)
            elif time.monotonic() - self.asked_s.setdefault(node, time.monotonic()) >= REACTION_S:
                self.page.keyboard.press(key)


def test_a_session_of_four_trials_with_reloads_and_kills_and_a_second_participant(tmp_path: Path) -> None:
    design, out = study(tmp_path / "design", *CHANGES), tmp_path / "out"
    with chromium() as browser, ExitStack() as commands:
        context = browser.new_context(viewport={"width": 1280, "height": 720})
        child, address = commands.enter_context(at(design, out, "P1"))
        page = Person(context, address)
        for name in ("consent", "instructions"):
            page.at_step(name)
            page.agree()
        page.answer("before-kss")
        page.depart("trial-1")
        page.page.reload()  # within a trial
        page.until(lambda state: state["phase"] == "driving" and "look" in state, "the trial again")
        page.until(page.pulls, "speed", 120)
        page.arrive()
        page.at_step("trial-1-tlx")
        page.page.reload()  # in a questionnaire
        page.answer("trial-1-tlx")
        page.at_step("trial-2")
        child.kill()  # between trials
        page.until(lambda state: state["link"] == "down", "the loss of the command")
        child, _ = commands.enter_context(at(design, out, "P1"))
        page.until(lambda state: state["link"] == "up", "the command again")
        page.depart("trial-2")
        child.kill()  # within a trial
        page.until(lambda state: state["link"] == "down", "the loss of the command")
        child, _ = commands.enter_context(at(design, out, "P1"))
        page.depart("trial-2")
        page.arrive()
        page.answer("trial-2-tlx")
        page.at_step("break-1")
        page.page.wait_for_selector("#go", state="visible")
        page.agree()

        _, other = commands.enter_context(at(design, out, "P2"))
        second = Person(browser.new_context(viewport={"width": 1024, "height": 768}), other)
        for name in ("consent", "instructions"):
            second.at_step(name)
            second.agree()
        second.answer("before-kss")
        second.depart("trial-1")
        second.page.click("header .quit")  # the train runs on meanwhile
        second.page.click("#leave")
        second.at_step("debriefing")

        for name in ("trial-3", "trial-4"):
            page.depart(name)
            page.arrive()
            page.answer(f"{name}-tlx")
        page.answer("after-sus")
        page.at_step("debriefing")
        page.agree()
        page.at_step("end")
        second.agree()
        second.at_step("end")
        assert page.errors == second.errors == []
        child.wait(30)
        assert child.returncode == 0
    told = "\n".join(page.seen + second.seen)
    assert [label for label in LABELS if label in told] == []
    trials, answers = rows(out / "trials.csv"), rows(out / "answers.csv")
    assert [row["position"] for row in trials if row["participant"] == "sub-01"] == ["1", "2", "3", "4"]
    assert {row["presentation"] for row in trials} == {"none", "guide"}
    for row in trials:
        assert float(row["tlx"]) == 50  # the middle of every scale
        assert 0.1 < float(row["pedal_s"]) < 5
        assert 0 <= float(row["detection_missed"]) < 1
    assert {row["value"] for row in answers if row["item"] == "score:kss"} == {"1.0"}
    kept = sorted((out / "recordings").iterdir())
    assert len([path for path in kept if "interrupted" in path.stem]) == 2  # the kill, and who stopped
    assert all(read_recording(path).complete for path in kept if "interrupted" not in path.stem)
    stopped = read_journal(out / "people" / "P02" / "session.jsonl")[0]
    assert "stopped" in [one["what"] for one in stopped]
