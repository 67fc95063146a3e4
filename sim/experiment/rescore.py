"""Measures computed again from the recordings of a study, so that a study that is driven gets a new measure."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from das.command_line.printing import progress_bar
from das.domain.errors import DasError
from das.domain.files.reading import read_json, read_text
from das.domain.files.writing import make_folder, write_whole
from sim.drive.table import DriveTable
from sim.experiment.design import DESIGN_JSON, Design, design_sha256, read_frozen
from sim.experiment.measures import MEASURES
from sim.experiment.study_files import RECORDINGS, TRIALS_TABLE, recording_name, table_text
from sim.recording.opening import open_recording

OF: Final = "rescored from"
"""Key of the frozen design with the hash of the one whose recordings were read."""


def rescore(folder: Path, names: Sequence[str], out: Path) -> int:
    """Write a study's design and table into another folder, with some measures computed from its recordings.

    Only measures that need nothing but a recording can be; those that the study had are replaced, others become new
    columns. Returns the number of trials. Raises DasError for a study without recordings, and for other measures.
    """
    for name in names:
        if name not in MEASURES or MEASURES[name].of_table is None:
            able = ", ".join(one.name for one in MEASURES.values() if one.of_table is not None)
            raise DasError(f"--measure {name}: expected one that a recording alone gives: {able}")
    design = read_frozen(folder)
    rows = list(csv.DictReader(io.StringIO(read_text(folder / TRIALS_TABLE))))
    if out.resolve() == folder.resolve() or (out / TRIALS_TABLE).exists():
        raise DasError(f"{out}: holds a study already, expected another folder")
    files = [folder / RECORDINGS / _recording(design, row) for row in rows]
    if missing := [file for file in files if not file.is_file()]:
        raise DasError(f"{missing[0]}: no such file: only a study with recordings (--recordings) can be rescored")
    with progress_bar("rescore", f"{len(rows)} recordings to read", "trials") as progress:
        for number, (row, file) in enumerate(zip(rows, files, strict=True), start=1):
            row.update(measured_of_table(DriveTable.of(open_recording(file)), names))
            progress(number, len(rows))
    make_folder(out)
    head = [*rows[0]] if rows else []
    write_whole(out / TRIALS_TABLE, table_text(head, ([row[name] for name in head] for row in rows)))
    write_whole(out / DESIGN_JSON, _frozen_with(folder, tuple(dict.fromkeys([*design.measures, *names]))))
    return len(rows)


def measured_of_table(table: DriveTable, names: Sequence[str]) -> dict[str, Any]:
    """The values of some measures that a recording alone gives, by name."""
    return {name: of(table) for name in names if (of := MEASURES[name].of_table) is not None}


def _recording(design: Design, row: Mapping[str, str]) -> str:
    try:
        return recording_name(row["participant"], int(row["position"]), row["condition"], row["seed"])
    except (KeyError, TypeError, ValueError) as error:
        raise DasError(f"{TRIALS_TABLE}: expected the rows that the study wrote ({error})") from error


def _frozen_with(folder: Path, measures: tuple[str, ...]) -> bytes:
    """The frozen design with these measures, and a hash of its own."""
    data = {**read_json(folder / DESIGN_JSON).data}
    was = data.pop("hash")
    data["analysis"] = {**data["analysis"], "measures": list(measures)}
    data["files"] = {**data.get("files", {}), OF: was}
    return json.dumps({"hash": design_sha256(data), **data}, indent=2, ensure_ascii=False).encode() + b"\n"
