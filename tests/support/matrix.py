"""The matrix of any train on any line: cells of line, train, driver and seed, each a whole simulated run of clear-day.

A cell is simulated in this process with the advice and, for the default human, also without it. It is judged by the
product's own figures of a run, and by a witness (`Witness`) that reads limits and brakes from the raw files.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from statistics import mean, median
from typing import Any, Final, NamedTuple

import numpy as np

from das.domain.errors import DasError
from das.domain.units import KM, kwh
from sim.cli.run import DayAsked
from sim.drive.above_optimum import AboveOptimum
from sim.drive.figures import DriveFigures
from sim.drivers.cab import AT_STOP_M, CabView, Driver
from sim.drivers.human import HumanDriver
from sim.drivers.kinds import DriverKind, FrictionPolicy, Presentation
from sim.drivers.presentations.presenter import presenter_of
from sim.experiment.one_line import with_interval
from sim.plant.kernels import Command
from sim.world.in_process import InProcess
from sim.world.loop import LOOK_S, Run, World
from sim.world.outcome import above_optimum, fronts_of_braking, optimum_as_driven
from sim.world.service import Day, make_day
from tests.support.flat_days import Alone
from tests.support.matrix_lines import Cell, Who, files_of, service_of
from tests.support.obedient_drivers import CARELESS, WEAKER
from tests.support.raw_data import G, Line, Train

ADVISED = Presentation(os.environ.get("DAS_MATRIX_ADVICE", DayAsked.advice))
"""The advice that is judged: the product's default, or the one named in the environment."""
PERCENT: Final = replace(CARELESS, notches=0)
"""The careless driver with a percent controller: one of five notches exceeds the permitted braking of the FLIRT and the
KISS of the public benchmark, because their friction brakes are very strong."""
GRID_M = 1.0
NEAR_M = 1.0
"""Step (m) of the witness's grid; a limit counts only where it applies on both sides of the train's head."""
OVER_MPS = 0.5
"""Excess (m/s) over a limit or a braking curve above which a train is too fast."""
SHORT_M = 1500.0
"""Length (m) below which a section is short."""


class Witness:
    """Limits over the train and its braking curve on a grid of a metre, from the raw files of line and train."""

    def __init__(self, line: Line, train: Train) -> None:
        at_m = np.arange(0.0, line.stops_m[-1] + 1.0, GRID_M)
        length = math.floor(train.length_m)
        padded = np.concatenate((np.full(length, np.inf), line.limits.at(at_m)))
        over = np.lib.stride_tricks.sliding_window_view(padded, length + 1).min(axis=1)
        self.limit_mps = np.minimum(over, train.max_speed_mps)
        self._line, self._train, self._at_m = line, train, at_m
        self._uphill = line.gradients.under(at_m, train.length_m)
        self._curves: dict[float, Any] = {}

    def above(self, s_m: float, speed_mps: float, stop_m: float) -> tuple[float, float]:
        """The excess (m/s) of a speed over the limit, and over the braking curve of all brakes (limits and stop)."""
        last = len(self.limit_mps) - 1
        near = slice(min(max(int(s_m - NEAR_M), 0), last), int(s_m + NEAR_M) + 2)
        return speed_mps - float(self.limit_mps[near].max()), speed_mps - float(self._curve(stop_m)[near].max())

    def _curve(self, stop_m: float) -> Any:
        """The braking curve back from a stop: v² increases in each metre by twice the deceleration, up to the limit."""
        if stop_m not in self._curves:
            train, curve, v = self._train, np.zeros(len(self.limit_mps)), 0.0
            curve[round(stop_m) :] = np.inf  # A train beyond its stop has missed it, which is judged separately.
            for i in range(min(round(stop_m), len(curve)) - 1, -1, -1):
                slope_n = train.mass_kg * G * float(self._uphill[i])
                held_n = train.r0_n + train.r1_n_per_mps * v + train.r2_n_per_mps2 * v * v + slope_n
                rate = min((self._brakes_n(i, v) + held_n) / train.inertia_kg, train.max_deceleration_mps2)
                v = min(math.sqrt(max(v * v + 2.0 * rate * GRID_M, 0.0)), float(self.limit_mps[i]))
                curve[i] = v
            self._curves[stop_m] = curve
        return self._curves[stop_m]

    def _brakes_n(self, i: int, v: float) -> float:
        """All brakes (N) that the train's policy allows in a plan; no electric brake on a supply that rejects power."""
        train, zones = self._train, (*self._line.neutral, *self._line.no_regeneration)
        electric_n = 0.0 if any(a <= self._at_m[i] < b for a, b in zones) else float(train.motors_n(np.float64(v))[1])
        return electric_n + (0.0 if train.brakes == "electric" else train.friction_n)


