"""The steps of a participant, the present one after every kind of journal, and the tables made from journals."""

from __future__ import annotations

import json
import math
import resource
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from das.domain.errors import DasError
from sim.experiment.checking import check_design
from sim.experiment.design import Design, design_files, freeze, load_design, read_design, read_frozen, resolved
from sim.experiment.driving import WatchedDriver
from sim.experiment.people.journal import PersonJournal, journal_files, read_journal, write_tables
from sim.experiment.people.steps import (
    SessionStep,
    Standing,
    described,
    plan_of,
    standing,
    steps_of,
)
from sim.experiment.people.trial import longest_held_s
from sim.experiment.people_plan import Interrupted, PeoplePlan, bundled_forms
from sim.experiment.study_files import participant_number
from tests.support.making import REPOSITORY
from tests.support.people_study import study

ALL = [
    "consent", "instructions", "before-kss", "trial-1", "trial-2", "trial-2-tlx", "break-1", "trial-3", "trial-3-tlx",
    "after-sus", "debriefing", "end",
]  # fmt: skip
LONG = f"{'q' * 41}.toml"


@pytest.fixture
def design(tmp_path: Path) -> Design:
    return read_design(study(tmp_path))


def entry(step: str, what: str, **more: Any) -> dict[str, Any]:
    return {"wall_ns": 10**18, "step": step, "what": what, **more}


def entries_before(steps: Sequence[SessionStep], name: str) -> list[dict[str, Any]]:
    """The journal of a participant who has done all steps before one."""
    found = []
    for step in steps:
        if step.id == name:
            return found
        found.append(entry(step.id, "left"))
        if step.kind == "ready":
            found.append(entry(step.id, "driven", trial=1, measures={}, held_s=60.0))
    raise AssertionError(name)


def at(design: Design, entries: Sequence[dict[str, Any]], **plan: Any) -> Standing:
    return standing(steps_of(design, 1), entries, replace(plan_of(design), **plan))


def test_a_participant_does_the_steps_of_the_design_in_order(design: Design) -> None:
    steps = steps_of(design, 1)
    assert [step.id for step in steps] == ALL
    assert [step.id for step in steps if step.to_criterion] == ["trial-1"]
    assert [step.wait_s for step in steps if step.wait_s] == [1.0]
    for name in ALL:
        assert at(design, entries_before(steps, name)).step.id == name
    assert described(design) == (
        "consent; instructions; kss; practice with guide (±3 km/h for 5 s, or 1 drive); 2 trials, each with tlx; "
        "1 break of 1 s; sus; debriefing"
    )


def test_no_step_names_a_condition(design: Design) -> None:
    for who in range(1, 5):
        steps = steps_of(design, who)
        assert [step.id for step in steps] == ALL
        assert {step.about for step in steps} & {"guide", "none"} == set()
        assert {step.trial.condition for step in steps if step.trial is not None} == {"none", "guide"}


def test_only_trials_without_practice_are_counted(design: Design) -> None:
    steps = steps_of(design, 1)
    counts = {name: (at(design, found).done, at(design, found).of)
              for name in ALL for found in [entries_before(steps, name)]}  # fmt: skip
    assert (counts["consent"], counts["trial-2"], counts["trial-3"], counts["end"]) == ((0, 2), (0, 2), (1, 2), (2, 2))


def test_who_refuses_goes_to_the_end_and_who_stops_to_the_debriefing(design: Design) -> None:
    refused = [entry("consent", "answered", item="consent", value="no")]
    assert at(design, refused).step.id == "consent"  # he may still change his mind
    refused.append(entry("consent", "left"))
    assert at(design, refused).step.id == "end"
    before = entries_before(steps_of(design, 1), "trial-2")
    stopped = [*before, entry("trial-2", "left"), entry("trial-2", "stopped")]
    assert at(design, stopped).step.id == "debriefing"
    assert at(design, [*stopped, entry("debriefing", "left")]).step.id == "end"


def test_an_interrupted_trial_is_driven_again_or_skipped_with_its_questionnaires(design: Design) -> None:
    found = [*entries_before(steps_of(design, 1), "trial-2"), entry("trial-2", "left")]
    assert at(design, found).running
    found.append(entry("trial-2", "interrupted", why="a test"))
    again = at(design, found)
    assert (again.step.id, again.running) == ("trial-2", False)
    assert at(design, found, interrupted=Interrupted.SKIP).step.id == "break-1"


