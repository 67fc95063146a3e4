"""The runs of a batch: which they are, the identity of each, how one is made, and the table of them all.

The table is Parquet, one row a run (docs/reference/batch-table.md).
"""

from __future__ import annotations

import hashlib
import importlib.util
import io
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from rich import box
from rich.table import Table

from das import __version__
from das.command_line.loading import warn_unusual
from das.command_line.printing import print_table, tell
from das.domain.errors import DasError
from das.domain.files.writing import write_whole
from das.domain.losses import Level
from precompute.workers import source_sha256
from sim.drivers.cab import DriverEvent
from sim.drivers.kinds import DriverKind, FrictionPolicy, OwnClass, Presentation
from sim.drivers.own_class import driver_versions
from sim.drivers.population import Participant
from sim.drivers.presentations.presenter import presenter_of
from sim.jobs.runner import JobRecording, JobResult, ServiceMemory, drive_day
from sim.recording.inputs import sha256
from sim.world.disturbances import described
from sim.world.outcome import SHARES, outcome
from sim.world.over_bus import How
from sim.world.scenario import load_scenario, read_scenario
from sim.world.service import lay_out, make_day, scenario_files

MOST_SEEDS = 1_000_000
"""Most seeds in one range; a larger range is taken for a typing error."""
STOP_COLUMNS = ("due_s", "arrived_s", "departed_s", "late_s", "missed_m")
"""Figures of the stops, as lists in the order in which the train comes to them."""
_services = ServiceMemory()
"""A worker is a process: this is its memory between jobs."""
_SEEDS = re.compile(r"(\d{1,9})(?:-(\d{1,9}))?")


@dataclass(frozen=True, kw_only=True)
class BatchJob:
    """One run to be made.

    `scenario` is its file, `versions` are the program and the files that it is made with, `record` is where its
    recording goes.
    """

    name: str
    scenario: Path
    scenario_id: str
    seed: int
    driver: DriverKind | OwnClass
    friction: FrictionPolicy
    participant: Participant | None
    advice: Presentation
    level: Level | None
    versions: tuple[tuple[str, str], ...]
    record: Path | None

    @property
    def inputs_sha256(self) -> str:
        """The hash of everything that decides the result; a run with an equal hash need not be made again."""
        level = None if self.level is None else str(self.level)
        decides = [self.name, str(self.friction), level, sorted(self.versions)]
        return hashlib.sha256(json.dumps(decides).encode()).hexdigest()

    @property
    def row(self) -> dict[str, Any]:
        """What is known of the run before it is made."""
        person = self.participant
        return {
            "scenario": self.scenario_id,
            "seed": self.seed,
            "driver": str(self.driver),
            "friction_policy": str(self.friction),
            "participant": None if person is None else person.number,
            "population": None if person is None else person.population.id,
            "advice": str(self.advice),
            **dict(self.versions),
            "inputs_sha256": self.inputs_sha256,
            "recording": None if self.record is None else str(self.record),
        }

    @property
    def kept_files(self) -> tuple[str, ...]:
        """Empty: a run makes no files other than its recording, if it has one."""
        return ()

    @property
    def recording(self) -> JobRecording | None:
        """Where the run is recorded; None where it is not."""
        return None if self.record is None else JobRecording(self.record, self.command)

    @property
    def command(self) -> str:
        """The command that a recording of the run names as the one that made it."""
        return f"das-sim batch: {self.name}, inputs {self.inputs_sha256}"