@dataclass(frozen=True, kw_only=True)
class Judged:
    """The figures of a cell; NaN where there is none. `said` is the reason for a rejection or for the end of the run.

    `late_s` is the delay at the last stop, `worst_late_s` the largest one, `sections_late_s` the delay at each arrival
    minus that at the departure before it, and `alone_…` are the figures of the same run without advice. `unkept` is the
    number of sections whose timetable cannot be kept according to the product. `above_own_ratio` is the energy above
    the optimum with the braking of the plans. `above_limit_…` and `above_curve_…` are from the witness; seconds count
    above `OVER_MPS`.
    """

    line: str
    train: str
    who: str
    seed: int
    sections: int = 0
    mean_km: float = math.nan
    unkept: int = 0
    late_s: float = math.nan
    worst_late_s: float = math.nan
    sections_late_s: tuple[float, ...] = ()
    alone_sections_late_s: tuple[float, ...] = ()
    kwh: float = math.nan
    alone_kwh: float = math.nan
    optimum_kwh: float = math.nan
    saved_kwh: float = math.nan
    above_own_ratio: float = math.nan
    changes_per_min: float = math.nan
    announced_ratio: float = math.nan
    brakes_led_ratio: float = math.nan
    promises_kept_ratio: float = math.nan
    shortest_s: float = math.nan
    against_grammar: int = 0
    last_word_acts: int = 0
    above_limit_obeying_s: int = 0
    over_limit_s: float = math.nan
    above_limit_mps: float = math.nan
    above_limit_s: float = math.nan
    above_curve_mps: float = math.nan
    above_curve_s: float = math.nan
    stops_missed: int = 0
    said: str = ""

    @property
    def saved_ratio(self) -> float:
        """The saving of the advice at equal arrival as a share of the energy without it; NaN if braking recovers
        more.
        """
        return self.saved_kwh / self.alone_kwh if self.alone_kwh > 0 else math.nan

    @classmethod
    def columns(cls) -> list[str]:
        """The names of the figures, in order."""
        return [one.name for one in fields(cls)]

    def as_row(self) -> list[Any]:
        """The figures as a row: None for a missing one, several values as one text."""
        values = (" ".join(f"{s:.1f}" for s in v) if isinstance(v, tuple) else v for v in asdict(self).values())
        return [None if isinstance(v, float) and math.isnan(v) else v for v in values]


class Watched:
    """A driver whose state is judged by the witness at each look, five a second; a careless one brakes too weakly."""

    def __init__(self, driver: Driver, witness: Witness, *, weaker: float = 1.0) -> None:
        self._driver, self._witness, self._weaker = driver, witness, weaker
        self.excess_mps: list[tuple[float, float]] = []
        """The excess over limit and curve at each look."""

    def command(self, cab: CabView) -> Command:
        self.excess_mps.append(self._witness.above(cab.s_m, cab.speed_mps, cab.stop_m))
        command = self._driver.command(cab)
        return command._replace(value=self._weaker * command.value) if command.value < 0 else command


def driver_of(day: Day, cell: Cell, witness: Witness) -> Watched:
    """The driver of a cell."""
    if cell.who is Who.CARELESS:
        careless = HumanDriver(day.service.line, PERCENT, friction=FrictionPolicy.ELECTRIC_FIRST, seed=cell.seed)
        return Watched(careless, witness, weaker=WEAKER)
    return Watched(day.driver(DriverKind.LITERAL if cell.who is Who.OBEDIENT else DriverKind.HUMAN), witness)


