"""The five steps from the technical optimum to the saving of a fleet, computed from a study's table of trials.

A step is a difference between two cases, paired by driver and run: its mean with a 95 % interval (Student's t), the
punctuality of both sides, and the amounts of a year. Energies are in kWh a train, times in s. People as they drive
today were also driven at the ends of the inputs' ranges; these steps have a range of the amounts of a year.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import DasError
from sim.experiment.analysis.comparing import RunStudy
from sim.experiment.one_line import LEAST_VALUES, mean_interval
from sim.experiment.worth import study as cases
from sim.experiment.worth.inputs import CO2, DAYS, FOLLOWERS, PRICE, TRAINS, Input, WorthDesign
from sim.experiment.worth.study import ENERGY, EQUAL, GUIDED, IN_TIME, TODAY

Floats = NDArray[np.float64]
Pair = tuple[float, float]
"""Amounts at a low and a high end."""
SOLVED: Final = "solved"
"""Name in place of a case for the least-energy runs at the timetable's times."""
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
    measure: str = ENERGY
    shared: bool = False


CLAIMS: Final = (
    Claim("optimum", "least energy at the timetable's times, against a driver who goes all-out within the "
          "limits and waits at stops; no driver reaches it", cases.ALL_OUT, SOLVED),
    Claim("obedient", "a driver who follows the guide exactly, against the all-out driver",
          cases.ALL_OUT, cases.OBEDIENT),
    Claim("people", "people with the guide, who brake with the motors while they follow it, against the same people "
          "as they drive today; trains whose driver does not follow save nothing", TODAY, TODAY + GUIDED, shared=True),
    Claim("equal arrival", "the same drives, without the energy that a later arrival saved (or an earlier one cost)",
          TODAY, TODAY + GUIDED, EQUAL, shared=True),
    Claim("equal brakes", "the same, if people without the guide already used all of the timetable's time and braked "
          "with the motors first: what advice alone saves", IN_TIME, IN_TIME + GUIDED, EQUAL, shared=True),
)  # fmt: skip
"""The claims of the five steps, in their order."""


@dataclass(frozen=True)
class Punctuality:
    """Delay at the last stop: mean (s), and shares of trains at most 0 s and at most 60 s late."""

    late_s: float
    on_time_ratio: float
    within_minute_ratio: float

    @property
    def ratios(self) -> Pair:
        """Both shares."""
        return self.on_time_ratio, self.within_minute_ratio

    @classmethod
    def of(cls, before_s: Floats, after_s: Floats, share: float) -> Punctuality:
        """The punctuality if this share of the trains has the delays `after_s` and the others `before_s`, both (n,)."""
        sides = [[float(x.mean()), float((x <= 0).mean()), float((x <= MINUTE_S).mean())] for x in (before_s, after_s)]
        return cls(*((1.0 - share) * before + share * after for before, after in zip(*sides, strict=True)))


@dataclass(frozen=True, kw_only=True)
class WorthStep:
    """A step: energy of a train before (kWh), and the energy saved ± `interval_kwh`, half the 95 % interval.

    `year` has the amounts of a year by unit, `ranges` their ranges, and `effects` the money of a year (EUR) at the low
    and high end of each input alone; both are empty for steps that were not driven at these ends.
    """

    name: str
    words: str
    pairs: int
    before_kwh: float
    saved_kwh: float
    interval_kwh: float
    before: Punctuality
    after: Punctuality
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
    measured = by_case(study)
    return [_step(claim, worth, measured) for claim in CLAIMS]


def _step(claim: Claim, worth: WorthDesign, measured: Cases) -> WorthStep:
    saved, before = saved_kwh(claim, measured), measured[claim.before]
    known = np.isfinite(saved)
    if known.sum() < LEAST_VALUES:
        why = f"{known.sum()} drivers finished both trials so that they can be compared, expected {LEAST_VALUES}"
        raise DasError(f"{worth.source}: step {claim.name}: {why} (failed.csv lists failed trials)")
    share = worth.values[FOLLOWERS] if claim.shared else 1.0
    late_s, mean, half = before[cases.LATE][known], float(saved[known].mean()), mean_interval(saved[known])
    after_s = np.zeros(1) if claim.after == SOLVED else measured[claim.after][cases.LATE][known]
    scaled = {unit: Scaled.of(worth, claim.shared, unit) for unit in UNITS}
    # The energy that each follower saves, at the ends of all that was drawn or driven.
    driven = {DRAWN: (mean - half, mean + half), **_ends(claim, worth, measured, mean)} if claim.before == TODAY else {}
    return WorthStep(
        name=claim.name,
        words=claim.words,
        pairs=int(known.sum()),
        before_kwh=float(before[claim.measure][known].mean()),
        saved_kwh=share * mean,
        interval_kwh=share * half,
        before=Punctuality.of(late_s, late_s, share),
        after=Punctuality.of(late_s, after_s, share),
        year={unit: mean * one.factor for unit, one in scaled.items()},
        ranges={unit: one.range(mean, driven.values()) for unit, one in scaled.items() if driven},
        effects=scaled[EUR].effects(mean, driven) if driven else {},
    )


