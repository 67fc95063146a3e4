"""A folder of tables: what is finished in it, and the report of the last build."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from das.domain.errors import DasError
from das.domain.files.writing import UNFINISHED, write_whole
from das.table.format import MANIFEST, TableError
from das.table.reading import Table
from precompute.tables.job import HASH_DIGITS, Job

REPORT = "build.json"
REPORT_VERSION = 1


class BuildStatus(StrEnum):
    """How a section of a build stands."""

    BUILT = "built"
    KEPT = "kept"
    """Finished before, and nothing it depends on has changed."""
    FAILED = "failed"
    POISON = "poison"
    """It took its worker down every time."""
    PENDING = "pending"


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What became of a job: the reason where it failed, the seconds of the last attempt and how many there were."""

    name: str
    status: BuildStatus
    reason: str = ""
    seconds: float | None = None
    attempts: int = 0
    size_bytes: int | None = None


def remove_unfinished(folder: Path) -> None:
    """Remove what killed writers left."""
    for path in folder.glob(f"{UNFINISHED}*"):
        shutil.rmtree(path, ignore_errors=True)


def finished(folder: Path, job: Job) -> int | None:
    """The size of the job's table (bytes) if it is there, whole and made for this job by this code, else None."""
    try:
        table = Table.open(folder / job.name)
        if table.manifest["table_sha256"] != job.key:
            return None
        table.verify()
        return table.size_bytes
    except TableError:
        return None


def remove_superseded(folder: Path, done: Sequence[Job]) -> list[str]:
    """Remove the tables of former inputs of sections that are done with their present ones; returns their names."""
    wanted = {job.name for job in done}
    labels = {job.label for job in done}
    removed = []
    for path in table_folders(folder):
        label, _, digits = path.name.rpartition("_")
        if label in labels and len(digits) == HASH_DIGITS and path.name not in wanted and (path / MANIFEST).is_file():
            shutil.rmtree(path, ignore_errors=True)
            removed.append(path.name)
    return removed


def table_folders(folder: Path) -> list[Path]:
    """Folders of tables, by name; the folder itself where it is one. DasError where there is no such folder."""
    if not folder.is_dir():
        raise DasError(f"{folder}: no such folder")
    if (folder / MANIFEST).is_file():
        return [folder]
    return sorted(path for path in folder.iterdir() if path.is_dir() and not path.name.startswith("."))


def read_report(folder: Path) -> dict[str, Any]:
    """The report of the last build; empty where there is none that can be read."""
    try:
        report = json.loads((folder / REPORT).read_bytes())
    except (OSError, ValueError):
        return {}
    return report if _is_report(report) else {}


def _is_report(report: object) -> bool:
    if not isinstance(report, dict) or report.get("schema_version") != REPORT_VERSION:
        return False
    sections = report.get("sections")
    return isinstance(sections, list) and all(
        isinstance(section, dict)
        and isinstance(section.get("name"), str)
        and section.get("status") in list(BuildStatus)
        for section in sections
    )


def missing_tables(folder: Path) -> list[str]:
    """Tables that the last build finished and that are not there any more."""
    done = (BuildStatus.BUILT, BuildStatus.KEPT)
    names = [section["name"] for section in read_report(folder).get("sections", []) if section["status"] in done]
    return [name for name in names if not (folder / name).is_dir()]


def write_report(folder: Path, facts: Mapping[str, Any], outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Write build.json; returns what it holds."""
    counts = {str(status): sum(outcome.status is status for outcome in outcomes) for status in BuildStatus}
    report = {
        "schema_version": REPORT_VERSION,
        **facts,
        "counts": counts,
        "sections": [asdict(outcome) for outcome in outcomes],
    }
    write_whole(folder / REPORT, json.dumps(report, ensure_ascii=False, indent=1).encode() + b"\n")
    return report