def judged(cell: Cell, folder: Path) -> Judged:
    """Simulate and judge a cell; raises DasError if the train cannot run on its line."""
    service, (route, vehicle) = service_of(cell, folder), files_of(cell, folder)
    day, found = make_day(service, cell.seed), dict[str, Any](zip(Cell._fields, cell, strict=True))
    witness = Witness(Line.read(route), Train.read(vehicle))
    ends_m = [stop.position_m for stop in service.stops]
    found |= {
        "sections": len(ends_m) - 1,
        "mean_km": (ends_m[-1] - ends_m[0]) / (len(ends_m) - 1) / KM,
        "unkept": len(list(service.unkept())),
    }
    driver = driver_of(day, cell, witness)
    try:
        shows = presenter_of(ADVISED)
        link = InProcess(service, guide=shows.needs_guide)
        run = World(day, driver, ADVISED, link).run()
    except DasError as error:
        return Judged(**found, **_witnessed(driver), stops_missed=1, said=str(error))
    found |= _witnessed(driver) | _of_run(run) | _shown(run)
    energy = above_optimum(day, run)
    found |= {"kwh": kwh(energy.driven_j), "optimum_kwh": kwh(energy.optimum_j)}
    if cell.who is Who.OBEDIENT:
        own = optimum_as_driven(fronts_of_braking(day, DriverKind.LITERAL), run)
        own_j = sum(solution.balance.input for solution in own)
        found["above_own_ratio"] = energy.driven_j / own_j - 1.0 if own_j > 0 else math.nan
    if cell.who is Who.HUMAN:
        alone = World(day, driver_of(day, cell, witness), Presentation.NONE, Alone()).run()
        found["alone_sections_late_s"] = _of_run(alone)["sections_late_s"]
        found |= _saved(energy, above_optimum(day, alone))
    return Judged(**found)


def _of_run(run: Run) -> dict[str, Any]:
    """Punctuality and stops of a run, and the product's own figures on limits."""
    late = [call.arrived_late_s for call in run.calls[1:]]
    sections = (after - before.departed_late_s for before, after in zip(run.calls, late, strict=False))
    return {
        "late_s": late[-1],
        "worst_late_s": max(late),
        "sections_late_s": tuple(sections),
        "over_limit_s": run.violations.over_limit_s,
        "stops_missed": sum(not abs(call.stopping_error_m) <= AT_STOP_M for call in run.calls[1:]),
    }


def _shown(run: Run) -> dict[str, Any]:
    """Stability and reliability of the advice in a run."""
    told = run.instructions
    figures = DriveFigures(violations=run.violations, stability=run.stability, instructions=told).as_dict()
    ratios = ("announced_ratio", "brakes_led_ratio", "promises_kept_ratio")
    return {
        **{name: math.nan if figures[name] is None else figures[name] for name in ratios},
        "changes_per_min": run.stability.changes_per_min,
        "shortest_s": told.shortest_s if math.isfinite(told.shortest_s) else math.nan,
        "against_grammar": told.against_grammar,
        "last_word_acts": told.reliance.replaced,
        "above_limit_obeying_s": told.reliance.above_limit_s,
    }


def _witnessed(driver: Watched) -> dict[str, float]:
    """The largest excess over limit and curve, and its duration (s)."""
    limit, curve = np.array(driver.excess_mps).T
    found = {}
    for name, one in (("limit", limit), ("curve", curve)):
        found[f"above_{name}_mps"] = float(one.max())
        found[f"above_{name}_s"] = LOOK_S * float((one > OVER_MPS).sum())
    return found


def _saved(advised: AboveOptimum, alone: AboveOptimum) -> dict[str, float]:
    """The saving of the advice at equal arrival, and the energy without advice."""
    if advised.why_not or alone.why_not:
        return {"alone_kwh": kwh(alone.driven_j)}
    saved_j = alone.driven_j - alone.optimum_j - (advised.driven_j - advised.optimum_j)
    return {"alone_kwh": kwh(alone.driven_j), "saved_kwh": kwh(saved_j)}