@dataclass(frozen=True, kw_only=True)
class Batch:
    """What the user asked for: every scenario with every driver, presentation and seed.

    With `participants`, the human driver is each of these persons in turn.
    """

    scenarios: Sequence[str]
    drivers: Sequence[DriverKind | OwnClass]
    participants: Sequence[Participant] = ()
    advice: Sequence[Presentation]
    seeds: Sequence[int]
    friction: FrictionPolicy = FrictionPolicy.AS_MEASURED
    level: Level | None
    record: bool
    folder: Path

    def jobs(self) -> Iterator[BatchJob]:
        """The runs in the order of the table; raises DasError for scenarios that cannot be run or share a name."""
        read = [load_scenario(name) for name in self.scenarios]
        ids = [scenario.id for scenario in read]
        who = {driver: driver_versions(driver) for driver in self.drivers}
        if len(set(ids)) < len(ids):
            raise DasError(f"scenarios {', '.join(ids)}: two have the same id")
        for scenario in read:
            route, vehicle, _ = lay_out(scenario, level=self.level)
            warn_unusual(route, vehicle)
            versions = {"version": __version__, "code_sha256": source_sha256()}
            versions |= {f"{name}_sha256": sha256(path) for name, path in scenario_files(scenario).items()}
            for (driver, person), advice, seed in product(self._persons(), self.advice, self.seeds):
                of_person = {} if person is None else {"population_sha256": sha256(person.population.source)}
                name = f"{scenario.id}-{str(driver).replace(':', '.')}-{advice}-{seed}"
                name += "" if person is None else f"-participant-{person.number}"
                yield BatchJob(
                    name=name,
                    scenario=scenario.source,
                    scenario_id=scenario.id,
                    seed=seed,
                    driver=driver,
                    friction=self.friction,
                    participant=person,
                    advice=advice,
                    level=self.level,
                    versions=tuple((versions | who[driver] | of_person).items()),
                    record=self.folder / "recordings" / f"{name}.mcap" if self.record else None,
                )

    def _persons(self) -> Iterator[tuple[DriverKind | OwnClass, Participant | None]]:
        """The drivers of the batch: the human driver comes once for every participant, each other driver once."""
        for driver in self.drivers:
            persons = self.participants if driver is DriverKind.HUMAN else ()
            yield from ((driver, person) for person in persons or (None,))


def parse_seeds(text: str, option: str = "--seeds") -> list[int]:
    """Read numbers like `0-99` or `1,5,10-19`, each once; raises DasError for anything else."""
    seeds: dict[int, None] = {}
    for part in text.replace(" ", "").split(","):
        match = _SEEDS.fullmatch(part)
        if match is None:
            raise DasError(f"{option} {text}: cannot read {part!r}; expected something like 0-99 or 1,5,10-19")
        first, last = int(match[1]), int(match[2] or match[1])
        if not first <= last or last - first >= MOST_SEEDS:
            raise DasError(f"{option} {text}: {part}: expected a range that rises, of at most {MOST_SEEDS} numbers")
        seeds.update(dict.fromkeys(range(first, last + 1)))
    return list(seeds)


def make_run(job: BatchJob) -> JobResult:
    """Make a run and find its figures; raises DasError where it cannot be made."""
    day = make_day(_services.of(read_scenario(job.scenario), job.level), job.seed, job.participant)
    how = How(driver=job.driver, friction=job.friction, advice=job.advice, train="train-1", command=job.command)
    run = drive_day(day, day.driver(job.driver, job.friction), how, job.record)
    figures = outcome(day, run, job.driver).as_dict()
    stops = figures.pop("stops")
    row = {
        **figures,
        "happens": described(day.disturbances),
        "drawn": json.dumps(day.drawn),
        "stops": [stop["name"] for stop in stops],
        **{f"stop_{name}": [stop[name] for stop in stops] for name in STOP_COLUMNS},
        **{f"decision_{name}": [getattr(one, name) for one in run.decisions] for name in DriverEvent._fields},
    }
    return JobResult(row, {})


TEXTS = (
    *("scenario", "driver", "friction_policy", "population", "advice", "level", "error", "happens", "drawn"),
    *("recording", "version"),
    *("code_sha256", "scenario_sha256", "route_sha256", "vehicle_sha256", "loss_map_sha256"),
    *("true_vehicle_sha256", "true_loss_map_sha256", "driver_sha256", "population_sha256", "inputs_sha256"),
)
COUNTS = (
    "participant",
    "advices_given",
    "advices_withdrawn",
    "advices_unheard",
    "advices_above_limit",
    "reversals",
    "signals_passed",
    "simulated_s",
)
TRUTHS = ("advice_restless", "hindsight_faster_than_possible")
FIGURES = (
    *("late_s", "running_time_s"),
    *("energy_kwh", "energy_at_stops_kwh", "energy_planned_kwh", "energy_hindsight_kwh", "above_optimum_ratio"),
    *("energy_blending_kwh", "energy_profile_kwh", "energy_own_braking_kwh"),
    *(f"{name}_kwh" for name in SHARES),
    *(f"{name}_ratio" for name in SHARES),
    *("potential_kwh", "ledger_residual_ratio", "beyond_signal_m", "over_limit_s", "over_limit_kmh"),
    *("advice_changes_per_min", "shortest_mode_s"),
)


def require_pyarrow() -> None:
    """Raise DasError if the package that writes the table is not installed."""
    if importlib.util.find_spec("pyarrow") is None:
        raise DasError("pyarrow is not installed: pip install 'driver-advisory-system[batch]'")


