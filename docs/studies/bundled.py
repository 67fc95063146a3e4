"""The report of the smallest bundled study, and what other scripts need of commands and reports.

`python -m docs.studies.bundled` runs the study in the working folder, and writes its report there, smoke.html.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Final

from das.domain.errors import DasError
from docs.studies.output import DOCS

ROOT: Final = DOCS.parent
PAGE_DPI: Final = 121
"""A4 becomes 1000 pixels wide."""


def das_sim(*args: str | Path, folder: Path = ROOT) -> str:
    """What a das-sim command prints in a folder; its progress is shown. Raises DasError if it fails."""
    paths = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    done = subprocess.run(
        [sys.executable, "-m", "sim.cli", *map(str, args)],
        cwd=folder, env={**os.environ, "PYTHONPATH": paths}, stdout=subprocess.PIPE, text=True, check=False,
    )  # fmt: skip
    if done.returncode != 0:
        raise DasError(f"das-sim {' '.join(map(str, args))}: ended with exit code {done.returncode}")
    return done.stdout


def first_page(pdf: Path, picture: Path) -> None:
    """Draw the first page of a PDF as a PNG of 256 colours: with fewer, small curves lose theirs."""
    from PIL import Image

    options = ("-f", "1", "-l", "1", "-r", str(PAGE_DPI), "-png", "-singlefile")
    subprocess.run(["pdftoppm", *options, pdf, picture.with_suffix("")], check=True)
    Image.open(picture).convert("RGB").quantize(256, dither=Image.Dither.NONE).save(picture, optimize=True)


if __name__ == "__main__":
    das_sim("experiment", "run", "smoke", "--out", "smoke", folder=Path.cwd())
    das_sim("experiment", "analyse", "smoke", "-o", "smoke.html", folder=Path.cwd())
