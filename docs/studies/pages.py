"""The pages of the documentation whose tables the scripts write: each table stands between two marks of a page."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

from das.domain.errors import DasError
from das.domain.files.writing import write_whole

DOCS: Final = Path(__file__).resolve().parents[1]
"""The folder of the documentation."""


def write_table(page: Path, name: str, lines: Iterable[str]) -> None:
    """Put lines between the marks `<!-- NAME: begin -->` and `<!-- NAME: end -->` of a page; print each as it is found.

    Raises DasError where the page has no such marks; then no line is asked for.
    """
    marks = re.compile(rf"(<!-- {name}: begin -->\n).*?(<!-- {name}: end -->)", re.DOTALL)
    if not marks.search(page.read_text(encoding="utf-8")):
        raise DasError(f"{page}: no marks <!-- {name}: begin --> and <!-- {name}: end -->")
    found = []
    for line in lines:
        print(line, flush=True)
        found.append(f"{line}\n")
    # The page is read again: making the lines may take a quarter of an hour.
    text = page.read_text(encoding="utf-8")
    write_whole(page, marks.sub(lambda marked: f"{marked[1]}{''.join(found)}{marked[2]}", text).encode())


def markdown_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table; the first column is left-aligned, the others right-aligned."""
    lines = ["| " + " | ".join(header) + " |", "|---" + "|---:" * (len(header) - 1) + "|"]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines) + "\n"
