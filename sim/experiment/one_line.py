"""A study given on the command line without a design file: scenarios, drivers, presentations and seeds.

All drivers drive the same days with the same random numbers as in `das-sim run` with these seeds. The results for
each scenario, driver and presentation are means over the seeds, and the saving by advice (defined in
`sim.drive.comparison`). It is split into causes: parts of the differences between paired runs that sum to the saving.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from das.command_line.files import warn_unusual
from das.command_line.printing import new_table, print_table, tell
from das.domain.errors import DasError
from das.domain.units import in_kwh
from sim.drivers.kinds import DriverKind, FrictionPolicy, OwnClass, Presentation
from sim.drivers.parameters import DEFAULT, load_population
from sim.drivers.presentations.presenter import presenter_of
from sim.experiment.design import Chances, ConditionOrder, Days, Design, Factor, People, Procedure, defaults
from sim.experiment.factors import FactorLevel, day_of
from sim.experiment.runner import TrialJob
from sim.experiment.study_files import TRIALS_TABLE
from sim.experiment.trials import StudyRun
from sim.world.outcome import SHARES
from sim.world.service import lay_out

MOST_SEEDS: Final = 1_000_000
"""Largest number of seeds in one range; a larger range is considered a typing error."""
_SEEDS: Final = re.compile(r"(\d{1,9})(?:-(\d{1,9}))?")


@dataclass(frozen=True, kw_only=True)
class DaysAsked:
    """The user's choice: every scenario with every driver, presentation and seed.

    With `participants` (the first number and how many), the human driver is each of these persons of the `population`
    in turn; otherwise, the average driver.
    """

    scenarios: Sequence[str]
    drivers: Sequence[DriverKind | OwnClass]
    advice: Sequence[Presentation]
    seeds: Sequence[int]
    friction: FrictionPolicy = FrictionPolicy.AS_MEASURED
    participants: tuple[int, int] | None = None
    population: str = DEFAULT

    def design(self) -> Design:
        """The design of these days; raises DasError for scenarios that cannot be driven or share an id."""
        scenarios = [day_of(name) for name in self.scenarios]
        ids = [one.id for one in scenarios]
        if len(set(ids)) < len(ids):
            raise DasError(f"scenarios {', '.join(ids)}: two have the same id")
        for one in scenarios:
            route, vehicle, _ = lay_out(one)
            warn_unusual(route, vehicle)
        load_population(self.population)
        levels = {
            "scenario": [FactorLevel(text=one.id, value=str(one.source)) for one in scenarios],
            "driver": [FactorLevel(text=str(one).replace(":", "."), value=one) for one in self.drivers],
            "presentation": [FactorLevel(text=str(one), value=one) for one in self.advice],
        }
        first, count = self.participants or (People.first, 1)
        return Design(
            name="days",
            title="Days of the command line",
            description="",
            source=Path("the command line"),
            seed=0,
            fixed={**defaults(levels), "friction": FactorLevel(text=str(self.friction), value=self.friction)},
            factors=tuple(Factor(name=name, levels=tuple(some), within=True) for name, some in levels.items()),
            people=People(count=count, first=first, population=self.population, average=self.participants is None),
            procedure=Procedure(
                order=ConditionOrder.LISTED, repetitions=len(self.seeds), days=Days.COMMON, chances=Chances.PAIRED,
                seeds=tuple(self.seeds),
            ),
        )  # fmt: skip


def parse_seeds(text: str, option: str = "--seeds") -> list[int]:
    """Read numbers like `0-99` or `1,5,10-19`, each once; raises DasError for anything else."""
    seeds: dict[int, None] = {}
    for part in text.replace(" ", "").split(","):
        match = _SEEDS.fullmatch(part)
        if match is None:
            raise DasError(f"{option} {text}: cannot read {part!r}; expected something like 0-99 or 1,5,10-19")
        first, last = int(match[1]), int(match[2] or match[1])
        if not first <= last or last - first >= MOST_SEEDS:
            raise DasError(f"{option} {text}: {part}: expected a rising range of at most {MOST_SEEDS} numbers")
        seeds.update(dict.fromkeys(range(first, last + 1)))
    return list(seeds)


def parse_participants(text: str) -> tuple[int, int]:
    """The first number and the count of a range of participants like `1-30`; raises DasError for anything else."""
    numbers = parse_seeds(text, "--participants")
    if numbers != list(range(numbers[0], numbers[0] + len(numbers))):
        raise DasError(f"--participants {text}: expected one range, like 1-30")
    return numbers[0], len(numbers)


def rows_of(jobs: Sequence[TrialJob], found: StudyRun) -> Iterator[dict[str, Any]]:
    """A row for each trial that was driven or failed, with its measures or its error."""
    failed = {row["trial"]: row["error"] for row in found.failed}
    for job in jobs:
        number = job.trial.number
        if number in found.measures or number in failed:
            yield {**row_of(job), **found.measures.get(number, {"error": failed.get(number)})}


def row_of(job: TrialJob) -> Row:
    """The values that distinguish a trial from the others of a design given on the command line."""
    trial, setting = job.trial, job.trial.setting
    person = setting.driver is DriverKind.HUMAN and trial.person is not None
    return {
        "scenario": trial.levels[0],
        "driver": str(setting.driver),
        "friction_policy": str(setting.friction),
        "advice": str(setting.presentation),
        "participant": trial.person if person else None,
        "seed": trial.seed,
    }


def told(jobs: Sequence[TrialJob], found: StudyRun) -> dict[str, Any]:
    """The figures of a finished run: means of each scenario, driver and presentation, and savings by advice."""
    rows = list(rows_of(jobs, found))
    return {**found.as_dict(), "groups": summary(rows), "savings": savings(rows)}


Row = Mapping[str, Any]
"""A trial: `scenario`, `driver`, `advice`, `friction_policy`, `participant`, `seed`, and its measures or `error`."""
Pair = tuple[int, int | None]
"""The day (its seed) and the person of two compared runs."""
LEAST_VALUES: Final = 3
"""Fewest values whose mean has an interval; for two values, Student's t would make it too wide to be useful."""
COMBINATION: Final = "scenario, driver, advice"
"""Heading of the first column of both tables."""
SHARE_NAMES: Final = {
    "component_loss": "loss",
    "resistance": "run",
    "friction_brake": "fric",
    "unreturned": "lost",
    "comfort": "comf",
}
"""Headings of the parts of the dissipated energy."""
LEGEND: Final = {
    "n": "runs",
    "fail": "failed runs",
    "late": "mean delay at the last stop (s)",
    "kWh": "mean energy of a run",
    "opt": "least energy (kWh) for the times as driven",
    "loss, run, fric, lost, comf": "shares (%) of the dissipated energy: component losses, running resistance, "
    "friction brakes, brake resistors, and comfort systems (not included in kWh)",
}
"""The legend below the table."""
SPLIT_LEGEND: Final = {
    "saved": "energy saved by advice at equal arrival, against the same driver without advice on the same days, with "
    "95 % interval (Student's t; no interval for fewer than 3 pairs)",
    "%": "the saving in % of the optimum for the times as driven (mean of both drives)",
    "times": "value of the time difference, not part of the saving, at the optimum's price of time",
    "blend": "by less friction where the motors could brake",
    "profile": "by the speed profile: as a perfect driver drove it if there is one, else as driven",
    "track": "by keeping to that profile (–: no perfect driver on these days, or none can follow this advice)",
}
"""The legend below the table of savings."""


