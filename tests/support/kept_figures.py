"""Comparison of committed figures with newly made ones: lines, pictures, and the outputs of notebooks."""

from __future__ import annotations

import ast
import base64
import io
import re
from collections.abc import Iterable
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any, Final

import numpy as np
from PIL import Image

from das.drawing.picture import Picture

NUMBER: Final = re.compile(r"[+\-−]?\d+(?:\.\d+)?")
BLOCK_PIXELS: Final = 8
GREY_STEPS: Final = 12.0
"""Difference of mean grey (of 255) above which two blocks of a picture differ; hair lines of text stay below."""
SAME_PICTURE: Final = 0.0005
"""Share of differing blocks below which pictures are the same; a redrawn picture has none."""

Cells = list[tuple[str, bytes | None]]
"""The output of each cell of a notebook: its text, and its picture if there is one."""


def agree(one: str, other: str) -> bool:
    """Whether two lines have the same words, and figures that differ by at most one unit of the last digit."""
    words = [" ".join(NUMBER.sub("#", line).split()) for line in (one, other)]
    pairs = zip(NUMBER.findall(one), NUMBER.findall(other), strict=False)
    return words[0] == words[1] and all(_near(*pair) for pair in pairs)


def _near(one: str, other: str) -> bool:
    decimals = [len(number.partition(".")[2]) for number in (one, other)]
    apart = abs(float(one.replace("−", "-")) - float(other.replace("−", "-")))
    return decimals[0] == decimals[1] and apart <= 1.001 * 10.0 ** -decimals[0]


def not_on_page(page: str, made: Iterable[str]) -> list[str]:
    """The new lines that agree with no line of a page."""
    there = page.splitlines()
    return [line for line in made if line not in there and not any(agree(line, one) for one in there)]


def picture_difference(one: bytes, other: bytes) -> float:
    """The share of a picture's blocks that are lighter or darker in another one; 1 for different sizes."""
    greys = [_blocks(content) for content in (one, other)]
    if greys[0].shape != greys[1].shape:
        return 1.0
    return float(np.mean(np.abs(greys[0] - greys[1]) > GREY_STEPS))


def same_picture(one: Path, other: Path) -> bool:
    return picture_difference(one.read_bytes(), other.read_bytes()) <= SAME_PICTURE


def _blocks(content: bytes) -> np.ndarray:
    picture = Image.open(io.BytesIO(content)).convert("RGB").convert("L")
    return np.asarray(picture.reduce(BLOCK_PIXELS), dtype=float)


def made_cells(notebook: Any) -> Cells:
    """The outputs of a notebook's cells when run now."""
    names: dict[str, Any] = {}
    found: Cells = []
    for cell in notebook["cells"]:
        if cell["cell_type"] != "code":
            continue
        text = io.StringIO()
        body = ast.parse("".join(cell["source"])).body
        last = body.pop() if isinstance(body[-1], ast.Expr) else None
        with redirect_stdout(text):
            exec(compile(ast.Module(body, []), "cell", "exec"), names)
            value = None if last is None else eval(compile(ast.Expression(last.value), "cell", "eval"), names)
        picture = value._repr_png_() if isinstance(value, Picture) else None
        if value is not None and picture is None:
            text.write(repr(value))
        found.append((" ".join(text.getvalue().split()), picture))
    return found


def kept_cells(notebook: Any) -> Cells:
    """The committed outputs of a notebook's cells."""
    found: Cells = []
    for cell in notebook["cells"]:
        outputs = cell.get("outputs", [])
        shown = [one["data"] for one in outputs if "data" in one]
        texts = ["".join(one["text"]) for one in outputs if "text" in one and one["name"] == "stdout"]
        texts += ["".join(data["text/plain"]) for data in shown if "image/png" not in data]
        pictures = [base64.b64decode("".join(data["image/png"])) for data in shown if "image/png" in data]
        if cell["cell_type"] == "code":
            found.append((" ".join(" ".join(texts).split()), pictures[0] if pictures else None))
    return found


def stale_cells(kept: Cells, made: Cells) -> list[str]:
    """The committed outputs that a notebook no longer produces: texts, and "picture" for a picture."""
    stale = []
    for (text, picture), (new_text, new_picture) in zip(kept, made, strict=True):
        stale += not_on_page(text, [new_text] if new_text else [])
        if (picture is None) != (new_picture is None):
            stale.append("picture")
        elif picture is not None and new_picture is not None:
            stale += ["picture"] if picture_difference(picture, new_picture) > SAME_PICTURE else []
    return stale
