"""A session with a person at the desk, through the page's socket: steps, trials, failures, data."""

from __future__ import annotations

import asyncio
import json
import signal
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from threading import Barrier
from typing import Any
from unittest.mock import Mock

import psutil
import pytest

pytest.importorskip("starlette", reason="the extra desk is not installed")

from websockets.exceptions import ConnectionClosed

from das.bus.recording import read_recording
from das.bus.topics import MARK
from das.domain.errors import DasError
from sim.desk.host import listening
from sim.desk.messages import Stopped, WentOn
from sim.experiment.analysis.comparing import read_study
from sim.experiment.design import read_design
from sim.experiment.people.journal import PersonJournal, read_journal
from sim.experiment.people.session import Session, Sitting, _kept, _listening
from sim.experiment.people.watching import WatcherNote
from tests.support.desk_page import desk_command
from tests.support.making import refusal
from tests.support.people_study import Participant, at_once, check_at_once, rows, session_of, study

LABELS = ("guide", "presentation", "speed-and-effort", "four-mode", "_none", "people.toml", "Does the guide help")
"""Words that would tell a participant the condition or the purpose."""


def journal(folder: Path, name: str = "P01") -> list[Any]:
    return read_journal(folder / "people" / name / "session.jsonl")[0]


def entered(folder: Path, name: str = "P01") -> list[str]:
    return [one["step"] for one in journal(folder, name) if one["what"] == "entered"]


def drives(page: Participant) -> None:
    """The page drives at more than 10 m/s."""
    page.until(lambda one: one["t"] == "cab" and one["cab"]["speed_mps"] > 10)


def told(texts: list[str]) -> set[str]:
    """The labels among the texts that the browser received; the fields of a cab are numbers but its stop's name."""
    plain = [text.replace('"presentations"', "") for text in texts if '"t":"cab"' not in text]
    return {label for label in LABELS if any(label in text for text in plain)}


def test_who_refuses_drives_nothing(tmp_path: Path) -> None:
    with session_of(study(tmp_path / "design"), tmp_path) as (address, _), Participant(address) as page:
        page.goes_on(page.step("consent"), consent="no")
        assert page.step()["id"] == "end"
    assert entered(tmp_path) == ["consent", "end"]
    assert (tmp_path / "trials.csv").read_text().count("\n") == 1
    assert [row["value"] for row in rows(tmp_path / "answers.csv")] == ["no"]


def test_two_participants_at_two_desks_and_one_stops_in_a_questionnaire(tmp_path: Path) -> None:
    design = study(tmp_path / "design")
    with ExitStack() as open_ones:
        first, _ = open_ones.enter_context(session_of(design, tmp_path, 1))
        second, watch = open_ones.enter_context(session_of(design, tmp_path, 2))
        assert len({first, second, watch}) == 3
        with pytest.raises(DasError, match="participant P02 is at a desk already"), session_of(design, tmp_path, 2):
            pass
        one, two = (open_ones.enter_context(Participant(address)) for address in (first, second))
        for page in (one, two):
            page.goes_on(page.step("consent"))
            page.goes_on(page.step("instructions"))
        kss = one.step("before-kss")
        one.say("next", step="before-kss", at=1.0)  # the needed answer is missing
        one.say("answer", step="before-kss", item=kss["items"][0]["id"], value="99", at=1.0)
        one.say("answer", step="consent", item="consent", value="no", at=1.0)
        one.say("answer", step="before-kss", item=kss["items"][0]["id"], value="[7}", at=1.0)
        one.say("stop", at=1.0)
        assert one.step()["id"] == "debriefing"
        one.say("stop", at=2.0)
        one.goes_on(one.steps[-1])
        assert one.step()["id"] == "end"
        assert two.goes_until("trial-1")["kind"] == "ready"
        two.say("stop", at=1.0)
        two.goes_on(two.step("debriefing"))
        assert two.step()["id"] == "end"
        assert told(one.seen + two.seen) == set()
    assert entered(tmp_path) == ["consent", "instructions", "before-kss", "debriefing", "end"]
    assert [one["what"] for one in journal(tmp_path)].count("stopped") == 1
    assert [one["what"] for one in journal(tmp_path)].count("answered") == 1
    assert {row["participant"] for row in rows(tmp_path / "answers.csv")} == {"sub-01", "sub-02"}