@dataclass(frozen=True, kw_only=True)
class SplitSaving:
    """The savings (kWh) of a presentation at equal arrival against no advice: means over comparable pairs of runs.

    `blending_kwh`: less friction braking where the motors could brake. `profile_kwh`: a better speed profile, as
    driven. If a perfect driver followed the same advice on the same days (speed-and-effort and guide only), it is that
    driver's saving by the profile, and `tracking_kwh` (mostly < 0) is the effect of not keeping to it. The parts sum to
    `saved_kwh`, with a 95 % interval over the pairs of ± `interval_kwh` (Student's t; NaN for fewer than 3 pairs).
    `saved_ratio` is `saved_kwh` / `optimum_kwh`, the mean optimum for the times of both runs as driven.
    `time_shift_kwh`, the value of the time difference, is not part of `saved_kwh`.
    """

    scenario: str
    driver: str
    advice: str
    pairs: int
    optimum_kwh: float
    saved_kwh: float
    saved_ratio: float
    interval_kwh: float
    time_shift_kwh: float
    blending_kwh: float
    profile_kwh: float
    tracking_kwh: float | None

    def as_dict(self) -> dict[str, Any]:
        """The fields, for programs; None for an unknown interval."""
        return vars(self) | {"interval_kwh": None if math.isnan(self.interval_kwh) else self.interval_kwh}


