"""How often the analysis of an experiment errs, and how often it finds an effect, on simulated drives.

A pool of participants drives one line with the same advice under two labels, and with a planted effect: the driver uses
the friction brake more where the motors could brake. Studies are drawn from the pool, and each goes through the test
of `das-sim experiment analyse`. `python -m docs.studies.known_truth` writes the table into
docs/explanation/experiment-statistics.md again.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from docs.studies.output import DOCS, write_table
from precompute.workers import Workers
from sim.experiment.analysis.differences import PairedTrials, paired_trials
from sim.experiment.analysis.power import (
    AT_ONCE,
    PATTERNS_EACH,
    PilotDifferences,
    PowerQuestion,
    power_of,
    share_interval,
)
from sim.experiment.analysis.reading import Floats, RunStudy, read_study
from sim.experiment.analysis.sign_flips import probabilities, signs_of
from sim.experiment.design import freeze, read_design
from sim.experiment.factors import study_days
from sim.experiment.plan import PlannedComparison
from sim.experiment.trials import Keep, jobs_of, run_study

MEASURE: Final = "gap_to_optimum_ratio"
DAY: Final = "zug-luzern"
USUAL_RATIO: Final = 0.40
"""Share of a braking effort asked of the friction brake: the default of the human driver."""
PLANTED_RATIO: Final = 0.475
"""With this share the gap to the optimum is about 1 point larger; the table has the exact figure."""
LABELS: Final = {"advice": USUAL_RATIO, "same-advice": USUAL_RATIO, "planted": PLANTED_RATIO}
DRIVERS: Final = {1: 240, 100_001: 120}
"""Participants: the first one's number in the population → how many from there on."""
STUDIES: Final = 2000
SIZES: Final = (24, 48, 76)
SPLITS: Final = 40
"""How often the participants are divided at random into participants of a pilot and of studies."""
STUDIES_OF_SPLIT: Final = 1000
NEAR: Final = 0.07
"""A prediction of power is near if it is off by no more than this."""
ALPHA: Final = 0.05
RUNS: Final = DOCS.parent / "recordings" / "runs" / "known-truth"
"""Where the drives are kept: a command that was stopped goes on from there."""


@dataclass(frozen=True, kw_only=True)
class Share:
    """The share of studies that found a difference, with its 95 % interval."""

    found: float
    interval: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Predictions:
    """Power predicted from half of the drivers, and the share of the other half's studies that find the effect."""

    predicted: Floats
    found: Floats

    @property
    def off(self) -> Floats:
        """Magnitude of the error of each prediction."""
        return np.asarray(np.abs(self.predicted - self.found))


def known_truth_table() -> Iterator[str]:
    """The lines of the table, in Markdown; drives that are missing are driven, in about 15 min on one core."""
    studies = [driven(RUNS / str(first), count, first) for first, count in DRIVERS.items()]
    same, planted = (differences(studies, label) for label in ("same-advice", "planted"))
    yield "| question | drivers in a study | studies that find a difference | expected | predictions within ±7 points |"
    yield "|---|---:|---:|---:|---:|"
    for size in SIZES:
        yield f"| identical advice under two labels | {size} | {in_words(share_without(same, size))} | 5 % | |"
    points = 100.0 * planted.mean()
    for size in SIZES:
        one = predictions(planted, size)
        found, expected = (f"{100 * values.mean():.1f} %" for values in (one.found, one.predicted))
        near = f"{100 * np.mean(one.off <= NEAR):.0f} %, the farthest off by {100 * one.off.max():.0f} points"
        yield f"| a planted effect of {points:.2f} points | {size} | {found} | {expected} | {near} |"
    yield ""
    yield (
        f"The differences of single drivers have a standard deviation of {100 * planted.std(ddof=1):.1f} points; the "
        f"farthest tenth of them are {100 * np.quantile(np.abs(planted - planted.mean()), 0.9):.1f} to "
        f"{100 * np.abs(planted - planted.mean()).max():.1f} points from the mean."
    )


def differences(studies: Sequence[RunStudy], label: str) -> Floats:
    """The difference of each driver's two drives, with a label and with the usual advice, (drivers,)."""
    pairs = [compared(study, label) for study in studies]
    return np.concatenate([one.means for one in pairs])