def test_practice_is_repeated_until_its_criterion_or_its_number(design: Design) -> None:
    found = entries_before(steps_of(design, 1), "trial-1")
    drive = [entry("trial-1", "left"), entry("trial-1", "driven", trial=1, measures={}, held_s=4.0)]
    assert at(design, found + drive, practice_most=3).step.id == "trial-1"
    assert at(design, found + drive * 2, practice_most=3).step.id == "trial-1"
    assert at(design, found + drive * 3, practice_most=3).step.id == "trial-2"
    assert at(design, found + drive, practice_most=3, practice_hold_s=4.0).step.id == "trial-2"


def test_a_break_counts_from_when_it_was_first_shown(design: Design) -> None:
    found = entries_before(steps_of(design, 1), "break-1")
    assert at(design, found).wait_s(10**18) == 1.0
    found += [entry("break-1", "entered"), entry("break-1", "note", text="coffee")]
    assert at(design, found).wait_s(10**18 + 400_000_000) == pytest.approx(0.6)
    assert at(design, found).wait_s(10**18 + 4 * 10**9) == 0.0


@pytest.mark.parametrize("text", ["P0", "P5", "7", "p1", "P1x", "Anna", "P000001", ""])
def test_a_participant_is_a_pseudonym_of_the_design(text: str) -> None:
    assert participant_number("P04", 4) == participant_number("P4", 4) == 4
    with pytest.raises(DasError, match=f"--participant {text}: expected P1 to P4"):
        participant_number(text, 4)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('consent = "consent.md"', 'consent = "gone.md"', "desk.consent = 'gone.md': expected a Markdown file"),
        ('consent = "consent.md"', 'consent = "/etc/consent.md"', "expected a Markdown file (.md) beside the design"),
        ('before = ["kss"]', 'before = ["mood"]', "desk.before = 'mood': expected each once, of kss, sus, tlx, trust"),
        ('before = ["kss"]', 'before = ["kss", "kss"]', "desk.before = 'kss': expected each once"),
        ('before = ["kss"]', 'before = ["kss", "own/kss.toml"]', "expected each once, also without folder"),
        ('before = ["kss"]', f'before = ["{LONG}"]', "named with at most 40 letters, digits, - and _"),
        ('after_trial = ["tlx"]', 'after_trial = ["tlx", "own/kss.toml"]',
         "kss.toml: scores.name = 'energy_kwh': expected a name that no measure, column, factor or other score"),
        ('consent = "consent.md"', 'consent = "latin.md"', "latin.md: not a UTF-8 text file"),
        ("pace = 10", "pace = 0", "desk.pace = 0.0: expected a number from 0.1 to 100"),
        ("pace = 10", "probes = 2", "desk.probe is missing: expected of kss, sus, tlx, trust, or a TOML file"),
        ("pace = 10", 'tasks = ["radio"]', "desk.tasks = ['radio']: expected a list of names from pedal, detection"),
        ("pace = 10", 'interrupted = "again"', "desk.interrupted = 'again': expected one of repeat, skip"),
        ("pace = 10", "speed = 10", "desk.speed = 10: expected one of the keys"),
        ('levels = ["none", "guide"]', 'levels = ["none", 3]', "levels = 3"),
        ('"stops_missed", "tlx"]', '"stops_missed", "sus"]', "analysis.measures = 'sus': expected one of"),
        ('name = "presentation"\nlevels = ["none", "guide"]', 'name = "driver"\nlevels = ["human", "desk"]',
         "levels = 'desk': expected simulated drivers; for people fixed.driver = 'desk'"),
    ],
)  # fmt: skip
def test_a_table_that_cannot_be_used_is_one_clear_error(tmp_path: Path, old: str, new: str, expected: str) -> None:
    form = '[[items]]\nid = "a"\nleast = 0\nmost = 9\ntext = "A"\n[[scores]]\nname = "energy_kwh"\n'
    (tmp_path / "own").mkdir()
    for name in ("own/kss.toml", LONG):
        (tmp_path / name).write_text(f'schema_version = 1\ntitle = "Own"\n{form}')
    (tmp_path / "latin.md").write_bytes(b"\xe9")
    changes = [(old, new)] + ([('driver = "desk"\n', "")] if '"driver"' in new else [])
    with pytest.raises(DasError) as raised:
        check_design(read_design(study(tmp_path, *changes)))
    assert expected in str(raised.value)


@pytest.mark.parametrize("score", ["energy_kwh", "pedal_s", "tlx"])
def test_a_score_does_not_replace_a_measure_or_another_score(tmp_path: Path, score: str) -> None:
    path = study(tmp_path, ('after_trial = ["tlx"]', 'after_trial = ["tlx", "own.toml"]'))
    own = bundled_forms()["kss"].read_text(encoding="utf-8")
    assert own.count('name = "kss"') == 1
    (tmp_path / "own.toml").write_text(own.replace('name = "kss"', f'name = "{score}"'), encoding="utf-8")
    with pytest.raises(DasError, match=rf"own\.toml: scores\.name = '{score}': expected a name that no measure"):
        check_design(read_design(path))


