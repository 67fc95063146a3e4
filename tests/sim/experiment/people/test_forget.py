"""A person who is to be forgotten leaves a pseudonym and a date, and everything of the others stays as it is."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from das.domain.errors import DasError
from das.domain.files.writing import folder_held, write_whole
from sim.experiment.people import journal
from sim.experiment.people.forget import forget
from tests.support.making import das_sim, das_sim_json, refusal

TRIALS = "trial,participant,position,condition\n1,sub-06,1,none\n2,sub-07,1,none\n3,sub-07,2,guide\n4,sub-70,1,none\n"
ANSWERS = 'participant,step,item,value\nsub-07,tlx,mental,"50, or\nmore"\nsub-70,tlx,mental,20\n'


@pytest.fixture
def study(tmp_path: Path) -> Path:
    """A folder as the desk leaves it: three people, of whom two have recordings, and one an interrupted trial."""
    files = {
        "design.json": "{}",
        "trials.csv": TRIALS,
        "answers.csv": ANSWERS,
        "people/P06/session.jsonl": "one\n",
        "people/P07/session.jsonl": "one\ntwo\n",
        "people/P07/door.json": "{}",
        "people/P70/session.jsonl": "one\n",
        "recordings/sub-07_run-001_none_seed-1.mcap": "m" * 100,
        "recordings/sub-07_run-002_guide_seed-1_interrupted-1.mcap": "m" * 50,
        "recordings/sub-70_run-001_none_seed-1.mcap": "m",
    }
    for name, text in files.items():
        path = tmp_path / "study" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path / "study"


def files_of(folder: Path) -> dict[str, str]:
    """The text of every file, by its path in the folder, without locks."""
    found = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.name != ".lock"]
    return {path.relative_to(folder).as_posix(): path.read_text() for path in found}


def left(before: dict[str, str]) -> dict[str, str]:
    """The files that are to be left of those before."""
    today = f"{datetime.now(UTC):%Y-%m-%d}"
    return {
        **{name: text for name, text in before.items() if "sub-07" not in name and "P07" not in name},
        "trials.csv": "trial,participant,position,condition\n1,sub-06,1,none\n4,sub-70,1,none\n",
        "answers.csv": "participant,step,item,value\nsub-70,tlx,mental,20\n",
        "forgotten.jsonl": f'{{"participant": "P07", "date": "{today}"}}\n',
    }


def test_only_the_others_are_left_and_the_counts_are_what_went(study: Path) -> None:
    before = files_of(study)
    found = forget(study, "P07")
    after = files_of(study)
    assert after == left(before)
    assert not (study / "people" / "P07").exists()
    assert (found.participant, found.files, found.rows) == ("P07", 4, 3)
    gone = sum(map(len, before.values())) - sum(map(len, after.values())) + len(after["forgotten.jsonl"])
    assert found.bytes == gone


def test_the_command_says_what_went_and_what_is_not_touched(study: Path) -> None:
    said = " ".join(das_sim("experiment", "forget", str(study), "--participant", "P07", cwd=study).stdout.split())
    assert said.startswith("P07: 4 files and 3 rows of tables removed, ")
    assert "Copies, reports and fitted populations made before are not touched." in said
    figures = das_sim_json("experiment", "forget", str(study), "--participant", "P70", cwd=study)
    assert figures == {"participant": "P70", "files": 2, "rows": 2, "bytes": figures["bytes"]}
    assert list((study / "people").iterdir()) == [study / "people" / "P06"]


@pytest.mark.parametrize("step", range(9))
def test_an_interrupted_removal_can_be_repeated(study: Path, step: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever call to the disk the command is stopped at, the same command ends the work, with one line."""
    before, calls = files_of(study), 0

    def stopped(of: Any) -> Any:
        def call(*args: Any, **kwargs: Any) -> Any:
            nonlocal calls
            calls += 1
            if calls == step + 1:
                raise KeyboardInterrupt
            return of(*args, **kwargs)

        return call

    with monkeypatch.context() as patch:
        for name in ("unlink", "rmdir"):
            patch.setattr(Path, name, stopped(getattr(Path, name)))
        patch.setattr(f"{forget.__module__}.write_whole", stopped(write_whole))
        with pytest.raises(KeyboardInterrupt):
            forget(study, "P07")
    if (study / "people" / "P07").exists():
        forget(study, "P07")
    assert files_of(study) == left(before)
    assert not (study / "people" / "P07").exists()


