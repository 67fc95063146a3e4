"""A whole session of four trials in Chromium, with a reload, a killed command in a trial and between two of them."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import pytest

pytest.importorskip("starlette", reason="the extra desk is not installed")

from tests.sim.experiment.people.test_session import command, entered, journal, rows
from tests.support.desk_page import DeskPage, chromium
from tests.support.people_study import study

pytestmark = pytest.mark.nightly

CHANGES = (
    ("practice_trials = 1\nbreak_after = 2\nbreak_s = 1", "repetitions = 2\nbreak_after = 2\nbreak_s = 2"),
    ('after_trial = ["tlx"]', 'after_trial = ["kss"]'),
    ('before = ["kss"]\n', ""),
    ('after = ["sus"]\n', ""),
    ('"stops_missed", "tlx"]', '"stops_missed", "kss"]'),
    ("pace = 10", "pace = 4"),
)


def at_step(page: DeskPage, name: str) -> None:
    page.until(lambda state: (state["phase"], state.get("step"), state["link"]) == ("step", name, "up"), name, 120.0)


def goes_on(page: DeskPage, name: str) -> None:
    """Wait for a step, answer its items, and press its button."""
    at_step(page, name)
    for i in range(page.page.locator("fieldset .radios").count()):
        page.page.locator("fieldset .radios").nth(i).locator("label").nth(2).click()
    page.page.locator("#go").click(timeout=20_000)


def begins(page: DeskPage, number: int) -> None:
    """Press "ready", and drive until the train is fast."""
    goes_on(page, f"trial-{number}")
    page.phase("driving")
    page.lever = 0
    page.until(lambda state: state.get("may") == "true", "the departure")
    page.set(10)
    page.until(lambda state: float(state["speed"]) > 15, "speed")


def drives_on(page: DeskPage, number: int) -> None:
    """Drive to the end, and answer the questionnaire."""
    page.lever = round(int(page.state["lever"]) / 10)
    page.drive(lambda _state: None)
    goes_on(page, f"trial-{number}-kss")


def test_four_trials_with_a_reload_and_two_crashes(tmp_path: Path) -> None:
    design, out = study(tmp_path / "design", *CHANGES), tmp_path / "out"
    with ExitStack() as opened:
        browser = opened.enter_context(chromium())
        child, address = opened.enter_context(command(design, out))
        page = DeskPage(browser.new_context(viewport={"width": 1280, "height": 720}), address)
        assert page.text("title") == "" or page.state["link"] == "up"
        goes_on(page, "consent")
        goes_on(page, "instructions")
        begins(page, 1)
        page.page.reload()
        page.phase("driving")
        page.until(lambda state: "speed" in state, "the first cab")
        drives_on(page, 1)
        begins(page, 2)
        child.kill()
        page.until(lambda state: state["link"] == "down", "the loss of the server", 20.0)
        child, again = opened.enter_context(command(design, out))
        assert again == address
        begins(page, 2)  # the page has reconnected by itself, and the trial is driven again
        drives_on(page, 2)
        at_step(page, "break-1")
        child.kill()
        opened.enter_context(command(design, out))
        page.page.wait_for_timeout(3000)
        goes_on(page, "break-1")
        for number in (3, 4):
            begins(page, number)
            drives_on(page, number)
        goes_on(page, "debriefing")
        at_step(page, "end")
        assert page.errors == []
        labels = ("guide-", "four-mode", "speed-and-effort", "Does the guide")
        assert not [one for one in labels if one in page.page.content()]
    trials = rows(out / "trials.csv")
    assert [row["position"] for row in trials] == ["1", "2", "3", "4"]
    assert {row["presentation"] for row in trials} == {"none", "guide"}
    assert all(row["kss"] and float(row["energy_kwh"]) > 10 for row in trials)
    assert entered(out)[-1] == "end"
    assert [one["why"] for one in journal(out) if one["what"] == "interrupted"] == ["the session ended"]
    assert len(list((out / "recordings").iterdir())) == 5