def write_table(path: Path, rows: Iterable[dict[str, Any]]) -> None:
    """Write the rows as Parquet; columns that a failed run does not have are null."""
    import pyarrow as pa
    from pyarrow import parquet

    listed = list(rows)
    table = pa.Table.from_pylist([{name: row.get(name) for name in SCHEMA_NAMES} for row in listed], schema=_schema())
    content = io.BytesIO()
    parquet.write_table(table, content, compression="zstd")
    write_whole(path, content.getvalue())


SCHEMA_NAMES = (
    *("seed", *TEXTS, *COUNTS, *FIGURES, *TRUTHS, "stops"),
    *(f"stop_{name}" for name in STOP_COLUMNS),
    *("decision_time_s", "decision_what", "decision_value"),
)


def _schema() -> Any:
    import pyarrow as pa

    types = {
        "seed": pa.int64(),
        **dict.fromkeys(TEXTS, pa.string()),
        **dict.fromkeys(COUNTS, pa.int64()),
        **dict.fromkeys(FIGURES, pa.float64()),
        **dict.fromkeys(TRUTHS, pa.bool_()),
        "stops": pa.list_(pa.string()),
        **{f"stop_{name}": pa.list_(pa.float64()) for name in STOP_COLUMNS},
        **dict.fromkeys(("decision_time_s", "decision_value"), pa.list_(pa.float64())),
        "decision_what": pa.list_(pa.string()),
    }
    return pa.schema([(name, types[name]) for name in SCHEMA_NAMES])


Row = Mapping[str, Any]
NORMAL_95: Final = 1.96
SHARE_NAMES: Final = {
    "component_loss": "loss",
    "resistance": "run",
    "friction_brake": "fric",
    "unreturned": "lost",
    "comfort": "comf",
}
"""Headings of the shares: where the energy went."""
LEGEND: Final = {
    "n": "runs",
    "fail": "failed runs",
    "late": "mean delay at the last stop (s)",
    "kWh": "mean energy of a run",
    "opt": "least energy (kWh) for the times as driven",
    "loss, run, fric, lost, comf": "shares (%) of the energy that went to losses of the train, running resistance, "
    "friction brakes, brake resistors, comfort systems",
}
"""What is said below the table."""
SPLIT_LEGEND: Final = {
    "saved": "energy saved against the same driver without advice on the same days, with its 95 % interval",
    "times": "because other running times have another optimum",
    "blend": "by less friction where the motors could brake",
    "profile": "by the speed profile: of the advice where a perfect driver drove it as well, else as driven",
    "track": "by keeping to that profile (–: no perfect driver in this batch, or none who follows this advice)",
}
"""What is said below the table of savings."""


@dataclass(frozen=True, kw_only=True)
class SplitSaving:
    """What a presentation saves against no advice, in kWh: means over the seeds that both have.

    `time_shift`: the optimum of the baseline's times is higher. `blending`: less friction where the motors could brake.
    `profile`: a better speed profile, as it was driven; where a perfect driver, who follows vector and coach, drove the
    same days, it is the profile of the advice alone, and `tracking` (mostly < 0) is what the driver lost by not keeping
    to it. The parts sum to `saved`, whose 95 % interval over the pairs is ± `interval` (normal).
    """

    scenario: str
    driver: str
    advice: str
    pairs: int
    baseline_kwh: float
    saved_kwh: float
    interval_kwh: float
    time_shift_kwh: float
    blending_kwh: float
    profile_kwh: float
    tracking_kwh: float | None

    def as_dict(self) -> dict[str, Any]:
        """The fields, for programs."""
        return dict(vars(self))


def savings(rows: Sequence[Row]) -> list[SplitSaving]:
    """The savings of every presentation over none, for each scenario and driver that has both; failed runs left out.

    A pair is the same day with the same person (column `participant`, where there is one).
    """
    good: dict[tuple[str, str, str], dict[_Pair, Row]] = {}
    for row in rows:
        if row.get("error") is None:
            runs = good.setdefault((row["scenario"], row["driver"], row["advice"]), {})
            runs[_Pair(row["seed"], row.get("participant"))] = row
    found = (_saving(good, *kind) for kind in good if kind[2] != Presentation.NONE)
    return [one for one in found if one is not None]


class _Pair(NamedTuple):
    """What two runs that are compared have in common: the day and the person."""

    seed: int
    participant: int | None