def _ends(claim: Claim, worth: WorthDesign, measured: Cases, mean: float) -> dict[str, Pair]:
    """The mean energy saved with each driven input at the low and the high end of its range."""
    found = {}
    for name, driven in cases.ends_of(worth).items():
        at = dict.fromkeys((worth.inputs[name].low, worth.inputs[name].high), mean)
        for case, value in driven.items():
            saved = saved_kwh(claim._replace(before=case, after=case + GUIDED), measured)
            at[value] = float(np.nanmean(saved)) if np.isfinite(saved).any() else mean
        found[name] = min(at.items())[1], max(at.items())[1]
    return found


@dataclass(frozen=True)
class Scaled:
    """The inputs that an amount of a year is proportional to, with their values times one constant: `factor`."""

    factor: float
    inputs: Mapping[str, Input]

    @classmethod
    def of(cls, worth: WorthDesign, shared: bool, unit: str) -> Scaled:
        """The scaling of a unit; `shared`: only followers save."""
        names = (TRAINS, DAYS, *((FOLLOWERS,) if shared else ()), *UNITS[unit])
        inputs = {name: worth.inputs[name] for name in names}
        return cls(math.prod(one.value for one in inputs.values()) * math.prod(UNITS[unit].values()), inputs)

    def range(self, kwh: float, driven: Iterable[Pair]) -> Pair:
        """The range of the amount that belongs to `kwh`.

        Energies at both ends of the driven inputs are combined as the root of the sum of squares of the changes, and
        factors as that of their logarithms, so that no factor becomes negative.
        """
        pairs = list(driven)
        low = kwh - math.hypot(*(min(0.0, a - kwh, b - kwh) for a, b in pairs))
        high = kwh + math.hypot(*(max(0.0, a - kwh, b - kwh) for a, b in pairs))
        less = math.exp(-math.hypot(*(math.log(one.low / one.value) for one in self.inputs.values())))
        more = math.exp(math.hypot(*(math.log(one.high / one.value) for one in self.inputs.values())))
        return self.factor * low * (less if low > 0 else more), self.factor * high * (more if high > 0 else less)

    def effects(self, kwh: float, driven: Mapping[str, Pair]) -> dict[str, Pair]:
        """The amount at the low and the high end of each input alone."""
        found = {name: (self.factor * low, self.factor * high) for name, (low, high) in driven.items()}
        amount = self.factor * kwh
        return found | {
            n: (amount * one.low / one.value, amount * one.high / one.value) for n, one in self.inputs.items()
        }


def remarks(steps: list[WorthStep], drivers: int) -> Iterator[str]:
    """Sentences that qualify the steps: a timetable that cannot be kept, what needs no advice, no saving shown."""
    if (late_s := steps[0].before.late_s) > TOLERANCE_S:
        yield (
            f"The timetable cannot be kept: even the all-out driver arrives {late_s:.0f} s late on average, so that "
            "energy can be saved only by arriving still later."
        )
    *_, today, in_time = (step.before_kwh for step in steps)
    if today > in_time:
        yield (
            "Without advice, people who use all of the time and brake with the motors first need "
            f"{in_time:.1f} kWh for {today:.1f} today. Step 5 is what advice adds."
        )
    for number, step in enumerate(steps, start=1):
        if step.shows_saving and any(low <= 0.0 for low, _ in step.ranges.values()):
            yield f"Step {number} ({step.name}): the range of a year reaches 0."
        if not step.shows_saving:
            yield f"Step {number} ({step.name}): no saving shown, because the 95 % interval reaches 0 or less."
        if (lost := drivers - step.pairs) > 0:
            yield f"Step {number}: {lost} of {drivers} drivers left out: trials failed or cannot be compared."
