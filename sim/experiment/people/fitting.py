"""A population of drivers fitted to recorded people, by indirect inference.

Each parameter has a statistic that a recording gives. Simulated drivers, whose parameters are spread over ranges, drive
the same trials, and lines through their statistics tell how each depends on all parameters. The estimate is where the
lines give the mean statistics of the people. C. Gourieroux, A. Monfort, E. Renault, Journal of
Applied Econometrics 8 (1993) S85–S118. A parameter that cannot be told from the recordings keeps its default.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from das.cab.cab import warm_up
from das.command_line.printing import progress_bar
from das.domain.errors import DasError
from das.domain.files.reading import read_text
from das.domain.files.writing import toml_string
from precompute.workers import Workers
from sim.drive.table import DriveTable
from sim.drivers.kinds import DriverKind
from sim.drivers.parameters import DEFAULT, KEYS, HumanParameters, Shape, Spread, load_population
from sim.experiment.design import DESIGN_TEXT, MOST_TRIALS_EACH, check_frozen, read_design
from sim.experiment.driving import StudyTrial, drive
from sim.experiment.people.observing import Samples, notches_of, observed, statistics
from sim.experiment.study_files import TRIALS_TABLE, participant_number, pseudonym, recording_file
from sim.experiment.trials import trials_of
from sim.options import LEAST_DRIVERS
from sim.recording.course import Floats
from sim.recording.opening import open_recording


class Tried(NamedTuple):
    """A parameter, the range over which simulated drivers are spread, and the statistic that follows it."""

    name: str
    low: float
    high: float
    statistic: str

    @property
    def is_share(self) -> bool:
        """Whether the parameter is a share; others are spread evenly in their logarithm."""
        return self.name.startswith("comply_")

    def value(self, place: float) -> float:
        """The value at a place in the range, from 0 (low) to 1 (high); beyond it, within the parameter's limits."""
        about = HumanParameters.__dataclass_fields__[self.name].metadata
        low, high = self.low, self.high
        found = low + place * (high - low) if self.is_share else low * (high / low) ** place
        return float(min(max(found, about["low"]), about["high"]))

    @property
    def usual(self) -> float:
        """The place of the default."""
        low, high, value = self.low, self.high, getattr(HumanParameters(), self.name)
        return (value - low) / (high - low) if self.is_share else math.log(value / low) / math.log(high / low)


TRIED: Final = (
    Tried("reaction_median_s", 0.8, 5.0, "departure"),
    Tried("reaction_log_sd", 0.15, 0.9, "departure spread"),
    Tried("glance_mean_s", 1.5, 15.0, "answer"),
    Tried("comply_traction_ratio", 0.2, 1.0, "traction"),
    Tried("comply_hold_ratio", 0.2, 1.0, "hold"),
    Tried("comply_coast_ratio", 0.2, 1.0, "coast"),
    Tried("comply_brake_ratio", 0.2, 1.0, "brake"),
    Tried("speed_error_mps", 0.1, 1.2, "held error"),
    Tried("dead_band_mps", 0.2, 1.5, "held moves"),
    Tried("below_limit_mps", 0.1, 2.0, "below limit"),
    Tried("braking_mps2", 0.25, 0.9, "deceleration"),
    Tried("early_braking_s", 0.5, 6.0, "braking begins"),
    Tried("stop_error_m", 0.5, 5.0, "stop"),
)
"""The parameters that a fit tries, each with its statistic. The ranges are assumptions."""
LEAST_PEOPLE: Final = 6
"""Fewest people with a statistic: from fewer, the spread between people is not known well enough for an interval."""
CLEAR_T: Final = 4.0
DEPENDS_T: Final = 3.0
"""Student's t from which a statistic follows its own parameter, and from which it depends on another one."""
WIDEST: Final = 0.25
"""Largest half-width of an interval, as a share of the range tried, with which a parameter counts as told."""
BEYOND: Final = 0.1
"""Share of the range by which an estimate may lie outside it."""
NORMAL_95: Final = 1.96


@dataclass(frozen=True, kw_only=True)
class ParameterFigures:
    """The estimate of a parameter (of a share: its mean), its 95 % interval, and the spread `sd` between drivers.

    The spread is the standard deviation of the logarithm, of a share that of the logit.
    """

    value: float
    low: float
    high: float
    sd: float


@dataclass(frozen=True, kw_only=True)
class FittedParameter:
    """A parameter of the fitted population; one that is not fitted has no figures, but the reason in `why`."""

    name: str
    figures: ParameterFigures | None = None
    why: str = ""


