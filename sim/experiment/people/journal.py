"""The journals of participants, and the tables of a study made from them.

A line of a journal is on the disk before the step that it states shows. A killed session leaves at most one cut line,
at the end, which the next session removes.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from statistics import fmean
from typing import Any, Final

from das.domain.clocks import WALL, Clocks
from das.domain.errors import DasError
from das.domain.files.writing import FolderTakenError, folder_held, refuse_link, write_whole
from sim.experiment.design import Design
from sim.experiment.driving import participant_name
from sim.experiment.people.steps import Entry
from sim.experiment.people.tasks import task_measures
from sim.experiment.runner import HeldJournal
from sim.experiment.study_files import PEOPLE_FOLDER, TRIALS_TABLE, table_text, trials_table
from sim.experiment.trials import trials_of

JOURNAL: Final = "session.jsonl"
ANSWERS_TABLE: Final = "answers.csv"
"""The last answer of each participant to each item, and the scores of questionnaires, whose items are `score:NAME`."""
ANSWER_COLUMNS: Final = ("participant", "step", "trial", "item", "value", "wall_ms")
TAKEN_S: Final = 10.0
"""Longest time (s) for which a session waits for another one that writes the tables."""
NUMBER: Final = (int, float)
FIELDS: Final[Mapping[str, Mapping[str, Any]]] = {
    "answered": {"item": str, "value": str},
    "driven": {"trial": int, "measures": dict, "held_s": NUMBER},
    "act": {"task": str, "number": int, "event": str, "wall_ms": NUMBER, "drawn_ms": NUMBER},
}
"""The fields of a line that are read again, with their types, by the content of its field `what`."""


class PersonJournal(HeldJournal):
    """The journal of a participant, which one session holds at a time; use with `with`. `clocks` are injected.

    Entering also raises DasError for a journal that was altered.
    """

    def __init__(self, folder: Path, clocks: Clocks = WALL) -> None:
        super().__init__(folder / JOURNAL, f"participant {folder.name} is at a desk already")
        self._clocks = clocks
        self.entries: list[Entry] = []
        """All lines of the journal, in order."""

    def add(self, step: str, what: str, **more: Any) -> None:
        """Write a line to the disk at once; DasError if it cannot be written."""
        entry = {"wall_ns": self._clocks.now_ns(), "step": step, "what": what, **more}
        self.append(json.dumps(entry, ensure_ascii=False).encode() + b"\n")
        self.entries.append(entry)

    def _read(self) -> None:
        refuse_link(self.path)  # the end of another file would be cut
        self.entries, length = read_journal(self.path)
        if self.path.exists():
            os.truncate(self.path, length)


def read_journal(path: Path) -> tuple[list[Entry], int]:
    """The lines of a journal, and their length (bytes) without a cut last one; DasError for a journal that was altered.

    A file that does not exist, or is removed meanwhile, is empty.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        content = b""
    whole = content[: content.rfind(b"\n") + 1]
    found: list[Entry] = []
    for number, line in enumerate(whole.splitlines(), start=1):
        entry = _entry(line)
        if entry is None:
            raise DasError(f"{path}: line {number}: expected a line as a session writes it; the file was altered")
        found.append(entry)
    return found, len(whole)


def _entry(line: bytes) -> Entry | None:
    try:
        found = json.loads(line)
        kinds = {"wall_ns": int, "step": str, "what": str, **FIELDS.get(found["what"], {})}
        typed = all(isinstance(found[name], kind) for name, kind in kinds.items())
        return found if typed and all(isinstance(one, NUMBER) for one in found.get("scores", {}).values()) else None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None


def journal_files(folder: Path) -> dict[int, Path]:
    """The files of the journals in a study's folder, by the number of the participant."""
    paths = (folder / PEOPLE_FOLDER).glob(f"P*/{JOURNAL}")
    return dict(sorted((int(path.parent.name[1:]), path) for path in paths if path.parent.name[1:].isdecimal()))


def write_tables(design: Design, folder: Path) -> None:
    """Write the tables of trials and of answers of all participants; DasError if they cannot be written."""
    with tables_held(folder):
        people = {who: read_journal(path)[0] for who, path in journal_files(folder).items()}
        measures: dict[int, Mapping[str, Any]] = {}
        for entries in people.values():
            measures |= _measures(design, entries)
        write_whole(folder / TRIALS_TABLE, trials_table(design, trials_of(design), measures))
        rows = [row for who, entries in people.items() for row in _answers(who, entries)]
        write_whole(folder / ANSWERS_TABLE, table_text(ANSWER_COLUMNS, rows))


@contextmanager
def tables_held(folder: Path) -> Iterator[None]:
    """The lock of a study's folder; sessions hold it only while they write the tables, so it is waited for.

    Raises FolderTakenError if another command has it for longer than `TAKEN_S`.
    """
    end = time.monotonic() + TAKEN_S
    with ExitStack() as held:
        while True:
            try:
                held.enter_context(folder_held(folder, "another command is at work here"))
                break
            except FolderTakenError:
                if time.monotonic() > end:
                    raise
                time.sleep(0.02)
        yield


def _measures(design: Design, entries: Sequence[Entry]) -> dict[int, dict[str, Any]]:
    """The measures of the driven trials by their numbers, with those of questionnaires and tasks, and `braked`.

    Of a trial that was driven several times, the last drive counts. The score of a questionnaire that was answered
    several times in it is the mean.
    """
    found = {}
    for number, drive in {one["trial"]: one for one in entries if one["what"] == "driven"}.items():
        mine = [one for one in entries if one.get("trial") == number]
        before = mine[: mine.index(drive)]
        began = [i for i, one in enumerate(before) if one["what"] == "left" and one["step"] == drive["step"]]
        mine = mine[began[-1] if began else 0 :]
        scores: dict[str, list[float]] = {}
        for name, value in (pair for one in mine for pair in one.get("scores", {}).items()):
            scores.setdefault(name, []).append(value)
        every = {**drive["measures"], **{name: fmean(values) for name, values in scores.items()}, **task_measures(mine)}
        found[number] = {name: every.get(name) for name in design.measures}
        found[number]["braked"] = int(any(one["what"] == "braked" for one in mine))
    return found


def _answers(who: int, entries: Sequence[Entry]) -> Iterator[tuple[Any, ...]]:
    """The rows of a participant's answers: the last one to each item, and the scores."""
    found: dict[tuple[str, str], tuple[Any, ...]] = {}
    for one in entries:
        given = {one["item"]: one["value"]} if one["what"] == "answered" else {}
        scores = {f"score:{name}": value for name, value in one.get("scores", {}).items()}
        for item, value in (given | scores).items():
            wall_ms = one["wall_ns"] // 1_000_000
            found[one["step"], item] = (participant_name(who), one["step"], one.get("trial"), item, value, wall_ms)
    yield from found.values()
