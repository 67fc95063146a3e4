"""The commands `das-sim experiment analyse` and `das-sim experiment power`."""

from __future__ import annotations

import importlib.util
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from das.command_line.options import JsonOption, OverwriteOption, SeedOption
from das.command_line.outputs import check_outputs
from das.command_line.printing import busy, paragraph, print_table, tell
from das.domain.errors import DasError
from sim.cli.experiment_analysis_options import (
    DEFAULT_PARTICIPANTS,
    AlphaOption,
    ComparisonOption,
    EffectOption,
    EffectsOption,
    GroupsOption,
    NumbersOption,
    PageOption,
    PairsOption,
    PdfOption,
    PilotArgument,
    SdOfPairsOption,
    SdOption,
    StudyArgument,
    WantedOption,
)
from sim.experiment.plan import DESIGN_JSON, TRIALS_SIDECAR, TRIALS_TABLE

if TYPE_CHECKING:
    from sim.experiment.analysis.power import PowerAnswer

MOST_ROWS = 50


def analyse(
    folder: StudyArgument,
    out: PageOption = None,
    pdf: PdfOption = None,
    effect: EffectsOption = None,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Analyse a study that was run: paired differences with intervals, a mixed model, checks."""
    _check(folder, (out, pdf), effect or (), overwrite=overwrite)
    from das.domain.files.writing import write_whole
    from sim.experiment.analysis.comparing import analyse_study
    from sim.experiment.analysis.page import as_dict, page
    from sim.experiment.analysis.reading import read_study
    from sim.experiment.analysis.words import hangs_on, in_short
    from sim.review.report.page import write_pdf

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


def _check(folder: Path, files: tuple[Path | None, Path | None], effects: Sequence[float], *, overwrite: bool) -> None:
    """DasError where an output cannot be made or an option is wrong; asked before the work begins."""
    _check_extra("jinja2", "matplotlib", "scipy", "statsmodels")
    out, pdf = files
    for path, suffixes in ((out, (".html", ".htm")), (pdf, (".pdf",))):
        if path is not None and path.suffix.lower() not in suffixes:
            raise DasError(f"{path}: expected a file name that ends in {' or '.join(suffixes)}")
    read = [folder / name for name in (DESIGN_JSON, TRIALS_TABLE, TRIALS_SIDECAR)]
    check_outputs(out, pdf, inputs=read, overwrite=overwrite)
    for one in effects:
        _check_effect(one)
    if pdf is not None:
        from sim.review.report.page import browser

        browser()


def _check_effect(effect: float) -> None:
    if not (math.isfinite(effect) and effect > 0):
        raise DasError(f"--effect {effect:g}: expected a number above 0")


def _check_extra(*names: str) -> None:
    missing = [name for name in names if importlib.util.find_spec(name) is None]
    if missing:
        raise DasError(f"{missing[0]} is not installed: pip install '.[experiment]' in the checkout")


def power(
    effect: EffectOption,
    source: PilotArgument = None,
    comparison: ComparisonOption = None,
    participants: NumbersOption = DEFAULT_PARTICIPANTS,
    wanted: WantedOption = 0.8,
    sd: SdOption = None,
    sd_of_pairs: SdOfPairsOption = 0.0,
    pairs: PairsOption = None,
    groups: GroupsOption = False,
    alpha: AlphaOption = None,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Say how often an experiment would find a difference, and how many participants it needs."""
    _check_extra("scipy")
    _check_effect(effect)
    from sim.experiment.analysis.power import Asked, answer

    asked = Asked(
        source=source, effect=effect, comparison=comparison, participants=_counts(participants), wanted=wanted, sd=sd,
        sd_of_pairs=sd_of_pairs, pairs=pairs, alpha=alpha, seed=seed,
        groups=groups,
    )  # fmt: skip
    with busy("simulating experiments …"):
        found = answer(asked)
    if as_json:
        print(json.dumps(found.as_dict()))
        return
    _print_power(found)


def _print_power(found: PowerAnswer) -> None:
    from rich.table import Table

    paragraph(found.about)
    table = Table()
    for name in (
        "in each group" if found.groups else "participants",
        "power",
        "95 %",
        *(["corrected"] if found.strict else []),
    ):
        table.add_column(name, justify="right")
    for index, one in enumerate(found.points):
        low, high = one.interval
        cells = [str(one.participants), f"{one.power:.0%}", f"{low:.0%} to {high:.0%}"]
        table.add_row(*cells, *([f"{found.strict[index].power:.0%}"] if found.strict else []))
    legend = {
        "power": "share of simulated experiments that find the difference",
        "95 %": "how well that share is known",
    }
    if found.strict:
        legend["corrected"] = "power where only this one of the planned comparisons is true, and p is corrected"
    print_table(table, legend)
    for line in found.sentences:
        paragraph(line)


def _counts(text: str) -> tuple[int, ...]:
    parts = [part.strip() for part in text.split(",")]
    if len(parts) > MOST_ROWS or not all(part.isascii() and part.isdigit() and len(part) < 8 for part in parts):
        raise DasError(f"--participants {text}: expected at most {MOST_ROWS} whole numbers with commas between")
    return tuple(sorted({int(part) for part in parts}))
