"""Paired differences: the same participant on the same day under two conditions, one less the other."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from das.domain.errors import DasError
from sim.experiment.analysis.reading import Bools, Floats, Ints, RunStudy, Texts
from sim.experiment.plan import PlannedComparison


class _Cell(NamedTuple):
    """What two trials must have in common to be a pair: the participant, the day, and the levels of other factors."""

    participant: str
    day: str
    others: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class PairedTrials:
    """The pairs of a comparison between conditions that every participant drove.

    Each array has an entry for each pair: `owner` is the index of its participant in `participants`, `others` names the
    levels of the other factors, `cell` names these and its day, `a` and `b` are the values (means where a trial was
    made twice), `a_first` says whether the trial at level a came before. `unpaired` counts trials without a partner,
    which are left out.
    `same_day` is False where no two trials had one day in common, and pairs were made by participant alone.
    """

    participants: tuple[str, ...]
    owner: Ints
    others: Texts
    cell: Texts
    a: Floats
    b: Floats
    a_first: Bools
    unpaired: int
    same_day: bool

    @property
    def differences(self) -> Floats:
        """Value at a less value at b of each pair, (pairs,)."""
        return self.a - self.b

    def by_participant(self, values: Floats) -> Floats:
        """Mean over the pairs of each participant, (participants,)."""
        return np.asarray(np.bincount(self.owner, weights=values) / np.bincount(self.owner))


@dataclass(frozen=True, kw_only=True)
class TwoGroups:
    """The means of the participants of two groups, for a factor of which each participant has one level."""

    a: Floats
    b: Floats
    a_names: tuple[str, ...]
    b_names: tuple[str, ...]


def is_paired(study: RunStudy, comparison: PlannedComparison) -> bool:
    """Whether every participant is to drive both conditions of a comparison."""
    return study.plan.factor(comparison.factor).within


def paired_trials(study: RunStudy, comparison: PlannedComparison) -> PairedTrials:
    """The pairs of a comparison; DasError where no participant drove both of its conditions."""
    same_day = _paired(study, comparison, with_day=True)
    found = same_day if len(same_day.owner) else _paired(study, comparison, with_day=False)
    if not len(found.owner):
        raise DasError(
            f"{study.folder}: comparison {comparison.name}: no participant has finished trials with both "
            f"{comparison.factor} = {comparison.a} and {comparison.b}"
        )
    return found


def _paired(study: RunStudy, comparison: PlannedComparison, *, with_day: bool) -> PairedTrials:
    trials, rows = study.trials, np.flatnonzero(study.chosen(comparison))
    level, values = trials.levels[comparison.factor], trials.values[comparison.measure]
    others = [trials.levels[one.name] for one in study.plan.factors if one.name != comparison.factor]
    cells: dict[_Cell, dict[str, list[int]]] = defaultdict(lambda: {comparison.a: [], comparison.b: []})
    for row in rows:
        cell = _Cell(
            str(trials.participant[row]),
            str(trials.day[row]) if with_day else "",
            tuple(str(one[row]) for one in others),
        )
        cells[cell][str(level[row])].append(int(row))
    whole = {cell: (one[comparison.a], one[comparison.b]) for cell, one in sorted(cells.items()) if all(one.values())}
    names = tuple(sorted({cell.participant for cell in whole}))
    number = {name: index for index, name in enumerate(names)}
    return PairedTrials(
        participants=names,
        owner=np.array([number[cell.participant] for cell in whole], dtype=np.int64),
        others=np.array([" ".join(cell.others) for cell in whole], dtype=np.str_),
        cell=np.array([" ".join((*cell.others, cell.day)) for cell in whole], dtype=np.str_),
        a=np.array([values[a].mean() for a, _ in whole.values()]),
        b=np.array([values[b].mean() for _, b in whole.values()]),
        a_first=np.array(
            [trials.position[a].mean() < trials.position[b].mean() for a, b in whole.values()], dtype=bool
        ),
        unpaired=len(rows) - sum(len(a) + len(b) for a, b in whole.values()),
        same_day=with_day,
    )


def two_groups(study: RunStudy, comparison: PlannedComparison) -> TwoGroups:
    """The participants of each of two groups, by the mean of their trials; DasError where a group is empty."""
    trials, kept = study.trials, study.chosen(comparison)
    found = {}
    for level in (comparison.a, comparison.b):
        mine = kept & (trials.levels[comparison.factor] == level)
        names = np.unique(trials.participant[mine])
        if not len(names):
            raise DasError(
                f"{study.folder}: comparison {comparison.name}: no finished trial with {comparison.factor} = {level}"
            )
        values = trials.values[comparison.measure]
        found[level] = (names, np.array([values[mine & (trials.participant == name)].mean() for name in names]))
    (a_names, a), (b_names, b) = found[comparison.a], found[comparison.b]
    return TwoGroups(a=a, b=b, a_names=tuple(map(str, a_names)), b_names=tuple(map(str, b_names)))
