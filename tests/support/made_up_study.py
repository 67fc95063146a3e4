"""Studies whose true effects are known: made-up trials of made-up drivers, in memory or as the folder of a study.

Drivers differ in their mean and in the effect of a condition on them, both with skewed distributions. Conditions differ
in noise, by a factor of 7 at most.
"""

from __future__ import annotations

import csv
import io
import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sim.experiment.analysis.comparing import (
    FinishedTrials,
    Floats,
    RunStudy,
    generator,
    paired_estimate,
    paired_trials,
)
from sim.experiment.design import Design, Factor, People, PlannedComparison, Procedure
from sim.experiment.factors import FactorLevel

MEASURE = "gap_to_optimum_ratio"
LEVELS = ("none", "top-speed", "speed-and-effort")
NOISE = (0.0034, 0.023, 0.018)
"""The residual standard deviations measured on the simulated driver (ratios)."""


@dataclass(frozen=True, kw_only=True)
class Truth:
    """The true parameters of a made-up study: means of the conditions, and standard deviations of all random parts."""

    drivers: int = 24
    days: int = 3
    means: tuple[float, ...] = (0.26, 0.25, 0.24)
    noise: tuple[float, ...] = NOISE
    level_sd: float = 0.03
    effect_sd: float = 0.015
    day_sd: float = 0.01
    shared_days: bool = True
    skewed: bool = True
    extra: dict[str, float] = field(default_factory=dict)
    """Optional effects. `drift` is added for each earlier trial, `carried` right after a trial with the last level."""


def drawn(rng: np.random.Generator, shape: tuple[int, ...], skewed: bool) -> Floats:
    """Random numbers with mean 0 and standard deviation 1; if `skewed`, from a gamma distribution (skewness 1.2)."""
    return rng.gamma(3.0, size=shape) / np.sqrt(3.0) - np.sqrt(3.0) if skewed else rng.normal(size=shape)


def made_up_study(truth: Truth, seed: int, comparisons: tuple[PlannedComparison, ...] = ()) -> RunStudy:
    """A study in memory in which each driver drives every level on each of his days, in his own order."""
    rng = np.random.default_rng(seed)
    n, k, levels = truth.drivers, truth.days, len(truth.means)
    level = truth.level_sd * drawn(rng, (n, 1, 1), truth.skewed)
    effects = truth.effect_sd * drawn(rng, (n, 1, levels), truth.skewed)
    effects[:, :, 0] = 0.0
    days = truth.day_sd * np.broadcast_to(rng.normal(size=(1 if truth.shared_days else n, k, 1)), (n, k, 1))
    noise = np.array(truth.noise) * rng.normal(size=(n, k, levels))
    values = np.array(truth.means) + level + effects + days + noise
    order = np.argsort(rng.random((n, k * levels)), axis=1)
    position = np.argsort(order, axis=1).reshape(n, k, levels)
    values = (
        values + truth.extra.get("drift", 0.0) * position + truth.extra.get("carried", 0.0) * after_last(order, levels)
    )
    driver, day, which = np.broadcast_arrays(*np.ogrid[:n, :k, :levels])
    names = LEVELS[:levels]
    return RunStudy(
        folder=Path("made-up"),
        design=Design(
            name="made-up", title="Made up", description="", source=Path("made-up"), hash="0" * 64, seed=1, fixed={},
            measures=(MEASURE,),
            factors=(presentations(*names),),
            people=People(count=n),
            procedure=Procedure(repetitions=k),
            comparisons=comparisons or (compared("speed-and-effort" if levels > 2 else names[1], "none"),),
        ),
        trials=FinishedTrials(
            participant=np.array([f"sub-{one + 1:02d}" for one in driver.ravel()]),
            position=position.ravel() + 1,
            practice=np.zeros(n * k * levels, dtype=bool),
            day=np.array([str(one) for one in (day if truth.shared_days else driver * k + day).ravel()]),
            levels={"presentation": np.array(names)[which.ravel()]},
            values={MEASURE: values.ravel()},
        ),
    )  # fmt: skip


def presentations(*names: str, within: bool = True) -> Factor:
    """The factor of made-up studies, with these levels."""
    levels = tuple(FactorLevel(text=name, value=None) for name in names)
    return Factor(name="presentation", levels=levels, within=within)


def made_up_groups(truth: Truth, seed: int) -> RunStudy:
    """A study of two levels in which each driver drives only one: odd drivers the first, even drivers the second."""
    whole = made_up_study(truth, seed)
    trials, design = whole.trials, whole.design
    names, level = list(np.unique(trials.participant)), trials.levels["presentation"]
    wanted = np.array([LEVELS[names.index(one) % 2] for one in trials.participant])
    kept = level == wanted
    return replace(
        whole,
        design=replace(design, factors=tuple(replace(one, within=False) for one in design.factors)),
        trials=replace(
            trials, participant=trials.participant[kept], practice=trials.practice[kept], day=trials.day[kept],
            position=np.arange(kept.sum()) % truth.days + 1, levels={"presentation": level[kept]},
            values={MEASURE: trials.values[MEASURE][kept]},
        ),
    )  # fmt: skip