class StatisticLine(NamedTuple):
    """The dependence of a statistic on the places of all parameters: coefficients, the constant first.

    `noise` is the standard deviation of one driver about it; `certainty` is the covariance of the coefficients, in
    squares of the noise.
    """

    coefficients: Floats
    certainty: Floats
    noise: float

    def t(self, i: int) -> float:
        """Student's t of a coefficient, without sign."""
        return float(abs(self.coefficients[i]) / max(self.noise * math.sqrt(self.certainty[i, i]), 1e-12))


def line_of(own: int, values: Floats, places: Floats) -> StatisticLine | str:
    """The line through a statistic of drivers at places (drivers, parameters); the reason if there is none.

    Besides its own parameter it has those on which the statistic clearly depends, the clearest first.
    """
    known = np.isfinite(values)
    if known.sum() < LEAST_DRIVERS:
        return "the trials have too few such moments"
    rows, y, used = np.column_stack([np.ones(known.sum()), places[known]]), values[known], [0, own + 1]
    line = _through(rows, y, used)
    while others := [i for i in range(1, rows.shape[1]) if i not in used]:
        clearest = max(others, key=lambda i: _through(rows, y, [*used, i]).t(i))
        longer = _through(rows, y, [*used, clearest])
        if longer.t(clearest) < DEPENDS_T:
            break
        used, line = [*used, clearest], longer
    return line if line.t(own + 1) >= CLEAR_T else "no statistic of these trials follows it"


def _through(rows: Floats, y: Floats, used: list[int]) -> StatisticLine:
    """The line of least squares in some columns of `rows`."""
    x, width = rows[:, used], rows.shape[1]
    found, certainty = np.zeros(width), np.zeros((width, width))
    certainty[np.ix_(used, used)] = np.linalg.inv(x.T @ x)
    found[used] = certainty[np.ix_(used, used)] @ x.T @ y
    return StatisticLine(found, certainty, math.sqrt(float(np.sum((y - rows @ found) ** 2)) / (len(y) - len(used))))


def fitted(
    people: Sequence[Mapping[str, float]], drivers: Sequence[Mapping[str, float]], places: Floats
) -> tuple[FittedParameter, ...]:
    """The estimates from the statistics of people, and of simulated drivers at places (drivers, parameters)."""
    told: dict[int, tuple[StatisticLine, Floats]] = {}
    why: dict[int, str] = {}
    for own, tried in enumerate(TRIED):
        mine = np.array([one[tried.statistic] for one in people if tried.statistic in one])
        line = line_of(own, np.array([one.get(tried.statistic, math.nan) for one in drivers]), places)
        if isinstance(line, str):
            why[own] = line
        elif len(mine) < LEAST_PEOPLE:
            why[own] = "too few people have such moments"
        else:
            told[own] = (line, mine)
    found: dict[int, ParameterFigures] = {}
    while told:
        at, halves, spreads = _solved(told)
        outside = (at < -BEYOND) | (at > 1.0 + BEYOND)
        doubts = np.where(outside, np.inf, halves)
        worst = int(doubts.argmax())
        if doubts[worst] <= WIDEST:
            rows = zip(told, at, halves, spreads, strict=True)
            found = {own: _figures(TRIED[own], *map(float, row)) for own, *row in rows}
            break
        own = list(told)[worst]
        del told[own]
        low, high = TRIED[own].low, TRIED[own].high
        why[own] = f"outside the range tried, {low:g} to {high:g}" if outside[worst] else "the interval is too wide"
    return tuple(
        FittedParameter(name=one.name, figures=found.get(own), why=why.get(own, "")) for own, one in enumerate(TRIED)
    )


def _solved(told: Mapping[int, tuple[StatisticLine, Floats]]) -> tuple[Floats, Floats, Floats]:
    """The places at which the lines give the mean statistics of the people, others at their defaults.

    With half the width of each interval, which allows the others to be anywhere in their ranges, and the standard
    deviation between people.
    """
    from scipy import stats

    some, lines, values = list(told), [line for line, _ in told.values()], [mine for _, mine in told.values()]
    noise, slopes = np.array([line.noise for line in lines]), np.array([line.coefficients[1:] for line in lines])
    places = np.array([one.usual for one in TRIED])
    places[some] = 0.0
    start = np.array([line.coefficients[0] for line in lines]) + slopes @ places
    inverse = np.linalg.inv(slopes[:, some])
    places[some] = inverse @ (np.array([mine.mean() for mine in values]) - start)
    count = np.array([len(mine) for mine in values])
    apart = np.array([mine.var(ddof=1) for mine in values])
    reach = stats.t.ppf(0.975, count - 1) / NORMAL_95
    row = np.concatenate([[1.0], places])
    learnt = noise**2 * np.array([row @ line.certainty @ row for line in lines])
    anywhere = (slopes[:, [i for i in range(len(TRIED)) if i not in told]] ** 2).sum(axis=1) / 12.0
    halves = NORMAL_95 * np.sqrt(inverse**2 @ (reach**2 * apart / count + learnt + anywhere))
    return places[some], halves, np.sqrt(inverse**2 @ np.maximum(apart - noise**2, 0.0))