def test_the_table_of_the_manual_is_read(tmp_path: Path) -> None:
    page = (REPOSITORY / "docs" / "how-to" / "run-people-at-the-desk.md").read_text(encoding="utf-8")
    table = page.partition("```toml\n")[2].partition("```")[0]
    path = study(tmp_path)
    shutil.copy(bundled_forms()["kss"], tmp_path / "awareness.toml")
    path.write_text(path.read_text(encoding="utf-8").partition("[desk]")[0] + table, encoding="utf-8")
    design = read_design(path)
    assert described(design) == (
        "consent; kss; practice with guide (±3 km/h for 60 s, or 3 drives); 2 trials, each with tlx; pedal; "
        "2 probes in each (awareness.toml); 1 break of 1 s"
    )


def test_simulated_drivers_of_another_kind_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DasError, match=r"driver = perfect: expected fixed\.driver = 'desk', or no driver"):
        plan_of(read_design(study(tmp_path, ('driver = "desk"', 'driver = "perfect"'))))
    assert plan_of(read_design(study(tmp_path, ('driver = "desk"', 'driver = "human"')))).before == ("kss",)


def test_the_texts_and_questionnaires_are_frozen_with_the_design(tmp_path: Path) -> None:
    path, folder = study(tmp_path / "d"), tmp_path / "out"
    found = freeze(read_design(path), folder)
    assert {name for name in found["files"] if name.startswith("desk")} == {
        f"desk: {name}" for name in ("consent.md", "instructions.md", "debriefing.md", "kss", "tlx", "sus")
    }
    assert str(tmp_path) not in json.dumps(found)
    assert resolved(read_design(folder / "design.toml")) == found  # the texts are beside the kept design
    assert read_frozen(folder).desk == replace(plan_of(read_design(path)), folder=folder)
    (path.parent / "consent.md").write_text("Other words.\n", encoding="utf-8")
    with pytest.raises(DasError, match="expected the same design, or another folder"):
        freeze(read_design(path), folder)
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "consent.md").write_text("mine")
    with pytest.raises(DasError, match=r"taken/consent\.md: exists and differs from .*: expected another folder"):
        freeze(read_design(path), tmp_path / "taken")
    assert [one.name for one in (tmp_path / "taken").iterdir()] == ["consent.md"]
    (path.parent / "consent.md").unlink()
    with pytest.raises(DasError, match=r"consent\.md"):
        design_files(replace(load_design("smoke"), desk=PeoplePlan(consent="consent.md", folder=path.parent)))


def test_the_criterion_of_practice_is_the_longest_time_near_the_shown_speed_or_the_limit() -> None:
    def second(speed_mps: float, shown_mps: float | None) -> Any:
        shown = None if shown_mps is None else SimpleNamespace(shown_speed_mps=shown_mps)
        return SimpleNamespace(speed_mps=speed_mps), SimpleNamespace(limit_mps=30.0, shown=shown)

    near, far, at_limit = second(20.5, 20.0), second(22.0, 20.0), second(29.5, math.nan)
    driven: Any = SimpleNamespace(moving=[near, near, far, near, at_limit, second(30.5, None), far, near])
    assert longest_held_s(driven, 1.0) == 3.0
    assert longest_held_s(driven, 0.1) == 0.0


def test_a_run_begins_with_a_driver_in_another_process_although_it_is_watched() -> None:
    class Outside:
        def begin(self, link: object) -> None:
            """Wait for the other process."""

        def command(self, cab: object) -> Any:
            """Ask the other process."""

    outside = Outside()
    assert WatchedDriver(outside).begin == outside.begin
    assert WatchedDriver(WatchedDriver(SimpleNamespace(command=outside.command))).begin is None


def test_a_cut_last_line_is_removed_and_an_altered_one_is_an_error(tmp_path: Path) -> None:
    with PersonJournal(tmp_path / "P01") as journal:
        journal.add("consent", "entered")
        journal.add("consent", "answered", item="consent", value="já")
        with pytest.raises(DasError, match="participant P01 is at a desk already"), PersonJournal(tmp_path / "P01"):
            pass
    path = journal.path
    with path.open("ab") as file:
        file.write(b'{"wall_ns": 17, "st')
    assert [one["what"] for one in read_journal(path)[0]] == ["entered", "answered"]
    with PersonJournal(tmp_path / "P01") as journal:
        journal.add("consent", "left")
    assert [one["what"] for one in read_journal(path)[0]] == ["entered", "answered", "left"]
    whole = path.read_bytes()
    for old, new in ((b'"answered"', b"answered"), (b'"value"', b'"worth"'), (b'"answered"', b'"driven"')):
        path.write_bytes(whole.replace(old, new))
        with pytest.raises(DasError, match="line 2: expected a line as a session writes it"):
            read_journal(path)


