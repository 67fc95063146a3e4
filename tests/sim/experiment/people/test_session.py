"""A whole session with a person at the desk, through the page's socket: steps, trials, failures, data."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("starlette", reason="the extra desk is not installed")

from sim.experiment.analysis.comparing import read_study
from sim.experiment.people.journal import read_journal
from tests.support.people_study import Participant, session_of, study


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def journal(folder: Path, name: str = "P01") -> list[Any]:
    return read_journal(folder / "people" / name / "session.jsonl")[0]


@pytest.mark.slow
def test_a_session_from_consent_to_debriefing_with_reloads(tmp_path: Path) -> None:
    design, out = study(tmp_path / "design"), tmp_path / "out"
    seen: list[str] = []
    with session_of(design, out) as address:
        with Participant(address) as page:
            consent = page.step("consent")
            assert (consent["title"], consent["kind"]) == ("Do you want to take part?", "consent")
            assert consent["html"] == "<p>You may <em>stop</em> at any time.</p>\n"
            page.say("next", step="consent", at=1.0)  # without an answer
            page.say("next", step="instructions", at=1.0)  # not the present step
            page.goes_on(consent)
            instructions = page.step("instructions")
            assert "&lt;script&gt;" in instructions["html"]
            page.goes_on(instructions)
            sleepy = page.step("before-kss")
            item = sleepy["items"][0]["id"]
            page.say("answer", step="before-kss", item=item, value="77", at=1.0)  # off the scale
            page.say("next", step="before-kss", at=1.0)
            page.say("answer", step="before-kss", item=item, value="3", at=1.0)
            seen += page.seen
        with Participant(address) as page:  # a reload in a questionnaire
            again = page.step("before-kss")
            assert again["given"] == {item: "3"}
            page.say("next", step="before-kss", at=1.0)
            ready = page.step("trial-1")
            assert (ready["kind"], ready["of"]) == ("ready", 0)
            page.goes_on(ready)
            page.until(lambda one: one["t"] == "cab" and one["cab"]["speed_mps"] > 10)
            seen += page.seen
        with Participant(address) as page:  # a reload in a trial
            assert page.hear()["phase"] == "driving"
            assert page.step("trial-2")["of"] == 2
            page.goes_on(page.steps[-1])
            end = page.goes_until("end")
            assert end["kind"] == "end"
            seen += page.seen
    trials, answers = rows(out / "trials.csv"), rows(out / "answers.csv")
    assert [(row["position"], row["practice"], row["session"]) for row in trials] == [
        ("1", "1", "ses-01"), ("2", "0", "ses-01"), ("3", "0", "ses-02"),
    ]  # fmt: skip
    assert {row["presentation"] for row in trials} == {"none", "guide"}
    assert all(200 < float(row["running_time_s"]) < 400 and float(row["energy_kwh"]) > 10 for row in trials)
    assert [row["tlx"] for row in trials] == ["", "40.0", "40.0"]
    assert sorted(path.name.split("_seed")[0] for path in (out / "recordings").iterdir()) == [
        f"sub-01_run-00{row['position']}_{row['condition']}" for row in trials
    ]
    assert {row["item"] for row in answers} >= {"consent", item, "score:kss", "score:sus", "score:tlx"}
    assert {row["participant"] for row in answers} == {"sub-01"}
    study_read = read_study(out)
    assert study_read.design.name == "people"
    steps = [one["step"] for one in journal(out) if one["what"] == "entered"]
    assert steps == [
        "consent", "instructions", "before-kss", "trial-1", "trial-2", "trial-2-tlx", "break-1", "trial-3",
        "trial-3-tlx", "after-sus", "debriefing", "end",
    ]  # fmt: skip
    assert not (out / "people" / "P01" / "door.json").exists()
    texts = " ".join(seen)
    for label in ("guide", 'presentation"', "speed-and-effort", "four-mode", "disturbance", "people.toml"):
        assert label not in texts, label
    assert json.loads((out / "design.json").read_text())["desk"]["after_trial"] == ["tlx"]
