"""The commands `das-sim experiment analyse` and `das-sim experiment power`."""

from __future__ import annotations

import importlib.util
import json
import math
from pathlib import Path
from typing import Annotated, Any

import typer

from das.command_line.options import JsonOption, SeedOption
from das.command_line.outputs import check_outputs
from das.command_line.printing import busy, paragraph, print_table, tell
from das.domain.errors import DasError

DEFAULT_PARTICIPANTS = "12,24,36,48,76,100,150"
MOST_ROWS = 50


def analyse(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a study that das-sim experiment run made.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="Page to write (.html) [default: print in words]."),
    ] = None,
    pdf: Annotated[
        Path | None, typer.Option("--pdf", metavar="FILE", help="The page as PDF, where Chromium is installed.")
    ] = None,
    effect: Annotated[
        list[float] | None,
        typer.Option(
            "--effect",
            metavar="X",
            help="Also say how many participants would show a difference of X, in the unit of the report (points for a "
            "ratio); may be given several times.",
            show_default=False,
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Analyse a study that was run: paired differences with intervals, a mixed model, checks."""
    _check_extra("jinja2", "matplotlib", "scipy", "statsmodels")
    for path, suffixes in ((out, (".html", ".htm")), (pdf, (".pdf",))):
        if path is not None and path.suffix.lower() not in suffixes:
            raise DasError(f"{path}: expected a file name that ends in {' or '.join(suffixes)}")
    check_outputs(out, pdf, inputs=[folder / "design.json", folder / "trials.csv", folder / "trials.json"])
    for one in effect or ():
        if not (math.isfinite(one) and one > 0):
            raise DasError(f"--effect {one:g}: expected a number above 0")
    if pdf is not None:
        from sim.report.printing import browser

        browser()
    from das.domain.files.writing import write_whole
    from sim.experiment.analysis.comparing import analyse_study
    from sim.experiment.analysis.page import as_dict, page
    from sim.experiment.analysis.reading import read_study
    from sim.experiment.analysis.words import hangs_on, in_short
    from sim.report.printing import write_pdf

    study = read_study(folder)
    with busy("analysing the trials …"):
        found = analyse_study(study, tuple(effect or ()))
    if out is not None or pdf is not None:
        with busy("drawing the page …"):
            content = page(found)
        if out is not None:
            write_whole(out, content.encode())
        if pdf is not None:
            with busy(f"printing {pdf} …"):
                write_pdf(content, pdf)
    if as_json:
        print(json.dumps(as_dict(found)))
        return
    for line in hangs_on(found):
        paragraph(line)
    for name, line in in_short(found):
        paragraph(f"{name}: {line}" if name else line)
    for path in (out, pdf):
        if path is not None:
            tell(f"written: {path}")


def power(
    source: Annotated[
        Path | None,
        typer.Argument(
            metavar="DIR|DESIGN",
            help="Folder of a pilot study, whose drivers are drawn again; or a frozen design (design.json), for its "
            "level and number of comparisons (then --sd is needed).",
            show_default=False,
        ),
    ] = None,
    effect: Annotated[
        float | None,
        typer.Option(
            "--effect",
            metavar="X",
            help="True difference to be found, in the unit of the report (points for a ratio).",
            show_default=False,
        ),
    ] = None,
    comparison: Annotated[
        str | None,
        typer.Option(
            "--comparison", metavar="NAME", help="Planned comparison [default: the first].", show_default=False
        ),
    ] = None,
    participants: Annotated[
        str, typer.Option("--participants", metavar="LIST", help="Numbers of participants, with commas between.")
    ] = DEFAULT_PARTICIPANTS,
    wanted: Annotated[
        float, typer.Option("--power", metavar="X", help="Share of studies that are to find the difference.")
    ] = 0.8,
    sd: Annotated[
        float | None,
        typer.Option(
            "--sd",
            metavar="X",
            help="Standard deviation of the difference between participants (bell curve), not a pilot's drivers.",
            show_default=False,
        ),
    ] = None,
    sd_of_pairs: Annotated[
        float, typer.Option(
            "--sd-pairs", metavar="X", help="With --sd: standard deviation between pairs of one participant."
        ),
    ] = 0.0,
    pairs: Annotated[
        int | None,
        typer.Option(
            "--pairs",
            metavar="N",
            min=1,
            help="Pairs of trials that each participant drives [default: as in the pilot, or 1].",
            show_default=False,
        ),
    ] = None,
    alpha: Annotated[
        float | None,
        typer.Option(
            "--alpha", metavar="X", help="Level of the test [default: the design's, or 0.05].", show_default=False
        ),
    ] = None,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:  # fmt: skip
    """Say how often an experiment would find a difference, and how many participants it needs."""
    _check_extra("scipy")
    from sim.experiment.analysis.asking import Asked, answer

    if effect is None or not (math.isfinite(effect) and effect > 0):
        raise DasError(f"--effect {'is missing' if effect is None else f'{effect:g}'}: expected a number above 0")
    asked = Asked(
        source=source, effect=effect, comparison=comparison, participants=_counts(participants), wanted=wanted, sd=sd,
        sd_of_pairs=sd_of_pairs, pairs=pairs, alpha=alpha, seed=seed,
    )  # fmt: skip
    with busy("simulating experiments …"):
        found = answer(asked)
    if as_json:
        print(json.dumps(found.as_dict()))
        return
    _print_power(found)


def _print_power(found: Any) -> None:
    from rich.table import Table

    paragraph(found.about)
    table = Table()
    table.add_column("participants", justify="right")
    table.add_column("power", justify="right")
    table.add_column("95 %", justify="right")
    if found.strict:
        table.add_column("corrected", justify="right")
    for index, one in enumerate(found.points):
        low, high = one.interval
        cells = [str(one.participants), f"{one.power:.0%}", f"{low:.0%} to {high:.0%}"]
        table.add_row(*cells, *([f"{found.strict[index].power:.0%}"] if found.strict else []))
    legend = {
        "power": "share of simulated experiments that find the difference",
        "95 %": "how well that share is known",
    }
    if found.strict:
        legend["corrected"] = "where only this one of the planned comparisons is true, and p is corrected"
    print_table(table, legend)
    for line in found.sentences:
        paragraph(line)


def _counts(text: str) -> tuple[int, ...]:
    parts = [part.strip() for part in text.split(",")]
    if len(parts) > MOST_ROWS or not all(part.isascii() and part.isdigit() and len(part) < 8 for part in parts):
        raise DasError(f"--participants {text}: expected at most {MOST_ROWS} whole numbers with commas between")
    return tuple(sorted({int(part) for part in parts}))


def _check_extra(*names: str) -> None:
    missing = [name for name in names if importlib.util.find_spec(name) is None]
    if missing:
        raise DasError(f"{missing[0]} is not installed: pip install '.[experiment]' in the checkout")