def test_a_journal_that_is_a_link_is_refused_and_nothing_is_cut(tmp_path: Path) -> None:
    (tmp_path / "other").write_text("no line end")
    (tmp_path / "P01").mkdir()
    (tmp_path / "P01" / "session.jsonl").symlink_to(tmp_path / "other")
    with pytest.raises(DasError, match="is a symbolic link"), PersonJournal(tmp_path / "P01"):
        pass
    assert (tmp_path / "other").read_text() == "no line end"


def test_a_line_that_does_not_fit_on_the_disk_is_an_error_and_leaves_no_part_of_it(tmp_path: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with PersonJournal(tmp_path / "P01") as journal:
        journal.add("consent", "entered")
        resource.setrlimit(resource.RLIMIT_FSIZE, (journal.path.stat().st_size + 20, hard))
        try:
            with pytest.raises(DasError, match="cannot be written"):
                journal.add("consent", "answered", item="consent", value="yes")
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        journal.add("consent", "left")
        assert [one["what"] for one in journal.entries] == ["entered", "left"]
    assert read_journal(journal.path)[0] == journal.entries


def test_only_the_last_drive_of_a_trial_counts_with_its_tasks_and_probes(tmp_path: Path) -> None:
    """The requests of a task are numbered from 1 in each drive."""
    changes = [('"tlx"]\n[desk]', '"tlx", "kss", "pedal_missed"]\n[desk]'),
               ("pace = 10", 'pace = 10\ntasks = ["pedal"]\nprobe = "kss"')]  # fmt: skip
    design, out = read_design(study(tmp_path, *changes)), tmp_path / "out"
    with PersonJournal(out / "people" / "P01") as journal:
        for end, kss, pressed in (("driven", 2.0, True), ("interrupted", 9.0, True), ("driven", 4.0, False)):
            journal.add("trial-1", "left", trial=1)
            acts = [("shown", 0.0, 0.0), ("answered", 1500.0, 1000.0), ("gone", 6000.0, 0.0)]
            for event, wall_ms, drawn_ms in acts if pressed else acts[::2]:
                act = {"task": "pedal", "number": 1, "event": event, "wall_ms": wall_ms, "drawn_ms": drawn_ms}
                journal.add("trial-1", "act", trial=1, **act)
            journal.add("trial-1-probe-1", "left", trial=1, scores={"kss": kss})
            journal.add("trial-1", end, trial=1, **({"measures": {}, "held_s": 1.0} if end == "driven" else {}))
    write_tables(design, out)
    assert (out / "trials.csv").read_text().splitlines()[1].endswith(",4.0,1.0")


def test_the_tables_have_the_last_drive_and_the_last_answers_of_everybody(design: Design, tmp_path: Path) -> None:
    out = tmp_path / "out"
    for who, energy in ((2, 30.0), (1, 20.0)):
        with PersonJournal(out / "people" / f"P{who:02d}") as journal:
            number = 3 * (who - 1) + 2
            for kwh in (99.0, energy):
                journal.add("trial-2", "driven", trial=number, measures={"energy_kwh": kwh}, held_s=1.0)
            for value in ("10", "40"):
                journal.add("trial-2-tlx", "answered", trial=number, item="mental", value=value)
            journal.add("trial-2-tlx", "left", trial=number, scores={"tlx": 40.0})
            journal.add("after-sus", "left", scores={"sus": 70.0})
    assert list(journal_files(out)) == [1, 2]
    write_tables(design, out)
    trials = (out / "trials.csv").read_text().splitlines()
    assert trials[0].endswith("seed,energy_kwh,running_time_s,stops_missed,tlx")
    assert [line.split(",")[0] for line in trials[1:]] == ["2", "5"]
    assert [line.split(",")[-4:] for line in trials[1:]] == [["20.0", "", "", "40.0"], ["30.0", "", "", "40.0"]]
    answers = [line.split(",")[:5] for line in (out / "answers.csv").read_text().splitlines()]
    assert answers[:4] == [
        ["participant", "step", "trial", "item", "value"], ["sub-01", "trial-2-tlx", "2", "mental", "40"],
        ["sub-01", "trial-2-tlx", "2", "score:tlx", "40.0"], ["sub-01", "after-sus", "", "score:sus", "70.0"],
    ]  # fmt: skip