def mean_interval(values: NDArray[np.float64]) -> float:
    """Half the 95 % interval of the mean of values (n,), by Student's t; NaN for fewer than `LEAST_VALUES`."""
    count = len(values)
    return student_975(count - 1) * float(values.std(ddof=1)) / count**0.5 if count >= LEAST_VALUES else math.nan


def with_interval(values: NDArray[np.float64]) -> str:
    """The mean of values (n,) with its 95 % interval, to one decimal; no interval for fewer than `LEAST_VALUES`."""
    half = mean_interval(values)
    return f"{values.mean():+.1f}" + ("" if math.isnan(half) else f" ± {half:.1f}")


def student_975(freedom: int) -> float:
    """The value that Student's t with some degrees of freedom exceeds with a probability of 2.5 %, by bisection."""
    low, high = 1.0, 13.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _student_within(middle, freedom) < 0.95 else (low, middle)
    return high


def _student_within(t: float, freedom: int) -> float:
    """The probability that Student's t lies within ± t (Abramowitz and Stegun 1964, 26.7.3 and 26.7.4)."""
    angle, odd = math.atan(t / math.sqrt(freedom)), freedom % 2
    term, total = (math.cos(angle) if odd else 1.0), 0.0
    for k in range(2 + odd, freedom + 1, 2):
        total += term
        term *= math.cos(angle) ** 2 * (k - 1) / k
    inside = math.sin(angle) * total
    return 2.0 / math.pi * (angle + inside) if odd else inside


def savings(rows: Sequence[Row]) -> list[SplitSaving]:
    """The savings of every presentation against no advice, by scenario and driver; failed runs are left out.

    A pair has the same day and the same person (column `participant`, if there is one). Runs that are not comparable
    with their optimum are left out, as are runs of a driver whose brakes depend on the advice.
    """
    good: dict[tuple[str, str, str], dict[Pair, Row]] = {}
    for row in rows:
        by_advice = row["driver"] == DriverKind.HUMAN and row.get("friction_policy") == FrictionPolicy.BY_ADVICE
        if row.get("error") is None and row["above_optimum_kwh"] is not None and not by_advice:
            runs = good.setdefault((row["scenario"], row["driver"], row["advice"]), {})
            runs[row["seed"], row.get("participant")] = row
    found = (_saving(good, *kind) for kind in good if kind[2] != Presentation.NONE)
    return [one for one in found if one is not None]


def _saving(
    good: Mapping[tuple[str, str, str], Mapping[Pair, Row]], scenario: str, driver: str, advice: str
) -> SplitSaving | None:
    """The saving of one presentation; None if no day was driven without advice as well."""
    advised, alone = good[scenario, driver, advice], good.get((scenario, driver, Presentation.NONE), {})
    pairs = [pair for pair in advised if pair in alone]
    if not pairs:
        return None

    def less(name: str) -> Any:
        return np.array([alone[pair][name] - advised[pair][name] for pair in pairs])

    saved = less("energy_kwh") - less("energy_optimum_kwh")
    optimum_kwh = float(np.mean([run[pair]["energy_optimum_kwh"] for pair in pairs for run in (alone, advised)]))
    profile, tracking = float(less("energy_profile_kwh").mean()), None
    followable = presenter_of(Presentation(advice)).follower() is not None
    exact = good.get((scenario, DriverKind.PERFECT, advice), {}) if followable else {}
    followed = {seed: row for (seed, _), row in exact.items()}
    if driver != DriverKind.PERFECT and all(seed in followed for seed, _ in pairs):
        lost = [advised[pair]["energy_profile_kwh"] - followed[pair[0]]["energy_profile_kwh"] for pair in pairs]
        tracking = -float(np.mean(lost))
        profile -= tracking
    return SplitSaving(
        scenario=scenario, driver=driver, advice=advice, pairs=len(pairs),
        optimum_kwh=optimum_kwh,
        saved_kwh=float(saved.mean()),
        saved_ratio=float(saved.mean()) / optimum_kwh,
        interval_kwh=mean_interval(saved),
        time_shift_kwh=float(less("energy_optimum_kwh").mean()),
        blending_kwh=float(less("energy_blending_kwh").mean()),
        profile_kwh=profile, tracking_kwh=tracking,
    )  # fmt: skip