def test_the_journal_goes_before_the_rows_that_come_from_it(study: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def checked(path: Path, content: bytes) -> None:
        assert not (study / "people" / "P07" / "session.jsonl").exists()
        path.write_bytes(content)

    monkeypatch.setattr(f"{forget.__module__}.write_whole", checked)
    assert forget(study, "P07").rows == 3


def test_a_person_at_a_desk_is_not_removed(study: Path) -> None:
    before = files_of(study)
    with folder_held(study / "people" / "P07", "taken"):
        assert "P07 is at a desk now" in refusal("experiment", "forget", str(study), "--participant", "P07", cwd=study)
    assert files_of(study) == before
    assert forget(study, "P07").files == 4


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("trials.csv", "a,b\n1,2\n", "trials.csv: expected the column participant, and 2 values in each row"),
        ("trials.csv", f"{TRIALS}x\n", "trials.csv: expected the column participant, and 4 values in each row"),
        ("forgotten.jsonl", "P06\n", "forgotten.jsonl: expected a participant and a date in each line"),
    ],
)
def test_nothing_is_removed_from_an_altered_folder(study: Path, name: str, text: str, said: str) -> None:
    (study / name).write_text(text)
    before = files_of(study)
    assert said in refusal("experiment", "forget", str(study), "--participant", "P07", cwd=study)
    assert files_of(study) == before


def test_the_tables_are_waited_for_while_another_desk_writes_them(study: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = files_of(study)
    with folder_held(study, "taken"), monkeypatch.context() as patch:
        patch.setattr(journal, "TAKEN_S", 0.05)
        with pytest.raises(DasError, match="another command is at work here"):
            forget(study, "P07")
    assert files_of(study) == before
    with ThreadPoolExecutor() as pool:
        with folder_held(study, "taken"):
            removal = pool.submit(forget, study, "P07")
            with pytest.raises(TimeoutError):
                removal.result(0.3)
            assert files_of(study) == before
        assert removal.result(5).files == 4


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("P08", "--participant P08: not in "),
        ("P08", "expected one of its people: P06, P07, P70"),
        ("sub-07", "--participant sub-07: expected P1 to P99999, a pseudonym"),
        ("../P07", "--participant ../P07: expected P1 to P99999"),
    ],
)
def test_an_unknown_person_is_refused(study: Path, name: str, said: str) -> None:
    before = files_of(study)
    assert said in refusal("experiment", "forget", str(study), "--participant", name, cwd=study)
    assert files_of(study) == before


def test_a_person_who_was_removed_is_named_with_the_date(study: Path) -> None:
    forget(study, "P07")
    date = json.loads((study / "forgotten.jsonl").read_text())["date"]
    with pytest.raises(DasError, match=rf"P07 was removed on {date}"):
        forget(study, "P07")


def test_the_folder_of_simulated_drivers_has_nobody_to_forget(tmp_path: Path) -> None:
    (tmp_path / "trials.csv").write_text(TRIALS)
    with pytest.raises(DasError, match="expected one of its people: none"):
        forget(tmp_path, "P07")


def test_a_link_in_a_folder_is_removed_and_not_followed(study: Path, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "kept").write_text("k")
    (study / "people" / "P07" / "link").symlink_to(tmp_path / "elsewhere")
    forget(study, "P07")
    assert (tmp_path / "elsewhere" / "kept").read_text() == "k"
