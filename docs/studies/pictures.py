"""The pictures of recordings in the pages, drawn in the working folder from drives made for them.

`python -m docs.studies.pictures what-if` compares a run of the example files with the same run without its restriction
(what-if.txt, what-if.png). `readme` writes what README has: the words of the first minute (first-minute.txt), and its
two drives side by side (first-minute.png).
`report` draws report.png, and needs Chromium and pdftoppm (poppler): its picture is one of release 0.2, in
docs/results/0.2/screens.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import sim
from das.command_line.files import save_figure
from docs.studies.bundled import das_sim, first_page
from sim.review.pictures import comparison_figure


def what_if(folder: Path) -> None:
    """A run of the example files, and the same run without its restriction."""
    das_sim("example", "my-line", folder=folder)
    das_sim("run", "my-line/scenario.toml", "--seed", "3", "-o", "run.mcap", folder=folder)
    das_sim("what-if", "run.mcap", "--driven-anew", "--without-restrictions", "-o", "free.mcap", folder=folder)
    _beside(folder / "run.mcap", folder / "free.mcap", folder / "what-if.png")
    (folder / "what-if.txt").write_text(das_sim("report", "run.mcap", "free.mcap", folder=folder), encoding="utf-8")


def readme(folder: Path) -> None:
    """The output of the first minute, and its two drives side by side."""
    said = das_sim(folder=folder).splitlines()[:-1]  # The last line names the recordings.
    (folder / "first-minute.txt").write_text("".join(f"{line}\n" for line in said), encoding="utf-8")
    (made,) = (folder / "recordings").glob("*-guide.mcap")
    draw_first_minute(made.with_name(made.name.replace("-guide", "")), made, folder / "first-minute.png")


def draw_first_minute(recorded: Path, guided: Path, picture: Path) -> None:
    """Draw the drives of the first minute side by side, by the names that the picture of README has."""
    with tempfile.TemporaryDirectory() as folder:
        drives = [Path(folder) / f"{name}.mcap" for name in ("as recorded", "with the guide")]
        for path, made in zip(drives, (recorded, guided), strict=True):
            path.symlink_to(made.resolve())
        _beside(drives[0], drives[1], picture)


def _beside(first: Path, other: Path, picture: Path) -> None:
    """Draw two drives side by side, as in a report."""
    save_figure(picture, comparison_figure(sim.compare(first, other)))


def report(folder: Path) -> None:
    """The first page of the report on a run with a restriction."""
    das_sim("run", "restriction-ahead", "--seed", "1", "-o", folder / "run.mcap")
    das_sim("report", folder / "run.mcap", "-o", folder / "report.pdf")
    first_page(folder / "report.pdf", folder / "report.png")


PICTURES: Final[dict[str, Callable[[Path], None]]] = {
    "what-if": what_if,
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
