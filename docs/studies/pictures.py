"""The pictures of recordings in the pages, drawn from drives that are made for them, into the working folder.

`python -m docs.studies.pictures first-minute` writes what the first minute prints (first-minute.txt) and review.png;
`readme` first-minute.png, the picture of README; `what-if` what-if.txt and what-if.png. `report` draws report.png, and
needs Chromium and pdftoppm (poppler): its picture is one of release 0.2, in docs/results/0.2/screens.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from docs.studies.bundled import das_sim, first_page


def first_minute(folder: Path) -> None:
    """The first minute: what it prints, and all about the drive with the coach, with the recorded one beside it."""
    said, recorded, coached = _driven(folder)
    (folder / "first-minute.txt").write_text("".join(f"{line}\n" for line in said), encoding="utf-8")
    das_sim("view", coached, "--beside", recorded, "--plot", folder / "review.png")


def readme(folder: Path) -> None:
    """The two drives of the first minute beside each other."""
    _, recorded, coached = _driven(folder)
    das_sim("compare", recorded, coached, "--plot", folder / "first-minute.png")


def _driven(folder: Path) -> tuple[list[str], Path, Path]:
    """What the first minute prints, and its recordings by the names that pictures have."""
    said = das_sim(folder=folder).splitlines()[:-1]  # The last line names the recordings.
    recorded, coached = (folder / f"{name}.mcap" for name in ("as recorded", "with the coach"))
    (made,) = (folder / "recordings").glob("*-coach.mcap")
    made.with_name(made.name.replace("-coach", "")).rename(recorded)
    made.rename(coached)
    return said, recorded, coached


def what_if(folder: Path) -> None:
    """The day with a restriction of the guide, and the same day without it, compared."""
    recorded, without = (folder / f"{name}.mcap" for name in ("recorded", "no-restriction"))
    das_sim("run", "restriction-ahead", "--seed", "1", "--advice", "vector", "-o", recorded)
    das_sim("what-if", recorded, "--without-restrictions", "--driven-anew", "-o", without)
    said = das_sim("compare", recorded.name, without.name, "--plot", "what-if.png", folder=folder)
    (folder / "what-if.txt").write_text(said, encoding="utf-8")


def report(folder: Path) -> None:
    """The first page of the report of a day with a restriction."""
    das_sim("run", "restriction-ahead", "--seed", "1", "-o", folder / "run.mcap")
    das_sim("report", folder / "run.mcap", "-o", folder / "report.pdf")
    first_page(folder / "report.pdf", folder / "report.png")


PICTURES: Final[dict[str, Callable[[Path], None]]] = {
    "first-minute": first_minute,
    "readme": readme,
    "what-if": what_if,
    "report": report,
}


def main(args: Sequence[str] | None = None) -> None:
    """Draw the pictures that are named."""
    parser = argparse.ArgumentParser(prog="python -m docs.studies.pictures", description=__doc__)
    parser.add_argument("names", nargs="+", choices=list(PICTURES), metavar="NAME", help=", ".join(PICTURES))
    for name in parser.parse_args(args).names:
        PICTURES[name](Path.cwd())


if __name__ == "__main__":
    main()