def predictions(values: Floats, size: int, splits: int = SPLITS) -> Predictions:
    """Divide the drivers (n,) at random, many times: predict power from one half, and draw studies from the other.

    Power is predicted for the mean effect of the half whose studies are drawn.
    """
    rng = np.random.default_rng([size, 3])
    predicted, found = [], []
    for split in range(splits):
        mixed = rng.permutation(values)
        pilot, rest = mixed[: len(values) // 2], mixed[len(values) // 2 :]
        spread = (pilot - pilot.mean()) * math.sqrt(len(pilot) / (len(pilot) - 1))
        source = PilotDifferences(between=spread, within=np.zeros(0), pairs=1)
        question = PowerQuestion(
            effect=float(rest.mean()), alpha=ALPHA, source=source, seed=split, studies=STUDIES_OF_SPLIT
        )
        predicted.append(power_of(question, size).power)
        found.append(_share(rest, size, STUDIES_OF_SPLIT, rng, swapped=False).found)
    return Predictions(predicted=np.array(predicted), found=np.array(found))


def in_words(share: Share) -> str:
    """A share in percent, with its interval."""
    low, high = share.interval
    return f"{100 * share.found:.1f} % ({100 * low:.1f} to {100 * high:.1f})"


def driven(folder: Path, count: int, first: int) -> RunStudy:
    """The study of `count` participants, from number `first` of the population on; finished drives are kept.

    `das-sim experiment check` would refuse its design, because no driver notices that two labels mean one advice.
    """
    design = read_design(written_design(folder / "design", count, first))
    freeze(design, folder)
    run_study(design, jobs_of(design, Keep.MEASURES, folder), folder, Workers(count=os.cpu_count() or 1))
    return read_study(folder)


def written_design(folder: Path, count: int, first: int) -> Path:
    """Write the design and one scenario for each label; returns the path of the design."""
    folder.mkdir(parents=True, exist_ok=True)
    day = study_days()[DAY].read_text(encoding="utf-8")
    for label, ratio in LABELS.items():
        own = day.replace(f'id = "{DAY}"', f'id = "{label}"') + f"\n[human]\nfriction_ratio = {ratio}\n"
        (folder / f"{label}.toml").write_text(own, encoding="utf-8")
    levels = ", ".join(f'"{label}.toml"' for label in LABELS)
    path = folder / "known-truth.toml"
    path.write_text(
        "schema_version = 1\n"
        f'[experiment]\nname = "known-truth"\ntitle = "Is what is known found?"\nseed = {first}\n'
        f"[participants]\ncount = {count}\nfirst = {first}\n"
        f'[[factors]]\nname = "scenario"\nlevels = [{levels}]\n'
        f'[analysis]\nmeasures = ["{MEASURE}"]\n',
        encoding="utf-8",
    )
    return path


def compared(study: RunStudy, label: str) -> PairedTrials:
    """The pairs of a label and of the usual advice."""
    a, b = label, next(iter(LABELS))
    return paired_trials(study, PlannedComparison(name=label, measure=MEASURE, factor="scenario", a=a, b=b))


def share_without(values: Floats, size: int, studies: int = STUDIES) -> Share:
    """The share of studies that find a difference although there is none; studies are drawn with replacement.

    Which of a driver's two drives has which label is drawn for every study, because the labels mean nothing.
    """
    return _share(values, size, studies, np.random.default_rng([size, 1]), swapped=True)


def _share(values: Floats, size: int, studies: int, rng: np.random.Generator, *, swapped: bool) -> Share:
    signs = signs_of(size, rng, PATTERNS_EACH)
    found = 0
    for start in range(0, studies, AT_ONCE):
        count = min(AT_ONCE, studies - start)
        chosen = values[rng.integers(0, len(values), (count, size))]
        if swapped:
            chosen = chosen * rng.choice((-1.0, 1.0), chosen.shape)
        found += int(np.sum(probabilities(chosen, signs) < ALPHA))
    return Share(found=found / studies, interval=share_interval(found, studies))


if __name__ == "__main__":
    write_table(DOCS / "explanation" / "experiment-statistics.md", "known-truth", known_truth_table())
