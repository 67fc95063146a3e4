"""Writing the results of the studies: files in a folder, CSV, and tables between marks in pages."""

from __future__ import annotations

import csv
import io
import re
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from das.domain.errors import DasError
from das.domain.files.writing import make_folder, write_whole

DOCS: Final = Path(__file__).resolve().parents[1]
"""The folder of the documentation."""
PNG_DPI = 100
COLOURS_OF_A_PNG = 256


class Output:
    """A folder for results, which is created; `written` lists its files in order."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.written: list[Path] = []
        make_folder(folder)
        try:
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError as error:
            raise DasError(f"{folder}: cannot be written to ({error.strerror})") from error

    def text(self, name: str, content: str) -> None:
        """Write a text file."""
        self._write(name, content.encode())

    def picture(self, name: str, figure: Any) -> None:
        """Write a figure as NAME.png; equal figures give equal bytes."""
        from PIL import Image

        png, small = io.BytesIO(), io.BytesIO()
        figure.savefig(png, format="png", dpi=PNG_DPI)
        indexed = Image.open(png).convert("RGB").quantize(COLOURS_OF_A_PNG, dither=Image.Dither.NONE)
        indexed.save(small, format="png", optimize=True)
        self._write(f"{name}.png", small.getvalue())

    def _write(self, name: str, content: bytes) -> None:
        path = self.folder / name
        write_whole(path, content)
        self.written.append(path)


def plain(value: Any) -> Any:
    """A value suitable for JSON: numpy numbers unpacked, non-finite numbers as None, floats with seven digits."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return float(f"{value:.7g}") if np.isfinite(value) else None
    return value


def write_table(page: Path, name: str, lines: Iterable[str]) -> None:
    """Put lines between the marks `<!-- NAME: begin -->` and `<!-- NAME: end -->` of a page; each is printed once
    computed.

    DasError, before the first line, if the page has no such marks.
    """
    marks = re.compile(rf"(<!-- {name}: begin -->\n).*?(<!-- {name}: end -->)", re.DOTALL)
    if not marks.search(page.read_text(encoding="utf-8")):
        raise DasError(f"{page}: no marks <!-- {name}: begin --> and <!-- {name}: end -->")
    found = []
    for line in lines:
        print(line, flush=True)
        found.append(f"{line}\n")
    # The page is read again, because computing the lines may take a quarter of an hour.
    text = marks.sub(lambda marked: f"{marked[1]}{''.join(found)}{marked[2]}", page.read_text(encoding="utf-8"))
    write_whole(page, text.encode())


def write_csv(path: Path, lines: Iterable[str]) -> None:
    """Write the cells of a Markdown table as CSV; each line is printed when it is computed."""
    rows = []
    for line in lines:
        print(line, flush=True)
        if set(line) - set("|-: "):
            rows.append(line.removeprefix("|").removesuffix("|").split(" | "))
    write_whole(path, csv_text(rows).encode())


def csv_text(rows: Iterable[Sequence[str]]) -> str:
    """Rows as CSV."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([cell.strip() for cell in row] for row in rows)
    return text.getvalue()


def csv_lines(path: Path) -> list[str]:
    """The rows of a CSV as rows of a Markdown table."""
    with path.open(encoding="utf-8", newline="") as file:
        return [f"| {' | '.join(row)} |" for row in csv.reader(file)]
