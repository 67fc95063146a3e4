"""The five steps from the technical optimum to the saving of a fleet, computed from a study's table of trials.

A step is a difference between two cases, paired by driver and run: its mean with a 95 % interval (Student's t), the
punctuality of both sides, and the amounts of a year. Energies are in kWh a train, times in s.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import DasError
from sim.experiment.analysis.comparing import RunStudy
from sim.experiment.one_line import LEAST_VALUES, mean_interval
from sim.experiment.worth import study as cases
from sim.experiment.worth.inputs import CO2, DAYS, FOLLOWERS, PRICE, TRAINS, WorthDesign
from sim.experiment.worth.study import ENERGY, EQUAL, GUIDED, IN_TIME, TODAY

Floats = NDArray[np.float64]
SOLVED: Final = "solved"
"""Name in place of a case for the least-energy runs at the timetable's times."""
SHOWN: Final = 3
"""Index of the step at equal arrival, for which the ends of the driven inputs were driven too."""
MINUTE_S, TOLERANCE_S = 60.0, 0.5
"""A minute, and the largest mean delay of the all-out driver with which a timetable counts as kept (s)."""
DRAWN: Final = "drivers"
"""Name among the inputs for the 95 % interval of the drawn drivers."""
UNITS: Final[Mapping[str, Mapping[str, float]]] = {"kwh": {}, "eur": {PRICE: 1.0}, "co2_t": {CO2: 1e-6}}
"""The units of a year's amounts, each with the input that converts kWh, and a factor."""


class Claim(NamedTuple):
    """A claim: its name and meaning, the two cases, the measure compared, and whether only followers save."""

    name: str
    words: str
    before: str
    after: str
    measure: str = ENERGY
    shared: bool = False


CLAIMS: Final = (
    Claim("technical optimum", "least energy at the timetable's times, against a driver who goes all-out within the "
          "limits and waits at stops; no driver reaches it", cases.ALL_OUT, SOLVED),
    Claim("obedient driver", "a driver who follows the guide exactly, against the all-out driver",
          cases.ALL_OUT, cases.OBEDIENT),
    Claim("people", "people with the guide, who brake with the motors while they follow it, against the same people "
          "as they drive today; trains whose driver does not follow save nothing", TODAY, TODAY + GUIDED, shared=True),
    Claim("equal arrival", "the same trains, without the energy saved only by arriving later (or lost by arriving "
          "earlier)", TODAY, TODAY + GUIDED, EQUAL, shared=True),
    Claim("equal brakes, in time", "the same comparison if people already use all of the timetable's time and brake "
          "with the motors first: what only advice can save", IN_TIME, IN_TIME + GUIDED, EQUAL, shared=True),
)  # fmt: skip
"""The claims of the five steps, in their order."""


@dataclass(frozen=True)
class Range:
    """An amount with its range."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Punctuality:
    """Delay at the last stop: mean (s), and shares of trains at most 0 s and at most 60 s late."""

    late_s: float
    on_time_ratio: float
    within_minute_ratio: float

    @classmethod
    def of(cls, before_s: Floats, after_s: Floats, share: float) -> Punctuality:
        """The punctuality if this share of the trains has the delays `after_s` and the others `before_s`, both (n,)."""
        sides = [[float(x.mean()), float((x <= 0).mean()), float((x <= MINUTE_S).mean())] for x in (before_s, after_s)]
        return cls(*((1.0 - share) * before + share * after for before, after in zip(*sides, strict=True)))


@dataclass(frozen=True, kw_only=True)
class WorthStep:
    """A step: energy saved a train (kWh; `saved_ratio`: of the optimum) ± `interval_kwh`, half the 95 % interval.

    `year` has the amounts of a year by unit, and `effects` those at the low and high end of each input's range. The
    ranges of `year` are combined from the effects: root of the sum of squares of the changes, for each side.
    """

    name: str
    words: str
    pairs: int
    saved_kwh: float
    interval_kwh: float
    saved_ratio: float
    before: Punctuality
    after: Punctuality
    year: Mapping[str, Range]
    effects: Mapping[str, Mapping[str, tuple[float, float]]]

    @property
    def shows_saving(self) -> bool:
        """Whether the 95 % interval lies above 0."""
        return self.saved_kwh > self.interval_kwh


Cases = Mapping[str, Mapping[str, Floats]]
"""The measures of each case: arrays (n,) with a value for each driver, NaN if there is none."""


def by_case(study: RunStudy) -> Cases:
    """The measures of a study's trials by case; energies of drives that cannot be compared with their optimum are NaN
    at equal arrival."""
    trials = study.trials
    names, who = np.unique(trials.participant, return_inverse=True)
    found = {}
    for case in study.design.factor(cases.CASE).texts:
        mine = trials.levels[cases.CASE] == case
        found[case] = {name: np.full(len(names), np.nan) for name in trials.values}
        for name, values in trials.values.items():
            found[case][name][who[mine]] = values[mine]
        found[case][EQUAL][np.isnan(found[case][cases.COMPARABLE])] = np.nan
    return found


def saved_kwh(claim: Claim, measured: Cases) -> Floats:
    """The energy (kWh) that each driver saves by a claim (n,); NaN if a trial is missing or cannot be compared."""
    before = measured[claim.before]
    return before[claim.measure] - (_optimum(before) if claim.after == SOLVED else measured[claim.after][claim.measure])


def _optimum(measures: Mapping[str, Floats]) -> Floats:
    """The least energy (kWh) of the true train at the timetable's times."""
    return measures[EQUAL] - measures[ENERGY] + measures[cases.OPTIMUM]


