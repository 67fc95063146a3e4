"""Removes a person from the folder of a study: journal, recordings, rows of tables; only a line says that it was done.

The person's folder is emptied first, so that no other desk writes rows from its journal again, and removed last: while
it is there, an interrupted command can be repeated.
"""

from __future__ import annotations

import csv
import io
import json
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from das.domain.errors import DasError
from das.domain.files.reading import read_text
from das.domain.files.writing import LOCK, folder_held, write_whole
from sim.experiment.driving import participant_name
from sim.experiment.people.journal import ANSWERS_TABLE, tables_held
from sim.experiment.study_files import (
    PEOPLE_FOLDER,
    RECORDINGS,
    TRIALS_TABLE,
    participant_number,
    pseudonym,
    table_text,
)

FORGOTTEN: Final = "forgotten.jsonl"
"""The participants who were removed: pseudonym and date, a line for each."""


@dataclass(frozen=True, kw_only=True)
class Removed:
    """What was removed of a person: number of files, of rows in tables, and of bytes in both."""

    participant: str
    files: int
    rows: int
    bytes: int


def forget(folder: Path, name: str) -> Removed:
    """Remove the person with a pseudonym from a study's folder.

    Raises DasError for an unknown person, one whose desk is running, altered tables, and files that cannot be removed.
    """
    number, people, before = participant_number(name), folder / PEOPLE_FOLDER, _forgotten(folder)
    mine = people / pseudonym(number)
    if not mine.is_dir() or mine.is_symlink():
        names = ", ".join(path.name for path in sorted(people.glob("P*"))) or "none"
        gone = f" ({name} was removed on {when})" if (when := before.get(mine.name)) else ""
        raise DasError(f"--participant {name}: not in {people}{gone}: expected one of its people: {names}")
    try:
        with folder_held(mine, f"{mine.name} is at a desk now"), tables_held(folder):
            found = _emptied(folder, mine, number)
            if mine.name not in _forgotten(folder):
                line = json.dumps({"participant": mine.name, "date": f"{datetime.now(UTC):%Y-%m-%d}"})
                write_whole(folder / FORGOTTEN, f"{_text(folder / FORGOTTEN)}{line}\n".encode())
            (mine / LOCK).unlink()
            mine.rmdir()
    except OSError as error:
        raise DasError(f"{error.filename}: cannot be removed ({error.strerror})") from error
    return found


def _text(path: Path) -> str:
    return read_text(path) if path.is_file() else ""


def _forgotten(folder: Path) -> dict[str, str]:
    """The dates of removal, by the pseudonym."""
    path = folder / FORGOTTEN
    try:
        lines = [json.loads(line) for line in _text(path).splitlines()]
        return {str(one["participant"]): str(one["date"]) for one in lines}
    except (ValueError, KeyError, TypeError) as error:
        raise DasError(f"{path}: expected a participant and a date in each line; the file was altered") from error


def _emptied(folder: Path, mine: Path, number: int) -> Removed:
    """Remove everything of a person except the own folder with its lock."""
    names = {mine.name, participant_name(number)}
    tables = {folder / name: _without(folder / name, names) for name in (TRIALS_TABLE, ANSWERS_TABLE)}
    files = [path for path in sorted(mine.rglob("*"), reverse=True) if path != mine / LOCK]
    files += sorted((folder / RECORDINGS).glob(f"{participant_name(number)}_*"))
    count = size = 0
    for path in files:
        if path.is_dir() and not path.is_symlink():
            path.rmdir()
            continue
        count, size = count + 1, size + path.lstat().st_size
        path.unlink()
    rows = 0
    for table, (left, removed, less) in tables.items():
        rows, size = rows + removed, size + less
        if removed:
            write_whole(table, left)
    return Removed(participant=mine.name, files=count, rows=rows, bytes=size)


def _without(path: Path, names: set[str]) -> tuple[bytes, int, int]:
    """A table without the rows of a participant; the number of rows removed, and their bytes.

    Raises DasError for a table that a study did not write.
    """
    text = _text(path)
    if not text:
        return b"", 0, 0
    head, *rows = filter(None, csv.reader(io.StringIO(text)))
    if "participant" not in head or any(len(row) != len(head) for row in rows):
        raise DasError(f"{path}: expected the column participant, and {len(head)} values in each row")
    kept = [row for row in rows if row[head.index("participant")] not in names]
    left = table_text(head, kept)
    return left, len(rows) - len(kept), len(text.encode()) - len(left)
