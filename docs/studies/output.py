"""Writing the results of the studies: files in a folder, and tables between marks in pages of the documentation."""

from __future__ import annotations

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
    """Writes into one folder, which is created; `written` lists the files in order."""

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
        """Write a figure as NAME.png; the same figure gives the same bytes."""
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
    """A value as JSON can hold it: numpy numbers unpacked, not finite ones None, floats to seven digits."""
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
    """Put lines between the marks `<!-- NAME: begin -->` and `<!-- NAME: end -->` of a page; prints each as it comes.

    Raises DasError if the page has no such marks, before the first line is made.
    """
    marks = re.compile(rf"(<!-- {name}: begin -->\n).*?(<!-- {name}: end -->)", re.DOTALL)
    if not marks.search(page.read_text(encoding="utf-8")):
        raise DasError(f"{page}: no marks <!-- {name}: begin --> and <!-- {name}: end -->")
    found = []
    for line in lines:
        print(line, flush=True)
        found.append(f"{line}\n")
    # The page is read again: making the lines may take a quarter of an hour.
    text = marks.sub(lambda marked: f"{marked[1]}{''.join(found)}{marked[2]}", page.read_text(encoding="utf-8"))
    write_whole(page, text.encode())


def markdown_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table; the first column is left-aligned, the others right-aligned."""
    lines = ["| " + " | ".join(header) + " |", "|---" + "|---:" * (len(header) - 1) + "|"]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines) + "\n"