def summary(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Means over the seeds, for each scenario, driver and presentation; failed runs are only counted."""
    groups: dict[tuple[str, str, str], list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["scenario"], row["driver"], row["advice"]), []).append(row)
    return [_summed(*key, group) for key, group in groups.items()]


def _summed(scenario: str, driver: str, advice: str, rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    good = [row for row in rows if row.get("error") is None]
    found: dict[str, Any] = {
        "scenario": scenario, "driver": driver, "advice": advice, "runs": len(rows), "failed": len(rows) - len(good),
        "error": next((row["error"] for row in rows if row.get("error") is not None), None),
    }  # fmt: skip
    if not good:
        return found
    late_s = np.array([row["late_s"] for row in good])
    found |= {"late_mean_s": float(late_s.mean()), "late_p95_s": float(np.quantile(late_s, 0.95))}
    for name in ("energy_kwh", "energy_optimum_kwh", *(f"{share}_kwh" for share in SHARES)):
        found[name] = float(np.mean([row[name] for row in good]))
    total = sum(found[f"{share}_kwh"] for share in SHARES)
    return found | {f"{share}_ratio": found[f"{share}_kwh"] / total for share in SHARES}


def print_summary(found: dict[str, Any]) -> None:
    """Print the table of means, the savings, and the failed runs."""
    title = f"{found['trials']} runs, {found['made']} of them simulated now"
    table = new_table(title, [COMBINATION], ("n", "fail", "late", "kWh", "opt", *SHARE_NAMES.values()))
    for group in found["groups"]:
        table.add_row(*_cells(group))
    print_table(table, LEGEND)
    print_savings(found["savings"])
    for group in found["groups"]:
        if group["error"] is not None:
            names = f"{group['scenario']}, {group['driver']}, {group['advice']}"
            tell(f"note: {names}: {group['failed']} failed, the first: {group['error']}")
    tell(f"written: {Path(found['folder']) / TRIALS_TABLE}")


def print_savings(found: Sequence[SplitSaving]) -> None:
    """Print the savings by advice, split into causes; nothing without pairs of runs."""
    if not found:
        return
    table = new_table("saved by advice, split (kWh)", [COMBINATION], ("n", *SPLIT_LEGEND))
    for one in found:
        table.add_row(
            f"{one.scenario}, {one.driver}, {one.advice}",
            str(one.pairs),
            in_kwh(one.saved_kwh, signed=True)
            + ("" if math.isnan(one.interval_kwh) else f" ± {in_kwh(one.interval_kwh)}"),
            f"{100 * one.saved_ratio:+.1f}",
            *(in_kwh(part, signed=True) for part in (one.time_shift_kwh, one.blending_kwh, one.profile_kwh)),
            "–" if one.tracking_kwh is None else in_kwh(one.tracking_kwh, signed=True),
        )
    print_table(table, SPLIT_LEGEND)


def _cells(group: dict[str, Any]) -> list[str]:
    names = f"{group['scenario']}, {group['driver']}, {group['advice']}"
    cells = [names, str(group["runs"]), str(group["failed"])]
    if "energy_kwh" not in group:
        return cells
    cells += [f"{group['late_mean_s']:+.0f}", in_kwh(group["energy_kwh"]), in_kwh(group["energy_optimum_kwh"])]
    return cells + [f"{100 * group[f'{share}_ratio']:.1f}" for share in SHARE_NAMES]
