"""How often the analysis of an experiment errs and finds, on simulated drivers who really drive.

A pool of participants drives one line with the same advice under two labels, and with a planted effect: the train asks
more of the friction brake where the motors could brake. Studies are drawn from the pool, and each goes through the test
of `das-sim experiment analyse`. The result is a table of docs/explanation/experiment-statistics.md.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from sim.experiment.analysis.pairs import PairedTrials, paired_trials
from sim.experiment.analysis.plan import PlannedDifference
from sim.experiment.analysis.power import AT_ONCE, RESAMPLES, PowerQuestion, of_pilot, power_of, share_interval
from sim.experiment.analysis.reading import Floats, RunStudy, read_study
from sim.experiment.analysis.resampling import probabilities_at_once, weights
from sim.experiment.design import read_design
from sim.experiment.freezing import freeze
from sim.experiment.jobs import Keep, jobs_of
from sim.experiment.running import Workers, run_study
from sim.experiment.setting import study_days

MEASURE: Final = "gap_to_optimum_ratio"
DAY: Final = "zug-luzern"
USUAL_RATIO: Final = 0.40
"""Share of a braking effort asked of the friction brake: the default of the human driver."""
PLANTED_RATIO: Final = 0.475
"""With this share the gap is about 1 point larger; the table has what it came to."""
LABELS: Final = {"advice": USUAL_RATIO, "same-advice": USUAL_RATIO, "planted": PLANTED_RATIO}
POOL: Final = 240
"""Participants from whom studies are drawn."""
PILOT: Final = 120
"""Participants, others than those of the pool, from whom the power is predicted."""
FIRST_OF_PILOT: Final = 100_001
STUDIES: Final = 2000
SIZES: Final = (24, 48, 76)
ALPHA: Final = 0.05
RUNS: Final = Path("recordings") / "runs" / "known-truth"
"""Where the drives are kept: a table that was stopped goes on from there."""


@dataclass(frozen=True, kw_only=True)
class Share:
    """The share of studies that found a difference, with its 95 % interval."""

    found: float
    interval: tuple[float, float]


def known_truth_table(folder: Path = RUNS) -> Iterator[str]:
    """The lines of the table, in Markdown; drives what is not driven yet, which takes about 15 min of one core."""
    pool = driven(folder / "pool", POOL, first=1)
    pilot = driven(folder / "pilot", PILOT, first=FIRST_OF_PILOT)
    yield f"| question | drivers in a study | found in {STUDIES} studies | expected |"
    yield "|---|---:|---:|---:|"
    same = compared(pool, "same-advice")
    for size in SIZES:
        share = share_without(same, size)
        yield f"| identical advice under two labels | {size} | {in_words(share)} | 5 % |"
    planted, known = compared(pool, "planted"), of_pilot(compared(pilot, "planted"), None)
    points = 100.0 * float(planted.differences.mean())
    for size in SIZES:
        question = PowerQuestion(effect=points / 100.0, alpha=ALPHA, source=known)
        share = share_with(planted, size)
        expected = f"{100 * power_of(question, size).power:.1f} %"
        yield f"| a planted effect of {points:.2f} points | {size} | {in_words(share)} | {expected} |"
    spread = [100.0 * float(compared(one, "planted").differences.std(ddof=1)) for one in (pool, pilot)]
    yield ""
    yield (
        f"Differences of single drivers have a standard deviation of {spread[0]:.2f} points in the pool and of "
        f"{spread[1]:.2f} points in the pilot."
    )


def in_words(share: Share) -> str:
    """A share in percent, with its interval."""
    low, high = share.interval
    return f"{100 * share.found:.1f} % ({100 * low:.1f} to {100 * high:.1f})"


def driven(folder: Path, count: int, first: int) -> RunStudy:
    """The study of so many participants, from number `first` of the population on; what is there is not driven again.

    `das-sim experiment check` would refuse its design, because nobody senses that two labels are of one advice.
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
    return paired_trials(study, PlannedDifference(name=label, measure=MEASURE, factor="scenario", a=a, b=b))


def share_without(pairs: PairedTrials, size: int, studies: int = STUDIES) -> Share:
    """The share of studies that find a difference where there is none; studies are drawn with replacement.

    Which of a participant's two drives has which label is drawn for every study, because the labels mean nothing.
    """
    rng = np.random.default_rng([size, 1])
    return _share(pairs, size, studies, rng, swapped=True)


def share_with(pairs: PairedTrials, size: int, studies: int = STUDIES) -> Share:
    """The share of studies that find the difference of the pool; studies are drawn with replacement."""
    return _share(pairs, size, studies, np.random.default_rng([size, 2]), swapped=False)


def _share(pairs: PairedTrials, size: int, studies: int, rng: np.random.Generator, *, swapped: bool) -> Share:
    differences: Floats = pairs.by_participant(pairs.differences)
    drawn = weights(size, RESAMPLES, rng)
    found = 0
    for start in range(0, studies, AT_ONCE):
        count = min(AT_ONCE, studies - start)
        values = differences[rng.integers(0, len(differences), (count, size))]
        if swapped:
            values = values * rng.choice((-1.0, 1.0), values.shape)
        found += int(np.sum(probabilities_at_once(values, drawn) < ALPHA))
    return Share(found=found / studies, interval=share_interval(found, studies))
