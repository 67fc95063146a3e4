"""The five steps from the technical optimum to the saving of a fleet, computed from a study's table of trials.

A step is a difference between two cases, paired by driver and run: its mean with a 95 % interval (Student's t), the
punctuality of both sides, and the amounts of a year. Energies are in kWh a train, times in s. People as they drive
today were also driven at the ends of the inputs' ranges; these steps have a range of the amounts of a year.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import DasError
from sim.experiment.analysis.comparing import RunStudy
from sim.experiment.one_line import LEAST_VALUES, mean_interval
from sim.experiment.worth import study as cases
from sim.experiment.worth.study import CO2, DAYS, FOLLOWERS, PRICE, TRAINS, Input, WorthDesign

Floats = NDArray[np.float64]
Pair = tuple[float, float]
"""Amounts at a low and a high end."""
SOLVED: Final = "solved"
"""Case of the least-energy runs at the timetable's times, which nobody drives."""
SHOWN: Final = 3
"""Index of the step at equal arrival, whose dependence on the inputs is drawn."""
MINUTE_S, TOLERANCE_S = 60.0, 0.5
"""A minute, and the largest mean delay of the all-out driver with which a timetable counts as kept (s)."""
DRAWN: Final = "drivers"
"""Name among the inputs for the 95 % interval of the drawn drivers."""
EUR: Final = "eur"
UNITS: Final[Mapping[str, Mapping[str, float]]] = {"kwh": {}, EUR: {PRICE: 1.0}, "co2_t": {CO2: 1e-6}}
"""The units of a year's amounts, each with the input that converts kWh, and a factor."""


class Claim(NamedTuple):
    """A claim: its name and meaning, the two cases, the measure compared, and whether only followers save."""

    name: str
    words: str
    before: str
    after: str
    measure: str = cases.ENERGY
    shared: bool = False


CLAIMS: Final = (
    Claim("optimum", "least energy at the timetable's times, against a driver who goes all-out within the "
          "limits and waits at stops; no driver reaches it", cases.ALL_OUT, SOLVED),
    Claim("obedient", "a driver who follows the guide exactly, against the all-out driver",
          cases.ALL_OUT, cases.OBEDIENT),
    Claim("people", "people with the guide, who brake with the motors while they follow it, against the same people "
          "as they drive today; trains whose driver does not follow save nothing", cases.TODAY,
          cases.TODAY + cases.GUIDED, shared=True),
    Claim("equal arrival", "the same trains, if those with the guide arrived when the others do", cases.TODAY,
          cases.TODAY + cases.GUIDED, cases.EQUAL, shared=True),
    Claim("equal brakes", "the same, if people without the guide already used all of the timetable's time and braked "
          "with the motors first: what advice alone saves", cases.IN_TIME, cases.IN_TIME + cases.GUIDED, cases.EQUAL,
          shared=True),
)  # fmt: skip
"""The claims of the five steps, in their order."""


@dataclass(frozen=True, kw_only=True)
class WorthStep:
    """A step: energy of a train before (kWh), and the energy saved ± `interval_kwh`, half the 95 % interval.

    `before` and `after` state the delay at the last stop: mean (s), and shares of trains at most 0 s and 60 s late.
    `year` has the amounts of a year by unit, `ranges` their ranges, and `effects` the money of a year (EUR) at the low
    and high end of each input alone; both are empty for steps that were not driven at these ends.
    """

    name: str
    words: str
    pairs: int
    before_kwh: float
    saved_kwh: float
    interval_kwh: float
    before: Mapping[str, float]
    after: Mapping[str, float]
    year: Mapping[str, float]
    ranges: Mapping[str, Pair]
    effects: Mapping[str, Pair]

    @property
    def saved_ratio(self) -> float:
        """The share of the energy before that is saved."""
        return self.saved_kwh / self.before_kwh

    @property
    def shows_saving(self) -> bool:
        """Whether the 95 % interval lies above 0."""
        return self.saved_kwh > self.interval_kwh


Cases = Mapping[str, Mapping[str, Floats]]
"""The measures of each case: arrays (n,) with a value for each driver, NaN if there is none."""


def by_case(study: RunStudy) -> Cases:
    """The measures of a study's trials by case, and those of `SOLVED`; energies of drives that cannot be compared with
    their optimum are NaN at equal arrival."""
    trials = study.trials
    names, who = np.unique(trials.participant, return_inverse=True)
    found = {}
    for case in study.design.factor(cases.CASE).texts:
        mine = trials.levels[cases.CASE] == case
        found[case] = {name: np.full(len(names), np.nan) for name in trials.values}
        for name, values in trials.values.items():
            found[case][name][who[mine]] = values[mine]
        found[case][cases.EQUAL][np.isnan(found[case][cases.COMPARABLE])] = np.nan
    driven = found[cases.ALL_OUT]
    optimum = driven[cases.EQUAL] - driven[cases.ENERGY] + driven[cases.OPTIMUM]
    return found | {SOLVED: {cases.ENERGY: optimum, cases.LATE: np.zeros(len(names))}}


