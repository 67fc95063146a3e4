"""The runs of a batch: which runs there are, the identity of each, how it is made, and the table of all.

The table is Parquet, one row a run (docs/reference/batch-table.md).
"""

from __future__ import annotations

import hashlib
import io
import json
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from das import __version__
from das.command_line.files import warn_unusual
from das.domain.errors import DasError
from das.domain.files.writing import write_whole
from das.domain.levels import Level
from precompute.workers import source_sha256
from sim.drivers.cab import DriverEvent
from sim.drivers.kinds import DriverKind, FrictionPolicy, OwnClass, Presentation
from sim.drivers.own_class import driver_versions
from sim.drivers.parameters import Participant
from sim.jobs.runner import JobRecording, JobResult, ServiceMemory, whole_run
from sim.recording.inputs import sha256
from sim.world.disturbances import described
from sim.world.outcome import SHARES, outcome
from sim.world.over_bus import How, drive_day
from sim.world.scenario import load_scenario, read_scenario
from sim.world.service import lay_out, make_day, scenario_files

MOST_SEEDS = 1_000_000
"""Largest number of seeds in one range; a larger range is taken for a typing error."""
STOP_COLUMNS = {f"stop_{one}": one for one in ("due_s", "arrived_s", "departed_s", "late_s")}
STOP_COLUMNS["stopping_error_m"] = "stopping_error_m"
PASSING_COLUMNS = ("passed_s", "late_s")
"""Figures of the stops: lists in the order in which the train comes to the stops."""
_services = ServiceMemory()
"""The services that a worker, which is a process, keeps between jobs."""
_SEEDS = re.compile(r"(\d{1,9})(?:-(\d{1,9}))?")


@dataclass(frozen=True, kw_only=True)
class BatchJob:
    """One run of a batch.

    `versions` are those of the program and the hashes of the input files; `record` is the file of its recording (None:
    it is not recorded).
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
        """The hash of everything that decides the result; a run with the same hash need not be made again."""
        level = None if self.level is None else str(self.level)
        decides = [self.name, str(self.friction), level, sorted(self.versions)]
        return hashlib.sha256(json.dumps(decides).encode()).hexdigest()

    @property
    def row(self) -> dict[str, Any]:
        """The columns that are known before the run is made."""
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
    def recording(self) -> JobRecording | None:
        """Where the run is recorded; None if it is not."""
        return None if self.record is None else JobRecording(self.record, self.command)

    @property
    def command(self) -> str:
        """The command that a recording of the run names as its origin."""
        return f"das-sim batch: {self.name}, inputs {self.inputs_sha256}"


@dataclass(frozen=True, kw_only=True)
class Batch:
    """The runs that the user asked for: every scenario with every driver, presentation and seed.

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
        """The runs in the order of the table; raises DasError for scenarios that cannot be run or share an id."""
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
    """Make a run; returns the row of its figures, raises DasError if the run cannot be made."""
    day = make_day(_services.of(read_scenario(job.scenario), job.level), job.seed, job.participant)
    how = How(driver=job.driver, friction=job.friction, advice=job.advice, train="train-1", command=job.command)
    run = whole_run(drive_day(day, day.driver(job.driver, job.friction), how, job.record), job.record)
    figures = outcome(day, run, job.driver).as_dict()
    stops, passings = figures.pop("stops"), figures.pop("passings")
    row = {
        **figures,
        "happens": described(day.disturbances),
        "drawn": json.dumps(day.drawn),
        "stops": [stop["name"] for stop in stops],
        **{column: [stop[name] for stop in stops] for column, name in STOP_COLUMNS.items()},
        "passings": [passing["name"] for passing in passings],
        **{f"passing_{name}": [passing[name] for passing in passings] for name in PASSING_COLUMNS},
        **{f"decision_{name}": [getattr(one, name) for one in run.decisions] for name in DriverEvent._fields},
    }
    return JobResult(row)


TEXTS = (
    *("scenario", "driver", "friction_policy", "population", "advice", "level"),
    *("error", "not_comparable", "happens", "drawn"),
    *("recording", "version"),
    *("code_sha256", "scenario_sha256", "route_sha256", "vehicle_sha256", "loss_map_sha256", "journey_sha256"),
    *("true_vehicle_sha256", "true_loss_map_sha256", "driver_sha256", "population_sha256", "inputs_sha256"),
)
COUNTS = (
    "participant",
    "advices_given",
    "advices_withdrawn",
    "advices_unheard",
    "advices_above_limit",
    "reversals",
    *("instructions", "missed_coasts", "vain_accelerations", "odd_speeds", "standing_acceleration_s"),
    *("above_limit_obeying_s", "hidden_limits", "last_word_acts"),
    "signals_passed",
    "simulated_s",
)
TRUTHS = ("advice_restless",)
FIGURES = (
    *("late_s", "running_time_s"),
    *("energy_kwh", "energy_at_stops_kwh", "energy_planned_kwh", "energy_optimum_kwh", "above_optimum_kwh"),
    "above_optimum_ratio",
    *("energy_blending_kwh", "energy_profile_kwh", "energy_own_braking_kwh"),
    *(f"{name}_kwh" for name in SHARES),
    *(f"{name}_ratio" for name in SHARES),
    *("kinetic_kwh", "potential_kwh", "ledger_residual_ratio", "beyond_signal_m", "over_limit_s", "over_limit_kmh"),
    *("advice_changes_per_min", "shortest_mode_s", "shortest_instruction_s"),
    *("announced_ratio", "brakes_led_ratio", "effort_changes_per_brake", "promises_kept_ratio", "availability_ratio"),
)


def write_table(path: Path, rows: Iterable[dict[str, Any]]) -> None:
    """Write the rows as Parquet; columns that a failed run does not have are null."""
    import pyarrow as pa
    from pyarrow import parquet

    table = pa.Table.from_pylist([{name: row.get(name) for name in COLUMNS} for row in rows], schema=_schema())
    content = io.BytesIO()
    parquet.write_table(table, content, compression="zstd")
    write_whole(path, content.getvalue())


COLUMNS = {
    "seed": "int64",
    **dict.fromkeys(TEXTS, "string"),
    **dict.fromkeys(COUNTS, "int64"),
    **dict.fromkeys(FIGURES, "float64"),
    **dict.fromkeys(TRUTHS, "bool"),
    "stops": "string list",
    **dict.fromkeys(STOP_COLUMNS, "float64 list"),
    "passings": "string list",
    **{f"passing_{name}": "float64 list" for name in PASSING_COLUMNS},
    "decision_time_s": "float64 list",
    "decision_what": "string list",
    "decision_value": "float64 list",
}
"""The columns of the table in their order, and what each holds, by Arrow's names of types."""


def _schema() -> Any:
    import pyarrow as pa

    def of(kind: str) -> Any:
        name, _, listed = kind.partition(" ")
        return pa.list_(pa.type_for_alias(name)) if listed else pa.type_for_alias(name)

    return pa.schema([(name, of(kind)) for name, kind in COLUMNS.items()])