class Bound(NamedTuple):
    """The bounds of a figure over all cells of a driver: that of the goal, and that met by today's advice.

    The figure is `over` of the values `of` each cell; it must not exceed its bounds or, with `least`, not be below
    them.
    """

    what: str
    who: Who
    of: Callable[[Judged], Sequence[float]]
    over: Callable[[Sequence[float]], float]
    asked: float
    today: float
    least: bool = False

    def found(self, rows: Sequence[Judged]) -> float:
        """The figure; NaN if no cell has it."""
        of_him = (self.of(row) for row in rows if row.who == self.who)
        values = [value for several in of_him for value in several if not math.isnan(value)]
        return self.over(values) if values else math.nan

    def breaks(self, found: float, bound: float) -> bool:
        """Whether a figure violates a bound; a missing figure does not."""
        return found < bound if self.least else found > bound


def _kept(of: Callable[[Judged], Sequence[float]]) -> Callable[[Judged], Sequence[float]]:
    """The figure of the cells whose timetable can be kept according to the product."""
    return lambda row: () if row.unkept else of(row)


def _short(row: Judged) -> Sequence[float]:
    return (row.changes_per_min,) if row.mean_km * KM < SHORT_M else ()


_OBEDIENT, _HUMAN, _ = Who
BOUNDS: Final = (
    *(Bound("runs that ended before the last stop", who, lambda x: (bool(x.said),), sum, 0, 0) for who in Who),
    Bound("stops missed", _OBEDIENT, lambda x: (x.stops_missed,), sum, 0, 0),
    Bound("above a limit, m/s", _OBEDIENT, lambda x: (x.above_limit_mps,), max, 0.5, 0.5),
    Bound("above a braking curve, m/s", _OBEDIENT, lambda x: (x.above_curve_mps,), max, 0.5, 0.5),
    Bound("changes a minute, mean", _OBEDIENT, lambda x: (x.changes_per_min,), mean, 1.7, 1.7),
    Bound("changes a minute, most", _OBEDIENT, lambda x: (x.changes_per_min,), max, 2.2, 4.1),
    Bound("announced, mean", _OBEDIENT, lambda x: (x.announced_ratio,), mean, 0.97, 0.97, least=True),
    Bound("brakes led, mean", _OBEDIENT, lambda x: (x.brakes_led_ratio,), mean, 0.97, 0.97, least=True),
    Bound("promises kept, mean", _OBEDIENT, lambda x: (x.promises_kept_ratio,), mean, 0.96, 0.96, least=True),
    Bound("shortest instruction, s", _OBEDIENT, lambda x: (x.shortest_s,), min, 8, 8, least=True),
    Bound("instructions against the grammar, most", _OBEDIENT, lambda x: (x.against_grammar,), max, 0, 1),
    Bound("acts of the last word, most", _OBEDIENT, lambda x: (x.last_word_acts,), max, 0, 1),
    Bound("latest arrival, s", _OBEDIENT, _kept(lambda x: (x.worst_late_s,)), max, 10, 12),
    Bound("late in a section, s, median", _HUMAN, _kept(lambda x: x.sections_late_s), median, 0, 0),
    Bound("saved at equal arrival, mean share", _HUMAN, lambda x: (x.saved_ratio,), mean, 0, 0, least=True),
    Bound("saved at equal arrival, least share", _HUMAN, lambda x: (x.saved_ratio,), min, 0, -0.05, least=True),
    Bound("changes a minute on short sections, most", _HUMAN, _short, max, 2.5, 4.0),
    Bound("acts of the last word, most", _HUMAN, lambda x: (x.last_word_acts,), max, 0, 5),
    Bound("above a limit while obeying, s", _HUMAN, lambda x: (x.above_limit_obeying_s,), max, 0, 1),
)
"""Bounds of the goal and of today, with a margin for other seeds; the next planner is judged by the same table."""


