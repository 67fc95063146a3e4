"""The report of the smallest bundled study, and helpers of other scripts for commands and reports.

`python -m docs.studies.bundled` runs the study in the working folder and writes its report there, smoke.html.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

from das.domain.errors import DasError
from docs.studies.forks import ERRORS, PRINTED, forked
from docs.studies.output import DOCS

ROOT: Final = DOCS.parent
PAGE_DPI: Final = 121
"""Resolution at which A4 is 1000 pixels wide."""


def das_sim(*args: str | Path, folder: Path = ROOT) -> str:
    """The output of a das-sim command run in a folder. Raises DasError if it fails."""
    with tempfile.TemporaryDirectory() as name:
        said = Path(name)
        process = forked(("-m", "sim.cli", *map(str, args)), folder, said)
        process.join()
        if process.exitcode != 0:
            sys.stderr.write((said / ERRORS).read_text(encoding="utf-8"))
            raise DasError(f"das-sim {' '.join(map(str, args))}: ended with exit code {process.exitcode}")
        return (said / PRINTED).read_text(encoding="utf-8")


def first_page(pdf: Path, picture: Path) -> None:
    """Draw the first page of a PDF as a PNG with 256 colours; with fewer, small curves lose their colour."""
    from PIL import Image

    options = ("-f", "1", "-l", "1", "-r", str(PAGE_DPI), "-png", "-singlefile")
    subprocess.run(["pdftoppm", *options, pdf, picture.with_suffix("")], check=True)
    Image.open(picture).convert("RGB").quantize(256, dither=Image.Dither.NONE).save(picture, optimize=True)


if __name__ == "__main__":
    das_sim("experiment", "run", "smoke", "--out", "smoke", "--workers", "1", folder=Path.cwd())
    das_sim("experiment", "analyse", "smoke", "-o", "smoke.html", folder=Path.cwd())