def steps_of(worth: WorthDesign, study: RunStudy) -> list[WorthStep]:
    """The five steps; raises DasError if fewer than three drivers finished the trials of one."""
    measured, ends = by_case(study), {}
    for name, some in cases.ends_of(worth).items():
        pairs = (
            (at, saved_kwh(CLAIMS[SHOWN]._replace(before=one, after=one + GUIDED), measured))
            for one, at in some.items()
        )
        ends[name] = {at: float(np.nanmean(saved)) for at, saved in pairs if np.isfinite(saved).any()}
    return [_step(claim, worth, measured, ends if number == SHOWN else {}) for number, claim in enumerate(CLAIMS)]


def _step(claim: Claim, worth: WorthDesign, measured: Cases, ends: Mapping[str, Mapping[float, float]]) -> WorthStep:
    saved, before = saved_kwh(claim, measured), measured[claim.before]
    known = np.isfinite(saved)
    if known.sum() < LEAST_VALUES:
        why = f"{known.sum()} drivers finished both trials so that they can be compared, expected {LEAST_VALUES}"
        raise DasError(f"{worth.source}: step {claim.name}: {why} (failed.csv lists failed trials)")
    share = worth.values[FOLLOWERS] if claim.shared else 1.0
    late_s, mean, half = before[cases.LATE][known], float(saved[known].mean()), mean_interval(saved[known])
    after_s = np.zeros(1) if claim.after == SOLVED else measured[claim.after][cases.LATE][known]
    effects = {unit: _effects(unit, claim, worth, (mean, half), ends) for unit in UNITS}
    return WorthStep(
        name=claim.name,
        words=claim.words,
        pairs=int(known.sum()),
        saved_kwh=share * mean,
        interval_kwh=share * half,
        saved_ratio=share * mean / float(np.nanmean(_optimum(before))),
        before=Punctuality.of(late_s, late_s, share),
        after=Punctuality.of(late_s, after_s, share),
        year={unit: _combined(_amount(mean, unit, claim, worth.values), effects[unit]) for unit in UNITS},
        effects=effects,
    )


def _amount(kwh: float, unit: str, claim: Claim, values: Mapping[str, float]) -> float:
    """The amount of a year in a unit, if each train (of a shared claim: each follower) saves these kWh."""
    factors = [values[name] * factor for name, factor in UNITS[unit].items()]
    return kwh * math.prod([values[TRAINS], values[DAYS], values[FOLLOWERS] if claim.shared else 1.0, *factors])


def _effects(
    unit: str, claim: Claim, worth: WorthDesign, drawn: tuple[float, float], ends: Mapping[str, Mapping[float, float]]
) -> dict[str, tuple[float, float]]:
    """The amounts of a year at the low and high end of each input, and of the interval of the drawn drivers."""
    (mean, half), values = drawn, worth.values

    def at(kwh: float, **changed: float) -> float:
        return _amount(kwh, unit, claim, values | changed)

    found = {DRAWN: (at(mean - half), at(mean + half))}
    for name in (TRAINS, DAYS, *UNITS[unit], *([FOLLOWERS] if claim.shared else [])):
        one = worth.inputs[name]
        found[name] = (at(mean, **{name: one.low}), at(mean, **{name: one.high}))
    for name, kwh in ends.items():
        one = worth.inputs[name]
        found[name] = (at(kwh.get(one.low, mean)), at(kwh.get(one.high, mean)))
    return found


def _combined(value: float, effects: Mapping[str, tuple[float, float]]) -> Range:
    down = math.hypot(*(min(0.0, low - value, high - value) for low, high in effects.values()))
    up = math.hypot(*(max(0.0, low - value, high - value) for low, high in effects.values()))
    return Range(value, value - down, value + up)


def remarks(steps: list[WorthStep], drivers: int) -> Iterator[str]:
    """Sentences that qualify the steps: a timetable that cannot be kept, no saving shown, drivers left out."""
    if (late_s := steps[0].before.late_s) > TOLERANCE_S:
        yield (
            f"The timetable cannot be kept: even the all-out driver arrives {late_s:.0f} s late on average, so that "
            "energy can be saved only by arriving still later."
        )
    for number, step in enumerate(steps, start=1):
        if not step.shows_saving:
            yield f"Step {number} ({step.name}): no saving shown, because the 95 % interval reaches 0 or less."
        if step.pairs < drivers:
            yield f"Step {number}: {drivers - step.pairs} drivers left out, whose trials failed or cannot be compared."
