"""The pictures of recordings in README and in the how-to guides, drawn from days and trips that are made for them.

`python -m docs.studies.pictures NAME` (review, what-if or report) draws docs/images/NAME.png again, in a minute; review
draws first-minute.png as well, and writes what the first minute prints. The first page of a report needs Chromium and
pdftoppm (poppler).
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from docs.studies.bundled import das_sim, first_page
from docs.studies.output import DOCS, write_table

IMAGES: Final = DOCS / "images"


def review(folder: Path) -> None:
    """The first minute: what it prints, its two drives beside each other, and all about the one with the coach."""
    said = das_sim(folder=folder).splitlines()[:-1]  # The last line names the recordings.
    write_table(DOCS / "tutorials" / "first-replay.md", "first-minute", ("```text", *said, "```"))
    recorded, coached = (folder / f"{name}.mcap" for name in ("as recorded", "with the coach"))
    (made,) = (folder / "recordings").glob("*-coach.mcap")
    made.with_name(made.name.replace("-coach", "")).rename(recorded)
    made.rename(coached)
    das_sim("compare", recorded, coached, "--plot", IMAGES / "first-minute.png", "--overwrite")
    das_sim("view", coached, "--beside", recorded, "--plot", IMAGES / "review.png", "--overwrite")


def what_if(folder: Path) -> None:
    """The day with a restriction of the guide, and two what-ifs of it."""
    recorded, coach, without = (folder / f"{name}.mcap" for name in ("recorded", "coach-shown", "no-restriction"))
    das_sim("run", "restriction-ahead", "--seed", "1", "--advice", "vector", "-o", recorded)
    das_sim("what-if", recorded, "--advice", "coach", "-o", coach)
    das_sim("what-if", recorded, "--without-restrictions", "--driven-anew", "-o", without)
    das_sim("compare", recorded, coach, without, "--plot", IMAGES / "what-if.png", "--overwrite")


def report(folder: Path) -> None:
    """The first page of the report of a day with a restriction."""
    das_sim("run", "restriction-ahead", "--seed", "1", "-o", folder / "run.mcap")
    das_sim("report", folder / "run.mcap", "-o", folder / "report.pdf")
    first_page(folder / "report.pdf", IMAGES / "report.png")


PICTURES: Final[dict[str, Callable[[Path], None]]] = {"review": review, "what-if": what_if, "report": report}


def main(args: Sequence[str] | None = None) -> None:
    """Draw the pictures that are named."""
    parser = argparse.ArgumentParser(prog="python -m docs.studies.pictures", description=__doc__)
    parser.add_argument("names", nargs="+", choices=list(PICTURES), metavar="NAME", help=", ".join(PICTURES))
    for name in parser.parse_args(args).names:
        with tempfile.TemporaryDirectory(prefix="das-pictures-") as folder:
            PICTURES[name](Path(folder))


if __name__ == "__main__":
    main()
