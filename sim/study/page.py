"""A page of the documentation whose tables a program writes: each stands between two marks."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from das.domain.errors import DasError
from das.domain.files.writing import write_whole


def write_table(page: Path, name: str, lines: Iterable[str]) -> None:
    """Put lines between the marks `<!-- NAME: begin -->` and `<!-- NAME: end -->` of a page.

    Raises DasError where the page has no such marks; then no line is asked for.
    """
    marks = re.compile(rf"(<!-- {name}: begin -->\n).*?(<!-- {name}: end -->)", re.DOTALL)
    if not marks.search(page.read_text(encoding="utf-8")):
        raise DasError(f"{page}: no marks <!-- {name}: begin --> and <!-- {name}: end -->")
    table = "".join(f"{line}\n" for line in lines)
    # The page is read again: making the lines may take a quarter of an hour.
    text = page.read_text(encoding="utf-8")
    write_whole(page, marks.sub(lambda found: f"{found[1]}{table}{found[2]}", text).encode())