def after_last(order: Any, levels: int) -> Floats:
    """1 for each trial right after a trial with the last level, else 0; shape (drivers, days, levels)."""
    n, trials = order.shape
    result = np.zeros((n, trials))
    for row in range(n):
        for place in range(1, trials):
            result[row, order[row, place]] = order[row, place - 1] % levels == levels - 1
    return result.reshape(n, -1, levels)


def eight_drivers() -> RunStudy:
    """A study of `EIGHT_POINTS`; one condition has no noise, with which the full mixed model fails."""
    truth = Truth(
        drivers=8, days=4, means=(0.2, 0.2), noise=(0.0, 0.02), level_sd=0.0, effect_sd=0.0, day_sd=0.0,
        shared_days=False,
    )  # fmt: skip
    study = made_up_study(truth, 2, (APART,))
    trials, pairs = study.trials, paired_trials(study, APART)
    owner = np.searchsorted(pairs.participants, trials.participant)
    missing = np.array(EIGHT_POINTS) / 100.0 - pairs.means
    values = trials.values[MEASURE] + missing[owner] * (trials.levels["presentation"] == APART.a)
    return replace(study, trials=replace(trials, values={MEASURE: values}))


def compared(a: str, b: str, **settings: Any) -> PlannedComparison:
    """A planned comparison of two presentations."""
    given = {"name": f"{a} against {b}", "measure": MEASURE, "factor": "presentation", **settings}
    return PlannedComparison(a=a, b=b, **given)


SPEED_AND_EFFORT = compared("speed-and-effort", "none")
APART = compared("top-speed", "none")
SAME = Truth(means=(0.25, 0.25), noise=(0.01, 0.02), effect_sd=0.0)
STUDIES = 200
EIGHT_POINTS = (6.9, 0.0, 2.6, 3.1, 27.9, 4.2, 11.7, -0.7)
"""Differences of eight drivers with one outlier: their mean is significant by sign flips (p = 8 / 256), but not by
Student's t."""


def probability(study: RunStudy, a: str, b: str) -> float:
    """The probability computed by the analysis for one comparison of a study."""
    pairs = paired_trials(study, compared(a, b))
    rng = generator(study, "made-up")
    return paired_estimate(pairs.means, rng).probability


def positive(truth: Truth, a: str, b: str, studies: int = STUDIES) -> float:
    """The share of made-up studies in which the analysis finds a significant difference."""
    return float(np.mean([probability(made_up_study(truth, seed), a, b) < 0.05 for seed in range(studies)]))


def design_of(study: RunStudy) -> dict[str, Any]:
    """The content of `design.json`, as `das-sim experiment run` writes it."""
    design = study.design
    return {
        "schema_version": 1,
        "hash": design.hash,
        "experiment": {"name": design.name, "title": design.title, "description": "", "seed": design.seed},
        "participants": {"count": design.people.count, "population": "default"},
        "procedure": {"repetitions": design.procedure.repetitions},
        "fixed": {"scenario": "clear-day"},
        "factors": [{"name": one.name, "levels": list(one.texts), "within": one.within} for one in design.factors],
        "analysis": {"measures": list(design.measures), "alpha": design.alpha, "correction": design.correction},
        "comparisons": [
            {"name": one.name, "measure": one.measure, "factor": one.factor, "a": one.a, "b": one.b, "where": {}}
            for one in design.comparisons
        ],
    }


def write_study(study: RunStudy, folder: Path) -> Path:
    """Write a study in memory as a folder from which the same trials can be read."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "design.json").write_text(json.dumps(design_of(study)), encoding="utf-8")
    text = io.StringIO()
    table, trials = csv.writer(text, lineterminator="\n"), study.trials
    head = ["trial", "participant", "session", "position", "practice", "condition"]
    table.writerow([*head, *trials.levels, "seed", *trials.values])
    for row in range(len(trials)):
        levels = [str(one[row]) for one in trials.levels.values()]
        values = ["" if np.isnan(one[row]) else repr(float(one[row])) for one in trials.values.values()]
        start = [row + 1, trials.participant[row], "ses-01", trials.position[row], int(trials.practice[row])]
        table.writerow([*start, "_".join(levels), *levels, trials.day[row], *values])
    (folder / "trials.csv").write_text(text.getvalue(), encoding="utf-8")
    return folder