def steps_of(worth: WorthDesign, study: RunStudy) -> list[WorthStep]:
    """The five steps; raises DasError if fewer than three drivers finished the trials of one."""
    measured = by_case(study)
    return [_step(claim, worth, measured) for claim in CLAIMS]


def _step(claim: Claim, worth: WorthDesign, measured: Cases) -> WorthStep:
    before, after = measured[claim.before], measured[claim.after]
    saved = before[claim.measure] - after[claim.measure]
    known = np.isfinite(saved)
    if known.sum() < LEAST_VALUES:
        why = f"{known.sum()} drivers finished both trials so that they can be compared, expected {LEAST_VALUES}"
        raise DasError(f"{worth.study.source}: step {claim.name}: {why} (failed.csv lists failed trials)")
    share = worth.values[FOLLOWERS] if claim.shared else 1.0
    late_s, mean, half = before[cases.LATE][known], float(saved[known].mean()), mean_interval(saved[known])
    driven = _ends(claim, worth, measured, (mean, half)) if claim.before == cases.TODAY else {}
    year: dict[str, float] = {}
    ranges: dict[str, Pair] = {}
    effects: dict[str, Pair] = {}
    for unit, conversion in UNITS.items():
        names = (TRAINS, DAYS, *((FOLLOWERS,) if claim.shared else ()), *conversion)
        scaling = {name: worth.inputs[name] for name in names}
        factor = math.prod(one.value for one in scaling.values()) * math.prod(conversion.values())
        amount = year[unit] = mean * factor
        if driven:
            ranges[unit] = _range(factor, mean, driven.values(), scaling.values())
        if driven and unit == EUR:
            effects = {name: (factor * low, factor * high) for name, (low, high) in driven.items()}
            effects |= {n: (amount * one.low / one.value, amount * one.high / one.value) for n, one in scaling.items()}
    return WorthStep(
        name=claim.name,
        words=claim.words,
        pairs=int(known.sum()),
        before_kwh=float(before[claim.measure][known].mean()),
        saved_kwh=share * mean,
        interval_kwh=share * half,
        before=_punctuality(late_s, late_s, share),
        after=_punctuality(late_s, after[cases.LATE][known], share),
        year=year,
        ranges=ranges,
        effects=effects,
    )


def _punctuality(before_s: Floats, after_s: Floats, share: float) -> dict[str, float]:
    """The punctuality if this share of the trains has the delays `after_s` and the others `before_s`, both (n,)."""
    sides = [[float(x.mean()), float((x <= 0).mean()), float((x <= MINUTE_S).mean())] for x in (before_s, after_s)]
    mixed = ((1.0 - share) * before + share * after for before, after in zip(*sides, strict=True))
    return dict(zip(("late_s", "on_time_ratio", "within_minute_ratio"), mixed, strict=True))


def _ends(claim: Claim, worth: WorthDesign, measured: Cases, drawn: Pair) -> dict[str, Pair]:
    """The mean energy that a follower saves at the ends of all that was drawn (mean ± half interval) or driven."""
    mean, half = drawn
    found = {DRAWN: (mean - half, mean + half)}
    for name, driven in cases.ends_of(worth.inputs).items():
        at = dict.fromkeys((worth.inputs[name].low, worth.inputs[name].high), mean)
        for case, value in driven.items():
            saved = measured[case][claim.measure] - measured[case + cases.GUIDED][claim.measure]
            at[value] = float(np.nanmean(saved)) if np.isfinite(saved).any() else mean
        found[name] = min(at.items())[1], max(at.items())[1]
    return found


def _range(factor: float, kwh: float, driven: Iterable[Pair], scaling: Iterable[Input]) -> Pair:
    """The range of `factor` × `kwh`.

    Energies at both ends of the driven inputs are combined as the root of the sum of squares of the changes, and
    scaling inputs as that of their logarithms, so that no factor becomes negative.
    """
    changes, inputs = [(a - kwh, b - kwh) for a, b in driven], list(scaling)
    low = kwh - math.hypot(*(min(0.0, *pair) for pair in changes))
    high = kwh + math.hypot(*(max(0.0, *pair) for pair in changes))
    less = math.exp(-math.hypot(*(math.log(one.low / one.value) for one in inputs)))
    more = math.exp(math.hypot(*(math.log(one.high / one.value) for one in inputs)))
    return factor * low * (less if low > 0 else more), factor * high * (more if high > 0 else less)