def test_a_journal_that_cannot_be_written_ends_the_session_and_nothing_shows_that_is_not_in_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(journal: PersonJournal, _line: bytes) -> None:
        raise DasError(f"{journal.path}: cannot be written (No space left on device)")

    def takes_part() -> None:
        with session_of(study(tmp_path / "d"), tmp_path) as (address, _), Participant(address) as page:
            consent = page.step("consent")
            monkeypatch.setattr(PersonJournal, "append", full)
            with suppress(ConnectionClosed):
                page.goes_on(consent)
                assert page.hear()["t"] != "step"

    with pytest.raises(DasError, match="No space left"):
        takes_part()
    assert [one["what"] for one in journal(tmp_path)] == ["entered"]


def test_an_altered_journal_and_a_cut_door_of_others_stop_nobody(tmp_path: Path) -> None:
    for name, file in (("P01", "door.json"), ("P02", "session.jsonl")):
        (tmp_path / "people" / name).mkdir(parents=True)
        (tmp_path / "people" / name / file).write_text("{\n")
    with (
        session_of(study(tmp_path / "d"), tmp_path) as (address, watch),
        Participant(address) as page,
        Participant(watch, "/watching") as experimenter,
    ):
        page.goes_on(page.step("consent"), consent="no")
        page.step("end")
        others = experimenter.until(lambda one: one["t"] == "state" and one["step"] == "end")["others"]
    assert {one["participant"]: one["state"] for one in others} == {
        "P01": "end", "P02": "altered", "P03": "not_begun", "P04": "not_begun",
    }  # fmt: skip


def test_text_of_the_laboratory_is_shown_without_its_html(tmp_path: Path) -> None:
    with session_of(study(tmp_path / "design"), tmp_path) as (address, _), Participant(address) as page:
        consent = page.step("consent")
        assert (consent["title"], consent["html"]) == (
            "Do you want to take part?", "<p>You may <em>stop</em> at any time.</p>\n",
        )  # fmt: skip
        page.goes_on(consent)
        assert "<script>" not in page.step("instructions")["html"]
        page.say("stop", at=1.0)
        page.goes_on(page.step("debriefing"))
        page.step("end")


def sitting(tmp_path: Path) -> Sitting:
    design, out = read_design(study(tmp_path / "design")), tmp_path / "out"
    return Sitting(design=design, folder=out, who=1, language="en", command="a test")


def test_a_full_disk_ends_the_session_with_its_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mine = sitting(tmp_path)
    with PersonJournal(mine.own) as journal:
        session = Session(mine, journal)
        session.opened()
        full = DasError("session.jsonl: cannot be written (No space left on device)")
        monkeypatch.setattr(journal, "add", Mock(side_effect=full))
        with pytest.raises(DasError, match="No space left"):
            session.on_watch(WatcherNote(text="He yawns."))
        assert session.failed is full
        assert session.over.is_set()