def _figures(tried: Tried, at: float, half: float, spread: float) -> ParameterFigures:
    value, low, high = (tried.value(at + away) for away in (0.0, -half, half))
    sd = spread * math.log(tried.high / tried.low)
    if tried.is_share:
        sd = min(spread * (tried.high - tried.low) / max(value * (1.0 - value), 0.02), 2.0)
    return ParameterFigures(value=value, low=low, high=high, sd=sd)


class Person(NamedTuple):
    """A recorded participant: the trials, and the samples of each."""

    trials: Sequence[StudyTrial]
    drives: Sequence[Samples]


def recorded(folder: Path, design_file: Path | None, participants: Sequence[str]) -> list[Person]:
    """The participants of a study, or some of them, with their finished trials that are no practice.

    The design is that of the folder, or of a file for a design with files of its own. Raises DasError for another
    design, an unknown participant, and a study without recordings.
    """
    try:
        design = read_design(design_file or folder / DESIGN_TEXT)
    except DasError as error:
        hint = "; --design names the design's own file" if design_file is None else ""
        raise DasError(f"{error}{hint}") from None
    check_frozen(design, folder)
    try:
        done = {int(row["trial"]) for row in csv.DictReader(io.StringIO(read_text(folder / TRIALS_TABLE)))}
    except (KeyError, TypeError, ValueError) as error:
        raise DasError(f"{folder / TRIALS_TABLE}: expected the number of a trial in each row, column trial") from error
    driven = [one for one in trials_of(design) if one.number in done and not one.practice]
    wanted = sorted({participant_number(one) for one in participants} or {one.who for one in driven})
    found = {who: [one for one in driven if one.who == who] for who in wanted}
    lacking = [pseudonym(who) for who, trials in found.items() if not trials] or ["anybody"] * (not found)
    if lacking:
        raise DasError(f"{folder}: no finished trials of {lacking[0]}, expected at least one")
    if len(found) < LEAST_PEOPLE:
        raise DasError(f"{folder}: finished trials of {len(found)} people, expected those of at least {LEAST_PEOPLE}")
    files = {one.number: folder / recording_file(one) for trials in found.values() for one in trials}
    if missing := [file for file in files.values() if not file.is_file()]:
        raise DasError(f"{missing[0]}: no such file: only recorded people can be fitted")
    samples = {}
    with progress_bar("fit", f"{len(files)} recordings to read", "recordings") as progress:
        for number, file in files.items():
            samples[number] = observed(DriveTable.of(open_recording(file)))
            progress(len(samples), len(files))
    return [Person(trials, [samples[one.number] for one in trials]) for trials in found.values()]


