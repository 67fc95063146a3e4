"""The pictures of recordings in the pages, drawn in the working folder from drives made for them.

`python -m docs.studies.pictures first-minute` writes the output of the first minute (first-minute.txt) and its drive
with a restriction (what-if.txt, what-if.png); `readme` writes first-minute.txt and first-minute.png for README.
`report` draws report.png, which needs Chromium and pdftoppm (poppler); the picture in the pages is that of release 0.2,
in docs/results/0.2/screens.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import sim
from das.command_line.files import save_figure
from docs.studies.bundled import das_sim, first_page
from sim.cli.first_minute import DRIVER
from sim.review.canvas import comparison_figure


def first_minute(folder: Path) -> None:
    """The first minute: its output, its two drives side by side, and the second one with a restriction."""
    said, _, guided = _driven(folder)
    (folder / "first-minute.txt").write_text("".join(f"{line}\n" for line in said), encoding="utf-8")
    guided.rename(folder / "guided.mcap")
    again = ("--driver", DRIVER, "--restriction", "18-19.5:60", "-o", "restricted.mcap")
    das_sim("what-if", "guided.mcap", *again, folder=folder)
    _beside(folder / "guided.mcap", folder / "restricted.mcap", folder / "what-if.png")
    compared = das_sim("report", "guided.mcap", "restricted.mcap", folder=folder)
    (folder / "what-if.txt").write_text(compared, encoding="utf-8")


def readme(folder: Path) -> None:
    """The output of the first minute, and its two drives side by side."""
    said, recorded, guided = _driven(folder)
    (folder / "first-minute.txt").write_text("".join(f"{line}\n" for line in said), encoding="utf-8")
    _beside(recorded, guided, folder / "first-minute.png")


def _beside(first: Path, other: Path, picture: Path) -> None:
    """Draw two drives side by side, as in a report."""
    save_figure(picture, comparison_figure(sim.compare(first, other)))


def _driven(folder: Path) -> tuple[list[str], Path, Path]:
    """The output of the first minute, and its recordings by their names in pictures."""
    said = das_sim(folder=folder).splitlines()[:-1]  # The last line names the recordings.
    recorded, guided = (folder / f"{name}.mcap" for name in ("as recorded", "with the guide"))
    (made,) = (folder / "recordings").glob("*-guide.mcap")
    made.with_name(made.name.replace("-guide", "")).rename(recorded)
    made.rename(guided)
    return said, recorded, guided


def report(folder: Path) -> None:
    """The first page of the report on a run with a restriction."""
    das_sim("run", "restriction-ahead", "--seed", "1", "-o", folder / "run.mcap")
    das_sim("report", folder / "run.mcap", "-o", folder / "report.pdf")
    first_page(folder / "report.pdf", folder / "report.png")


PICTURES: Final[dict[str, Callable[[Path], None]]] = {
    "first-minute": first_minute,
    "readme": readme,
    "report": report,
}


def main(args: Sequence[str] | None = None) -> None:
    """Draw the named pictures."""
    parser = argparse.ArgumentParser(prog="python -m docs.studies.pictures", description=__doc__)
    parser.add_argument("names", nargs="+", choices=list(PICTURES), metavar="NAME", help=", ".join(PICTURES))
    for name in parser.parse_args(args).names:
        PICTURES[name](Path.cwd())


if __name__ == "__main__":
    main()
