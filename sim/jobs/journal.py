"""A journal of finished runs: one JSON row a line, appended when a run ends, so that a kill costs at most one line."""

from __future__ import annotations

import errno
import hashlib
import json
import os
from pathlib import Path
from types import TracebackType
from typing import Any

from das.domain.errors import DasError
from das.domain.files.writing import folder_held, write_whole


class Journal:
    """The finished rows in a folder, by the hash of their inputs; use with `with`.

    Only one command may use a folder at a time; `holds` names it in the message of the second one's error.

    Every line carries the hash of its row, so that a row that was cut off or altered is not taken for a result.
    """

    def __init__(self, folder: Path, *, holds: str = "another batch") -> None:
        self._holds = holds
        self.path = folder / "finished.jsonl"
        self.rows: dict[str, dict[str, Any]] = {}

    def __enter__(self) -> Journal:
        self._held = folder_held(self.path.parent, f"{self._holds} is at work here")
        self._held.__enter__()
        try:
            self._read()
            self._file = self.path.open("ab", buffering=0)
        except OSError as error:
            raise DasError(f"{self.path}: cannot be read and written ({error.strerror})") from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()
        self._held.__exit__(None, None, None)

    def add(self, row: dict[str, Any]) -> None:
        """Write a finished run to the disk at once."""
        self.rows[row["inputs_sha256"]] = row
        try:
            line = _line(row)
            if self._file.write(line) != len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            os.fsync(self._file.fileno())
        except OSError as error:
            raise DasError(f"{self.path}: cannot be written ({error.strerror})") from error

    def _read(self) -> None:
        """Read the rows that are there; lines that are not whole are dropped before the next one is appended."""
        if not self.path.exists():
            return
        lines = self.path.read_bytes().splitlines()
        for line in lines:
            row = _row(line)
            if row is not None:
                self.rows[row["inputs_sha256"]] = row
        if len(self.rows) < len(lines) or not self.path.read_bytes().endswith(b"\n"):
            write_whole(self.path, b"".join(map(_line, self.rows.values())))


def _line(row: dict[str, Any]) -> bytes:
    return json.dumps({"row_sha256": _sha256(row), "row": row}, ensure_ascii=False).encode() + b"\n"


def _row(line: bytes) -> dict[str, Any] | None:
    """The row of a line; None if the line is not as it was written."""
    try:
        found = json.loads(line)
        row: dict[str, Any] = found["row"]
        return row if found["row_sha256"] == _sha256(row) else None
    except (ValueError, KeyError, TypeError, RecursionError):
        return None


def _sha256(row: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(row, sort_keys=True).encode()).hexdigest()