def bounds_table(rows: Sequence[Judged]) -> Iterator[str]:
    """All bounds with the figures found, as a Markdown table."""
    yield "| driver | figure | asked | today's bound | found | verdict |"
    yield "|---|---|---:|---:|---:|---|"
    for one in BOUNDS:
        found, sign = one.found(rows), "≥" if one.least else "≤"
        asked, today = (f"{sign} {bound:g}" for bound in (one.asked, one.today))
        verdict = "no cell" if math.isnan(found) else "not reached" if one.breaks(found, one.asked) else "reached"
        yield f"| {one.who} | {one.what} | {asked} | {today} | {found:.3g} | {verdict} |"


MANY = 20
"""Least number of cells for a mean or median; with fewer, one drive that is late by chance would violate the bound."""


def breaches(rows: Sequence[Judged]) -> list[str]:
    """The violated bounds of today, one line each; bounds of means are judged from `MANY` cells of a driver on."""
    many = {who for who in Who if sum(row.who == who for row in rows) >= MANY}
    found = ((one, one.found(rows)) for one in BOUNDS if one.who in many or one.over not in (mean, median))
    return [f"{one.who}: {one.what}: {it:.3g}, bound {one.today:g}" for one, it in found if one.breaks(it, one.today)]


COLUMNS: Final = {
    "late, s": "sections_late_s", "alone": "alone_sections_late_s", "kWh": "kwh", "alone, kWh": "alone_kwh",
    "saved": "saved_ratio", "above own optimum": "above_own_ratio", "changes a minute": "changes_per_min",
    "announced": "announced_ratio", "brakes led": "brakes_led_ratio", "promises kept": "promises_kept_ratio",
    "shortest, s": "shortest_s", "last word": "last_word_acts", "s above limit": "above_limit_s",
    "above limit, m/s": "above_limit_mps", "above curve, m/s": "above_curve_mps",
}  # fmt: skip
"""The columns of the table of lines: means over cells and sections, and the largest excess over limit and curve."""


def lines_table(rows: Sequence[Judged]) -> Iterator[str]:
    """The means of every line, train and driver, as a Markdown table."""
    yield f"| line | train | driver | cells | {' | '.join(COLUMNS)} |"
    yield "|---|---|---|---:" + "|---:" * len(COLUMNS) + "|"
    for key in sorted({(row.line, row.train, row.who) for row in rows}):
        of_it = [row for row in rows if (row.line, row.train, row.who) == key]
        cells = " | ".join(_cell(of_it, name) for name in COLUMNS.values())
        yield f"| {' | '.join(key)} | {len(of_it)} | {cells} |"


def seeds_table(rows: Sequence[Judged]) -> Iterator[str]:
    """The human driver on every line with a train: means over the seeds with their 95 % intervals, as Markdown."""
    yield "| line | train | seeds | saved at equal arrival, % | late in a section, median, s | acts | stops missed |"
    yield "|---|---|---:|---:|---:|---:|---:|"
    for key in sorted({(row.line, row.train) for row in rows}):
        of_it = [row for row in rows if (row.line, row.train) == key]
        saved = np.array([100.0 * row.saved_ratio for row in of_it if not math.isnan(row.saved_ratio)])
        lates_s = [late_s for row in of_it for late_s in row.sections_late_s]
        late_s = median(lates_s) if lates_s else math.nan
        acts, missed = (sum(getattr(row, name) for row in of_it) for name in ("last_word_acts", "stops_missed"))
        mean_saved = with_interval(saved) if saved.size else ""
        yield f"| {' | '.join(key)} | {len(of_it)} | {mean_saved} | {late_s:.1f} | {acts} | {missed} |"


def _cell(rows: Sequence[Judged], name: str) -> str:
    values = [v for row in rows for v in np.atleast_1d(getattr(row, name)).tolist() if not math.isnan(v)]
    if not values:
        return ""
    found = max(values) if name.startswith(("above_limit_m", "above_curve")) else mean(values)
    return f"{100 * found:.0f} %" if name.endswith("ratio") else f"{found:.1f}"