def test_who_stops_at_once_after_ready_drives_no_trial(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim.experiment.people.session.RunningTrial", Mock(side_effect=AssertionError))
    mine = sitting(tmp_path)
    with PersonJournal(mine.own) as journal:
        for step in ("consent", "instructions", "before-kss"):
            journal.add(step, "left")
        session = Session(mine, journal)

        async def both() -> None:
            session.on_page(WentOn(step="trial-1", at=1.0))
            session.on_page(Stopped(at=1.0))
            await asyncio.sleep(0.1)

        asyncio.run(both())
        assert session.failed is None
        assert session.standing.step.id == "debriefing"


def test_a_taken_port_and_an_altered_door_are_replaced(tmp_path: Path) -> None:
    path, kept = tmp_path / "door.json", {"port": 1, "token": "a", "watch_token": "b"}
    path.write_text(json.dumps(kept))
    assert _kept(path) == kept
    for text in ('{"port": 1}', "[]", '{"port"', json.dumps(kept | {"port": "1"})):
        path.write_text(text)
        assert _kept(path)["port"] == 0
        assert len(_kept(path)["token"]) > 20
    with listening(0) as door:
        taken = door.getsockname()[1]
        with _listening(0, taken) as other:
            assert other.getsockname()[1] != taken
        with pytest.raises(DasError, match=f"--port {taken}: cannot listen"):
            _listening(taken, taken)


@pytest.mark.nightly
def test_a_session_from_consent_to_debriefing_with_reloads(tmp_path: Path) -> None:
    beside = ("pace = 10", 'pace = 10\ntasks = ["pedal"]\nprobe = "kss"')
    measures = ('"tlx"]\n[desk]', '"tlx", "kss", "pedal_s", "pedal_missed"]\n[desk]')
    design, out = study(tmp_path / "design", beside, measures), tmp_path / "out"
    seen: list[str] = []
    with session_of(design, out) as (address, _):
        with Participant(address) as page:
            kss = page.goes_until("before-kss")
            item = kss["items"][0]["id"]
            page.say("answer", step="before-kss", item=item, value="3", at=1.0)
            seen += page.seen
        with Participant(address) as page:  # a reload in a questionnaire
            assert page.step("before-kss")["given"] == {item: "3"}
            page.say("next", step="before-kss", at=1.0)
            ready = page.step("trial-1")
            assert (ready["kind"], ready["of"]) == ("ready", 0)
            page.goes_on(ready)
            drives(page)
            seen += page.seen
        with Participant(address) as page:  # a reload in a trial
            assert page.hear()["phase"] == "driving"
            assert page.step("trial-1-probe-1")["kind"] == "form"
            seen += page.seen
        with Participant(address) as page:  # a reload in a probe, which stops the run
            probe = page.step("trial-1-probe-1")
            page.goes_on(probe)
            assert page.until(lambda one: one["t"] == "hello")["phase"] == "driving"
            assert page.until(lambda one: one["t"] == "task")["what"] == "pedal"
            trial = page.step("trial-2")
            assert (trial["done"], trial["of"]) == (0, 2)
            page.goes_on(trial)
            assert page.goes_until("end")["kind"] == "end"
            seen += page.seen
    trials, answers = rows(out / "trials.csv"), rows(out / "answers.csv")
    assert [(row["position"], row["practice"], row["session"]) for row in trials] == [
        ("1", "1", "ses-01"), ("2", "0", "ses-01"), ("3", "0", "ses-02"),
    ]  # fmt: skip
    assert {row["presentation"] for row in trials} == {"none", "guide"}
    assert all(float(row["running_time_s"]) > 200 and float(row["energy_kwh"]) > 10 for row in trials)
    assert [row["tlx"] for row in trials] == ["", "40.0", "40.0"]
    assert [(row["kss"], row["pedal_s"], row["pedal_missed"]) for row in trials] == [("1.0", "", "1.0")] * 3
    assert not any(float(row["stops_missed"]) for row in trials)
    assert sorted(path.name.split("_seed")[0] for path in (out / "recordings").iterdir()) == [
        f"sub-01_run-00{row['position']}_{row['condition']}" for row in trials
    ]
    recording = read_recording(next((out / "recordings").glob("*run-003*")))
    run = recording.metadata["run"]
    assert (run["driver"], run["seed"], recording.complete) == ("desk", trials[2]["seed"], True)
    assert {row["item"] for row in answers} >= {"consent", item, "score:kss", "score:sus", "score:tlx"}
    assert read_study(out).design.name == "people"
    probes = [f"trial-{position}-probe-1" for position in (1, 2, 3)]
    assert [step for step in entered(out) if step in probes] == probes
    assert [step for step in entered(out) if step not in probes] == [
        "consent", "instructions", "before-kss", "trial-1", "trial-2", "trial-2-tlx", "break-1", "trial-3",
        "trial-3-tlx", "after-sus", "debriefing", "end",
    ]  # fmt: skip
    assert not (out / "people" / "P01" / "door.json").exists()
    assert told(seen) == set()


@contextmanager
def command(design: Path, out: Path, *more: str) -> Iterator[tuple[Any, str]]:
    arguments = (design.name, "-o", str(out), "--participant", "P1", *more)
    with desk_command(design.parent, *arguments, command=("experiment", "desk")) as found:
        yield found


def takes_part(design: Path, out: Path, who: str, ready: Barrier) -> list[dict[str, Any]]:
    """The session of a participant, who departs when the other one does; returns the settings of the lever."""
    arguments = (design.name, "-o", str(out), "--participant", who)
    with desk_command(design.parent, *arguments, command=("experiment", "desk")) as (child, address):
        with Participant(address) as page:
            for name in ("trial-1", "trial-2"):
                step = page.goes_until(name)
                ready.wait(300)
                page.goes_on(step)
            page.goes_until("end")
        child.wait(60)
        assert child.returncode == 0
    return [one for one in page.said if one["t"] == "lever"]


@pytest.mark.nightly
def test_two_participants_drive_at_the_same_time_and_nothing_is_mixed(tmp_path: Path) -> None:
    design, out = study(tmp_path / "design", ("practice_trials = 1", "practice_trials = 0")), tmp_path / "out"
    check_at_once(design, out, at_once(partial(takes_part, design, out)))


@pytest.mark.nightly
def test_a_killed_command_a_killed_trial_and_ctrl_c_lose_nothing(tmp_path: Path) -> None:
    """The command is killed in a trial, then the trial's process; then Ctrl-C ends the command between trials."""
    changes = [("practice_trials = 1", "practice_trials = 0"), ('before = ["kss"]\n', "")]
    design, out = study(tmp_path / "design", *changes), tmp_path / "out"
    with command(design, out) as (child, address):
        with Participant(address) as page:
            page.goes_on(page.goes_until("trial-1"))
            drives(page)
            child.kill()
        child.wait(20)
    door = out / "people" / "P01" / "door.json"
    assert door.stat().st_mode & 0o777 == 0o600
    with command(design, out) as (child, again):
        assert again == address  # an open page reconnects by itself
        with Participant(address) as page:
            page.goes_on(page.step("trial-1"))
            drives(page)
            children = psutil.Process(child.pid).children()
            next(one for one in children if "sim.experiment.people.trial" in one.cmdline()).kill()
            page.goes_on(page.step("trial-1"))
            assert page.step()["id"] == "trial-1-tlx"
        child.send_signal(signal.SIGINT)
        _, said = child.communicate(timeout=60)
    assert "Traceback" not in said
    assert "trial 1 (P01): interrupted: the trial was killed by SIGKILL" in said
    assert [one["why"] for one in journal(out) if one["what"] == "interrupted"] == [
        "the session ended", "the trial was killed by SIGKILL",
    ]  # fmt: skip
    names = sorted(path.stem.rpartition("_")[2] for path in (out / "recordings").iterdir())
    assert names[:2] == ["interrupted-1", "interrupted-2"]
    assert len(names) == 3
    assert [row["position"] for row in rows(out / "trials.csv")] == ["1"]
    with command(design, out) as (_, third), Participant(third) as page:
        page.step("trial-1-tlx")


@pytest.mark.nightly
def test_the_experimenter_sees_the_trial_marks_it_and_ends_it(tmp_path: Path) -> None:
    changes = [("practice_trials = 1", "practice_trials = 0"), ("pace = 10", 'pace = 10\ninterrupted = "skip"')]
    with session_of(study(tmp_path / "design", *changes), tmp_path) as (address, watch), Participant(address) as page:
        page.goes_on(page.goes_until("trial-1"))
        with Participant(watch, "/watching") as experimenter:
            drives(page)
            state = experimenter.until(lambda one: one["t"] == "state" and (one["driven_s"] or 0) > 25)
            assert (state["participant"], state["step"], state["trial"], state["of"]) == ("P01", "trial-1", 1, 2)
            assert state["condition"] in ("none", "guide")
            assert state["cab"]["speed_mps"] > 0
            experimenter.say("mark", text="1")
            experimenter.say("note", text="He yawns.")
            experimenter.say("abort")
            assert page.step()["id"] == "trial-2"  # the trial and its questionnaire are skipped
            state = experimenter.until(lambda one: one.get("step") == "trial-2")
            events = [(one["step"], one["what"], one["said"]) for one in state["events"]]
            assert events[-3:] == [
                ("trial-1", "mark", "1"), ("trial-1", "note", "He yawns."),
                ("trial-1", "interrupted", "ended by the experimenter"),
            ]  # fmt: skip
        page.say("stop", at=1.0)
        page.goes_on(page.step("debriefing"))
        page.step("end")
    recording = read_recording(next((tmp_path / "recordings").glob("*_interrupted-1.mcap")))
    assert [entry.message.text for entry in recording.of(MARK) if entry.message.text] == ["1"]


def test_simulated_drivers_do_not_drive_what_people_drive(tmp_path: Path) -> None:
    design, out = study(tmp_path / "design"), tmp_path / "out"
    said = refusal("experiment", "run", str(design), "-o", "out", cwd=tmp_path)
    assert f"people drive these trials: das-sim experiment desk {design} -o out --participant P1" in said
    assert not out.exists()
    (out / "people").mkdir(parents=True)
    said = refusal("experiment", "run", "smoke", "-o", "out", cwd=tmp_path)
    assert "expected another folder for simulated drivers" in said
    (out / "trials.csv").write_text("mine")
    said = refusal("experiment", "desk", str(design), "-o", "out", "--participant", "P1", cwd=tmp_path)
    assert "out/trials.csv: exists without a design: expected a new folder" in said
    assert (out / "trials.csv").read_text() == "mine"
    (out / "finished.jsonl").touch()
    said = refusal("experiment", "desk", str(design), "-o", "out", "--participant", "P1", cwd=tmp_path)
    assert "expected another folder for people" in said
    assert "--participant Anna: expected P1 to P4" in refusal(
        "experiment", "desk", str(design), "-o", "new", "--participant", "Anna", cwd=tmp_path
    )
    assert not (tmp_path / "new").exists()
