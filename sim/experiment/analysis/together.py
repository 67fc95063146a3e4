"""Two studies of one design analysed together: people and simulated drivers, or two populations.

The drivers of both become one study with a factor `driver` between participants; `comparing` compares its two levels.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np

from das.domain.errors import MISSING, DasError, InputError
from das.domain.files.reading import read_json
from sim.experiment.analysis.comparing import (
    FinishedTrials,
    FoundDifference,
    PairedTrials,
    RunStudy,
    StudyFindings,
    TwoGroups,
    analyse_study,
    compared_trials,
    corrected,
    difference_of,
    read_study,
)
from sim.experiment.design import DESIGN_JSON, Factor, PlannedComparison
from sim.experiment.factors import FactorLevel

DRIVER: Final = "driver"
"""The factor that distinguishes the two studies."""
EQUAL: Final = ("experiment.seed", "procedure", "fixed", "factors", "analysis", "comparisons", "files")
"""Beginnings of the keys that must be equal in both frozen designs."""
MAY_DIFFER: Final = ("fixed.driver", "files.population", "files.desk")
"""Beginnings of keys that may differ nevertheless."""


@dataclass(frozen=True, kw_only=True)
class Together:
    """The findings on two studies together, and the differences between their drivers, by the titles of tables.

    `without` lists the measures without values in one of the studies.
    """

    findings: StudyFindings
    levels: tuple[str, ...]
    tables: Mapping[str, tuple[FoundDifference, ...]]
    without: tuple[str, ...]


def read_both(first: Path, second: Path) -> RunStudy:
    """Read two studies of one design; InputError for the first different key except participants, driver, desk."""
    if first.resolve() == second.resolve():
        raise DasError(f"--with {second}: is {first} itself, expected another study of the same design")
    studies = read_study(first), read_study(second)
    ours, theirs = (dict(_flat(read_json(folder / DESIGN_JSON).data)) for folder in (first, second))
    for key in dict.fromkeys([*ours, *theirs]):
        of_one = key.startswith("files.") and not (key in ours and key in theirs)  # a setting differs as well then
        if not key.startswith(EQUAL) or key.startswith(MAY_DIFFER) or of_one:
            continue
        if ours.get(key, MISSING) != theirs.get(key, MISSING):
            expected = repr(ours[key]) if key in ours else "no such key"
            raise InputError(second / DESIGN_JSON, key, theirs.get(key, MISSING), f"{expected}, as in {first}")
    return joined(*studies)


def _flat(data: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """The values of a design by their full keys."""
    for key, value in data.items():
        tables = isinstance(value, list) and any(isinstance(one, dict) for one in value)
        inner = {str(i): one for i, one in enumerate(value)} if tables else value
        yield from _flat(inner, f"{prefix}{key}.") if isinstance(inner, dict) else [(f"{prefix}{key}", inner)]


def joined(one: RunStudy, other: RunStudy) -> RunStudy:
    """Two studies of one design as one, with the factor `driver`; InputError if the design already has that factor."""
    design = one.design
    if DRIVER in (factor.name for factor in design.factors):
        raise InputError(one.folder / DESIGN_JSON, "factors", DRIVER, "a design without the factor driver")
    levels = _levels(one, other)
    group = np.repeat(np.array(levels, dtype=np.str_), [len(one.trials), len(other.trials)])

    both = (one.trials, other.trials)
    trials = FinishedTrials(
        participant=np.char.add(np.char.add(group, " "), np.concatenate([some.participant for some in both])),
        position=np.concatenate([some.position for some in both]),
        practice=np.concatenate([some.practice for some in both]),
        day=np.concatenate([some.day for some in both]),
        levels={DRIVER: group, **{of: np.concatenate([some.levels[of] for some in both]) for of in one.trials.levels}},
        values={of: np.concatenate([some.values[of] for some in both]) for of in design.measures},
    )
    among = tuple(FactorLevel(text=level, value=None) for level in levels)
    planned = [
        replace(plan, name=f"{plan.name} ({level})", where={**plan.where, DRIVER: level})
        for plan in design.comparisons
        for level in levels
    ]
    design = replace(
        design, comparisons=tuple(planned), hash=f"{design.hash} and {other.design.hash}",
        factors=(Factor(name=DRIVER, levels=among, within=False), *design.factors),
        fixed={name: level for name, level in design.fixed.items() if name != DRIVER},
    )  # fmt: skip
    parts = {levels[0]: one, levels[1]: other}
    failed = tuple(f"{level} {line}" for level, study in parts.items() for line in study.failed)
    return RunStudy(folder=one.folder, parts=parts, trials=trials, failed=failed, design=design)


def _levels(one: RunStudy, other: RunStudy) -> tuple[str, str]:
    """The levels people and simulated if people drove one study; else the names of designs, folders or paths."""
    if one.with_people != other.with_people:
        return ("people", "simulated") if one.with_people else ("simulated", "people")
    pairs = [(study.design.name, study.folder.resolve().name, str(study.folder)) for study in (one, other)]
    return next((a, b) for a, b in zip(*pairs, strict=True) if a != b)


def analyse_both(study: RunStudy) -> Together:
    """Analyse two studies together; the same studies always give the same figures."""
    levels, others = tuple(study.parts), study.design.factors[1:]
    known = {
        name: all(np.isfinite(part.trials.values[name][part.driven]).any() for part in study.parts.values())
        for name in study.design.measures
    }
    usable = [name for name, both in known.items() if both]
    where = [
        {factor.name: text for factor, text in zip(others, some, strict=True)}
        for some in product(*(factor.texts for factor in others))
    ]
    return Together(
        findings=analyse_study(study),
        levels=levels,
        tables={
            "All trials": _compared(study, usable, [{}]),
            "By condition": _compared(study, usable, where if len(where) > 1 else []),
            "Effects of the planned comparisons on the drivers": _effects(study),
        },
        without=tuple(name for name, both in known.items() if not both),
    )


def _compared(
    study: RunStudy, measures: Sequence[str], conditions: Sequence[Mapping[str, str]]
) -> tuple[FoundDifference, ...]:
    """The difference of the drivers in each measure under each condition; p is corrected for their number."""
    a, b = study.parts
    plans = tuple(
        PlannedComparison(
            name=f"{name}: {' '.join(where.values())}", measure=name, factor=DRIVER, a=a, b=b, where=where
        )
        for name in measures
        for where in conditions
    )
    return analyse_study(replace(study, design=replace(study.design, comparisons=plans))).differences


def _effects(study: RunStudy) -> tuple[FoundDifference, ...]:
    """The drivers' own differences of each planned comparison that is paired in both studies, in two groups."""
    found: list[FoundDifference] = []
    for plan in next(iter(study.parts.values())).design.comparisons:
        with suppress(DasError):  # a comparison that cannot be made is among the findings, with the reason
            one, other = (compared_trials(part, plan) for part in study.parts.values())
            if isinstance(one, PairedTrials) and isinstance(other, PairedTrials):
                groups = TwoGroups(a=one.means, b=other.means, a_names=one.participants, b_names=other.participants)
                found.append(difference_of(study, plan, groups))
    after = corrected(np.array([one.estimate.probability for one in found]), study.design.correction)
    return tuple(replace(one, corrected=float(p)) for one, p in zip(found, after, strict=True))
