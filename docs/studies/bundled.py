"""The bundled studies: their reports, the pictures of the reports' first pages, and the tables of them.

`python -m docs.studies.bundled NAME` runs a study (smoke, pacing, level-through-a-driver or presentations), writes its
report into docs/reports and, for all but smoke, its picture into docs/images and its table into
docs/explanation/studies.md. The pictures need Chromium and pdftoppm (poppler). Trials are kept in build/studies: a
command that was stopped goes on from there.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from das.domain.errors import DasError
from docs.studies.made_by import DAY, ROOT, code_hash
from docs.studies.output import DOCS, write_table

PICTURES: Final = {
    "smoke": None,
    "pacing": "report-pacing",
    "level-through-a-driver": "report-level",
    "presentations": "experiment-report",
}
"""The studies, and the picture of each one's report."""
LEAST_P: Final = 0.001
"""A smaller p is not told more exactly."""
COLUMNS: Final = {
    "pacing": {
        "gap_to_optimum_ratio": "gap, %", "advice_changes_per_min": "advice changes a minute",
        "speed_rmse_mps": "speed error against what was shown, m/s",
    },
    "level-through-a-driver": {},
    "presentations": {
        "gap_to_optimum_ratio": "gap, %", "energy_at_equal_arrival_kwh": "kWh at equal arrival",
        "advice_changes_per_min": "advice changes a minute", "control_movements_per_min": "control movements a minute",
    },
}  # fmt: skip
"""The measures of the conditions that the page has, and what it calls them."""
PAGE: Final = DOCS / "explanation" / "studies.md"
BUILD: Final = ROOT / "build" / "studies"
PAGE_DPI: Final = 121
"""A4 becomes 1000 pixels wide."""


def conditions_table(result: Mapping[str, Any], columns: Mapping[str, str]) -> Iterator[str]:
    """The lines of a table of conditions: the mean of each measure; `result` is that of `analyse --json`."""
    found: dict[str, dict[str, float | None]] = {}
    for one in result["conditions"]:
        found.setdefault(one["condition"], {})[one["measure"]] = one["mean"]
    yield f"| condition | {' | '.join(columns.values())} |"
    yield f"|---|{'---:|' * len(columns)}"
    for condition, means in found.items():
        yield f"| {condition} | {' | '.join(figure(name, means.get(name)) for name in columns)} |"


def differences_table(result: Mapping[str, Any]) -> Iterator[str]:
    """The lines of a table of the planned comparisons, with their intervals and the decision."""
    yield "| planned comparison | difference | 95 % interval | corrected p | stands out |"
    yield "|---|---:|---:|---:|---|"
    for one in result["differences"]:
        unit = " points" if one["measure"].endswith("_ratio") else ""
        mean, low, high = (figure(one["measure"], value, sign="+") for value in (one["mean"], *one["interval"]))
        name = one["name"].replace("|", "/")
        decided = "yes" if one["stands_out"] else "no"
        p = f"{one['p_corrected']:.3f}" if one["p_corrected"] >= LEAST_P else f"< {LEAST_P}"
        yield f"| {name} | {mean}{unit} | {low} to {high} | {p} | {decided} |"


def figure(measure: str, value: float | None, sign: str = "") -> str:
    """A value of a measure: ratios in per cent, with one decimal; metres a second with two; empty if there is none."""
    if value is None:
        return ""
    decimals = 2 if measure.endswith("_mps") else 1
    return f"{100.0 * value if measure.endswith('_ratio') else value:{sign}.{decimals}f}"


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


def make(name: str) -> None:
    """Run a study, and write its report, its picture and its tables."""
    made_in = BUILD / code_hash((*DAY, "sim/experiment"))  # A report states its command: no path of this machine in it.
    made_in.mkdir(parents=True, exist_ok=True)
    das_sim("experiment", "run", name, "--out", name, folder=made_in)
    folder = made_in / name
    das_sim("experiment", "analyse", folder, "-o", DOCS / "reports" / f"{name}.html", "--overwrite")
    picture = PICTURES[name]
    if picture is None:
        return
    pdf = BUILD / f"{name}.pdf"
    das_sim("experiment", "analyse", folder, "-o", pdf, "--overwrite")
    first_page(pdf, DOCS / "images" / f"{picture}.png")
    result = json.loads(das_sim("experiment", "analyse", folder, "--json"))
    if COLUMNS[name]:
        write_table(PAGE, f"{name}-conditions", conditions_table(result, COLUMNS[name]))
    write_table(PAGE, f"{name}-differences", differences_table(result))


def main(args: Sequence[str] | None = None) -> None:
    """Make the studies that are named."""
    parser = argparse.ArgumentParser(prog="python -m docs.studies.bundled", description=__doc__)
    parser.add_argument("names", nargs="+", choices=list(PICTURES), metavar="NAME", help=", ".join(PICTURES))
    for name in parser.parse_args(args).names:
        make(name)


if __name__ == "__main__":
    main()
