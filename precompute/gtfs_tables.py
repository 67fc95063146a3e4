"""The tables of a GTFS feed, read row by row from its zip as it is published."""

from __future__ import annotations

import csv
import math
import re
import unicodedata
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import zip_longest
from pathlib import Path, PurePosixPath
from typing import IO

from das.domain.errors import MISSING, DasError, InputError
from das.domain.files.foreign import UNZIP_ERRORS
from das.domain.units import MEGABYTE

Row = dict[str, str]

MOST_BYTES = {"stop_times.txt": 3_000_000_000, "shapes.txt": 1_000_000_000}
"""Largest unpacked size (bytes) of the tables that are read row by row; a whole country has 1 GB of stop times."""
MOST_BYTES_OF_TABLE = 100_000_000
"""Largest unpacked size (bytes) of every other table."""
SWELLING, SWELLS_FROM_BYTES = 100.0, 1_000_000
"""Factor of unpacking above which a table of at least that size (bytes) is no timetable."""
LONGEST_LINE = 100_000
"""Longest row of a table (bytes)."""


@contextmanager
def refused(where: str | Path) -> Iterator[None]:
    """Turn what reading a damaged zip or table raises into a DasError that names where."""
    try:
        yield
    except UNZIP_ERRORS as error:
        why = str(error) or "it ends too early"
        raise DasError(f"{where}: cannot be unpacked ({why}), expected the zip of a GTFS feed") from None
    except UnicodeDecodeError as error:
        raise DasError(f"{where}: not UTF-8 text ({error.reason})") from None
    except csv.Error as error:
        raise DasError(f"{where}: cannot be read ({error})") from None


class FeedTables:
    """A feed whose tables are read row by row."""

    def __init__(self, path: Path, archive: zipfile.ZipFile) -> None:
        self.path, self.archive = path, archive
        self.members: dict[str, zipfile.ZipInfo] = {}
        for member in archive.infolist():
            place = PurePosixPath(member.filename.replace("\\", "/"))
            if place.suffix == ".txt" and "__MACOSX" not in place.parts:
                kept = self.members.get(place.name)
                # A feed may lie in a folder of its zip; of two tables, the one nearer to the root counts.
                if kept is None or len(place.parts) < len(PurePosixPath(kept.filename).parts):
                    self.members[place.name] = member
        if "stop_times.txt" not in self.members:
            raise InputError(path, "stop_times.txt", MISSING, "the tables of a GTFS feed in the zip")
        for name, member in self.members.items():
            self._check_member(name, member)

    def _check_member(self, name: str, member: zipfile.ZipInfo) -> None:
        """Raise InputError for a table by what the zip says about it, before anything is unpacked."""
        most = MOST_BYTES.get(name, MOST_BYTES_OF_TABLE)
        swells = member.file_size > max(SWELLS_FROM_BYTES, SWELLING * max(member.compress_size, 1))
        if member.file_size > most or swells:
            size = f"{member.file_size / MEGABYTE:.0f} MB from {member.compress_size / MEGABYTE:.2f} MB"
            raise InputError(self.path, name, size, f"at most {most / MEGABYTE:g} MB, and {SWELLING:g} times the zip")
        if member.header_offset >= self.path.stat().st_size:
            raise InputError(self.path, name, f"at byte {member.header_offset}", "a place in the zip")
        if member.flag_bits & 1 or member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise InputError(self.path, name, "packed in another way", "a deflated table without a password")

    def rows(self, name: str, needed: Sequence[str], containing: Sequence[str] = ()) -> Iterator[tuple[int, Row]]:
        """The rows of a table with their line numbers; only rows that contain one of the texts, if any are given.

        Yields nothing if the feed has no such table. Raises InputError for a missing column.
        """
        if name not in self.members:
            return
        where = f"{self.path}: {name}"
        with refused(where), self.archive.open(self.members[name]) as file:
            numbers: list[int] = []
            needles = tuple(one.replace('"', '""').encode() for one in containing)
            reader = csv.reader(_lines(file, where, needles, numbers))
            header = [one.strip() for one in next(reader, [])]
            for column in needed:
                if column not in header:
                    raise InputError(where, f"column {column}", MISSING, f"the columns {', '.join(needed)}")
            for cells in reader:
                if any(cells):
                    yield numbers[-1], {key: cell.strip() for key, cell in zip_longest(header, cells, fillvalue="")}


def _lines(file: IO[bytes], where: str, needles: Sequence[bytes], numbers: list[int]) -> Iterator[str]:
    """The lines of a table with one of the needles, and the first line; `numbers` gets the number of each."""
    number = 0
    while line := file.readline(LONGEST_LINE + 1):
        number += 1
        if len(line) > LONGEST_LINE:
            raise InputError(where, f"line {number}", f"more than {LONGEST_LINE} bytes", "a shorter line")
        if number == 1 or not needles or any(needle in line for needle in needles):
            numbers[:] = [number]
            yield line.decode("utf-8-sig" if number == 1 else "utf-8").replace("\r", "")


def coordinates(latitude: str, longitude: str) -> tuple[float, float]:
    """Two coordinates (deg) of a table; NaN where one is missing or impossible, and for 0, 0 (a place unknown)."""
    try:
        found = float(latitude), float(longitude)
    except ValueError:
        return math.nan, math.nan
    possible = abs(found[0]) <= 90.0 and abs(found[1]) <= 180.0 and found != (0.0, 0.0)
    return found if possible else (math.nan, math.nan)


def tidy(text: str) -> str:
    """A text of the feed on one line, without control characters."""
    kept = "".join(" " if unicodedata.category(one)[0] in "CZ" else one for one in text)
    return " ".join(kept.split())[:150]


def key_of(name: str) -> str:
    """A name for comparison: lower case, without accents and punctuation."""
    bare = "".join(x for x in unicodedata.normalize("NFKD", name.casefold()) if not unicodedata.combining(x))
    return " ".join(re.findall(r"\w+", bare))


def whole_number(text: str) -> int | None:
    """The number >= 0 that a text of at most nine digits is; None for any other text."""
    return int(text) if text.isascii() and text.isdecimal() and len(text) < 10 else None