def _saving(
    good: Mapping[tuple[str, str, str], Mapping[_Pair, Row]], scenario: str, driver: str, advice: str
) -> SplitSaving | None:
    """The saving of one presentation; None where no day was driven without advice as well."""
    advised, alone = good[scenario, driver, advice], good.get((scenario, driver, Presentation.NONE), {})
    pairs = [pair for pair in advised if pair in alone]
    if not pairs:
        return None

    def less(name: str) -> Any:
        return np.array([alone[pair][name] - advised[pair][name] for pair in pairs])

    saved = less("energy_kwh")
    spread = float(saved.std(ddof=1)) if len(pairs) > 1 else float("nan")
    profile, tracking = float(less("energy_profile_kwh").mean()), None
    followable = presenter_of(Presentation(advice)).follower() is not None
    exact = good.get((scenario, DriverKind.PERFECT, advice), {}) if followable else {}
    followed = {pair.seed: row for pair, row in exact.items()}
    if driver != DriverKind.PERFECT and all(pair.seed in followed for pair in pairs):
        lost = [advised[pair]["energy_profile_kwh"] - followed[pair.seed]["energy_profile_kwh"] for pair in pairs]
        tracking = -float(np.mean(lost))
        profile -= tracking
    return SplitSaving(
        scenario=scenario, driver=driver, advice=advice, pairs=len(pairs),
        baseline_kwh=float(np.mean([alone[pair]["energy_kwh"] for pair in pairs])),
        saved_kwh=float(saved.mean()),
        interval_kwh=NORMAL_95 * spread / len(pairs) ** 0.5,
        time_shift_kwh=float(less("energy_hindsight_kwh").mean()),
        blending_kwh=float(less("energy_blending_kwh").mean()),
        profile_kwh=profile, tracking_kwh=tracking,
    )  # fmt: skip


def summary(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Means over the seeds of each scenario, driver and presentation; failed runs are counted but left out of the
    means."""
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
    for name in ("energy_kwh", "energy_hindsight_kwh", *(f"{share}_kwh" for share in SHARES)):
        found[name] = float(np.mean([row[name] for row in good]))
    total = sum(found[f"{share}_kwh"] for share in SHARES)
    return found | {f"{share}_ratio": found[f"{share}_kwh"] / total for share in SHARES}


def print_summary(found: dict[str, Any]) -> None:
    """Print the table at the end of a batch."""
    title = f"{found['runs']} runs, {found['made']} of them made now"
    table = _table(title, ("n", "fail", "late", "kWh", "opt", *SHARE_NAMES.values()))
    for group in found["groups"]:
        table.add_row(*_cells(group))
    print_table(table, LEGEND)
    print_savings(found["savings"])
    for group in found["groups"]:
        if group["error"] is not None:
            names = f"{group['scenario']}, {group['driver']}, {group['advice']}"
            tell(f"note: {names}: {group['failed']} failed, the first: {group['error']}")
    tell(f"written: {found['file']}")


def _table(title: str, names: Sequence[str]) -> Table:
    """A table with a row for each scenario, driver and presentation."""
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("scenario, driver, advice")
    for name in names:
        table.add_column(name, justify="right", no_wrap=True)
    return table


def print_savings(found: Sequence[SplitSaving]) -> None:
    """Print what advice saved, split by what saved it; nothing where no run was without advice."""
    if not found:
        return
    table = _table("saved against no advice, split (kWh)", ("n", *SPLIT_LEGEND))
    for one in found:
        table.add_row(
            f"{one.scenario}, {one.driver}, {one.advice}",
            str(one.pairs),
            f"{one.saved_kwh:+.1f} ± {one.interval_kwh:.1f}" if one.pairs > 1 else f"{one.saved_kwh:+.1f}",
            *(f"{part:+.1f}" for part in (one.time_shift_kwh, one.blending_kwh, one.profile_kwh)),
            "–" if one.tracking_kwh is None else f"{one.tracking_kwh:+.1f}",
        )
    print_table(table, SPLIT_LEGEND)


def _cells(group: dict[str, Any]) -> list[str]:
    names = f"{group['scenario']}, {group['driver']}, {group['advice']}"
    cells = [names, str(group["runs"]), str(group["failed"])]
    if "energy_kwh" not in group:
        return cells
    cells += [f"{group['late_mean_s']:+.0f}", f"{group['energy_kwh']:.1f}", f"{group['energy_hindsight_kwh']:.1f}"]
    return cells + [f"{100 * group[f'{share}_ratio']:.1f}" for share in SHARE_NAMES]
