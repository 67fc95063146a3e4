"""The kept run of the bundled study preview-of-advice: its report, its forest plot, and the power of its comparisons.

`python -m docs.studies.preview_of_advice` draws the plot next to the trials in docs/results/0.2/preview-of-advice; with
`site` it writes report.html and power.md into the working folder, for the site. The trials were driven by `das-sim
experiment run preview-of-advice` (four minutes of CPU time).

Power is the share of simulated studies in which a difference is statistically significant. Each has drivers drawn from
the kept ones, with all their differences together; the means are shifted to the differences to be detected.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from scipy import stats

from docs.studies.bundled import das_sim
from docs.studies.cases import Floats
from docs.studies.output import DOCS, Output
from sim.experiment.analysis.comparing import (
    RunStudy,
    ShownMeasure,
    analyse_study,
    corrected,
    paired_trials,
    read_study,
)
from sim.experiment.analysis.page import differences_figure

KEPT: Final = DOCS / "results" / "0.2" / "preview-of-advice"
PAGE: Final = KEPT.with_name("preview-of-advice.md")
SIZES: Final = (12, 18, 24, 30, 36)
STUDIES: Final = 2000
GAP: Final = "gap_to_optimum_ratio"
WORTH: Final[Mapping[str, float]] = {
    "preview: gap": -0.08,
    "preview: following": -0.03,
    "reason: gap": -0.08,
    "paper: gap": -0.08,
    "advice: gap": -0.12,
}
"""The differences to be detected, by comparison: in the gap, two thirds of what advice saves simulated drivers."""


def differences(study: RunStudy) -> Floats:
    """The differences of the drivers (drivers, comparisons), in the order of the design."""
    return np.column_stack([paired_trials(study, one).means for one in study.design.comparisons])


def power(found: Floats, effects: Floats, drivers: int, correction: str, alpha: float) -> Floats:
    """The share of simulated studies that find each difference, after correction for their number (comparisons,).

    `found` are the differences of a pilot's drivers (drivers, comparisons), `effects` the true means to be detected.
    """
    rng = np.random.default_rng([1, drivers])
    centred = (found - found.mean(axis=0)) * np.sqrt(len(found) / (len(found) - 1))
    drawn = effects + centred[rng.integers(len(found), size=(STUDIES, drivers))]
    chance = stats.ttest_1samp(drawn, 0.0, axis=1).pvalue
    return np.asarray(np.mean([corrected(one, correction) < alpha for one in chance], axis=0))


def power_table(study: RunStudy) -> Iterator[str]:
    """The power of each planned comparison by the number of drivers, as a Markdown table."""
    design, found = study.design, differences(study)
    effects = np.array([WORTH[one.name] for one in design.comparisons])
    rows = np.column_stack([power(found, effects, n, design.correction, design.alpha) for n in SIZES])
    yield f"| comparison | to detect | spread of drivers | {' | '.join(f'{n} drivers' for n in SIZES)} |"
    yield f"|---|---:|---:|{'---:|' * len(SIZES)}"
    for one, effect, sd, row in zip(design.comparisons, effects, found.std(axis=0, ddof=1), rows, strict=True):
        shown = ShownMeasure.of(one.measure, study.trials.values[one.measure])
        cells = (f"{100.0 * share:.0f} %" for share in row)
        yield (
            f"| {one.name}: {one.contrast()} | {100.0 * effect:+.0f} {shown.difference_unit} | {100.0 * sd:.1f} | "
            f"{' | '.join(cells)} |"
        )


def main(args: Sequence[str] = ()) -> None:
    """Draw the plot next to the trials, or write report and table of power into the working folder."""
    study = read_study(KEPT)
    if "site" in args:
        das_sim("experiment", "analyse", KEPT, "-o", "report.html", folder=Path.cwd())
        Output(Path.cwd()).text("power.md", "".join(f"{line}\n" for line in power_table(study)))
        return
    gaps = [one for one in analyse_study(study).differences if one.comparison.measure == GAP]
    Output(KEPT).picture("forest", differences_figure(gaps, study.design.alpha))


if __name__ == "__main__":
    main(sys.argv[1:])