def simulated(
    people: Sequence[Person], notches: int, count: int, workers: Workers
) -> tuple[list[dict[str, float]], Floats]:
    """The statistics of simulated drivers on the trials of the people, and their places (drivers, parameters)."""
    from scipy.stats import qmc

    places = qmc.LatinHypercube(len(TRIED), seed=1).random(count)
    jobs = [one for i in range(count) for one in _trials(people[i % len(people)].trials, i, places[i], notches)]
    samples: list[list[Samples]] = [[] for _ in range(count)]
    with progress_bar("fit", f"{len(jobs)} drives to simulate", "drives") as progress:
        for number, made in enumerate(workers.made(drive_observed, jobs, prepare=warm_up), start=1):
            if made.result is not None:
                samples[made.job.chance // MOST_TRIALS_EACH - 1].append(made.result)
            progress(number, len(jobs))
    return [statistics(drives) for drives in samples], places


def _trials(trials: Sequence[StudyTrial], driver: int, places: Floats, notches: int) -> Iterator[StudyTrial]:
    """The trials of a person for a simulated driver, with own random numbers and the parameters at places."""
    tried = {one.name: one.value(place) for one, place in zip(TRIED, places, strict=True)} | {"notches": float(notches)}
    for one in trials:
        human = tuple((tried | dict(one.setting.human)).items())
        setting = replace(one.setting, driver=DriverKind.HUMAN, human=human)
        chance = MOST_TRIALS_EACH * (driver + 1) + one.chance
        yield replace(one, person=None, trips=None, chance=chance, setting=setting)


def drive_observed(trial: StudyTrial) -> Samples:
    """The samples of a trial, simulated; DasError if it cannot be driven."""
    table = drive(trial, DEFAULT, keep=True).table
    assert table is not None
    return observed(table)


@dataclass(frozen=True, kw_only=True)
class FittedPopulation:
    """The parameters of a population, and the numbers of people, of their drives, and of simulated drivers.

    `notches` is that of the controller each way, 0 if it has none.
    """

    study: str
    people: int
    drives: int
    drivers: int
    notches: int
    parameters: tuple[FittedParameter, ...]


def fit(people: Sequence[Person], study: str, count: int, workers: Workers) -> FittedPopulation:
    """Fit a population to recorded people with a number of simulated drivers; DasError if workers cannot be used."""
    notches = notches_of([drive for one in people for drive in one.drives])
    drivers, places = simulated(people, notches, count, workers)
    return FittedPopulation(
        study=study, people=len(people), drives=sum(len(one.drives) for one in people), drivers=count, notches=notches,
        parameters=fitted([statistics(one.drives) for one in people], drivers, places),
    )  # fmt: skip


def population_text(found: FittedPopulation, name: str) -> str:
    """A fitted population as a file; what is not fitted has the default, with the reason in its source."""
    of = f"fitted to {found.people} people, {found.drives} drives of {found.study}"
    usual = {spread.name: spread for spread in load_population(DEFAULT).spreads}
    spreads = {} if not found.notches else {"notches": _spread("notches", (found.notches, 0.0), f"{of}: at rest")}
    for one in found.parameters:
        if one.figures is not None:
            low, high = f"{one.figures.low:.3g}", f"{one.figures.high:.3g}"
            chance = "" if one.figures.sd else "; a spread between people is not told, default"
            source = f"{of}: {one.figures.value:.3g}, 95 % interval {low} to {high}{chance}"
            spreads[one.name] = _spread(one.name, (one.figures.value, one.figures.sd), source, usual.get(one.name))
        else:
            spread = usual.get(one.name) or _spread(one.name, (getattr(HumanParameters(), one.name), 0.0), "its value")
            spreads[one.name] = replace(spread, source=f"not fitted ({one.why}), default: {spread.source}")
    rest = {key: replace(spread, source=f"not fitted, default: {spread.source}") for key, spread in usual.items()}
    lines = [f"# {of}, with {found.drivers} simulated drivers; correlations are not fitted", "schema_version = 1", ""]
    lines += ["[population]", f"id = {toml_string(name)}", f"title = {toml_string(f'Drivers of {found.study}')}"]
    for spread in (rest | spreads).values():
        middle, sd = KEYS[spread.shape]
        figures = {middle: spread.middle, **({sd: spread.sd} if sd else {}), "low": spread.low, "high": spread.high}
        lines += ["", f"[parameters.{spread.name}]", f'distribution = "{spread.shape}"']
        lines += [*(f"{key} = {value:.6g}" for key, value in figures.items()), f"source = {toml_string(spread.source)}"]
    return "\n".join(lines) + "\n"


def _spread(name: str, figures: tuple[float, float], source: str, usual: Spread | None = None) -> Spread:
    """The distribution of a parameter within the ends of the `usual` one, whose spread it has without an own one."""
    about = HumanParameters.__dataclass_fields__[name].metadata
    low, high = (about["low"], about["high"]) if usual is None else (usual.low, usual.high)
    middle, sd = figures[0], figures[1] or (0.0 if usual is None else usual.sd)
    shape = Shape.FIXED if sd == 0 else Shape.LOGIT_NORMAL if name.startswith("comply_") else Shape.LOGNORMAL
    if shape is Shape.LOGIT_NORMAL:
        middle = logit_median(middle, sd)
    middle = min(max(middle, low), high)
    return Spread(name=name, shape=shape, middle=middle, sd=sd, low=low, high=high, source=source)


def logit_median(mean: float, sd: float) -> float:
    """The median of a share whose logit is normal with standard deviation `sd`, approximately, from its mean."""
    within = min(max(mean, 0.01), 0.99)
    logit = math.log(within / (1.0 - within)) * math.sqrt(1.0 + math.pi * sd**2 / 8.0)
    return 1.0 / (1.0 + math.exp(-logit))
