"""The runs of a batch, and the identity of each: the hash of everything that its result depends on."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from pathlib import Path

import das
import precompute
import sim
from das import __version__
from das.command_line.loading import warn_unusual
from das.domain.errors import DasError
from das.domain.losses import Level
from sim.drivers.cab import Presentation
from sim.drivers.kinds import DriverKind, FrictionPolicy, OwnClass
from sim.drivers.own_class import driver_versions
from sim.drivers.population import Participant
from sim.recording.inputs import sha256
from sim.world.scenario import load_scenario
from sim.world.service import lay_out, scenario_files

MOST_SEEDS = 1_000_000
"""Most seeds in one range; more are a slip of the finger."""
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


@dataclass(frozen=True, kw_only=True)
class Batch:
    """What the user asked for: every scenario with every driver, presentation and seed.

    With `participants`, the human driver stands for each of these persons.
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
            versions = {"version": __version__, "code_sha256": code_sha256()}
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


@cache
def code_sha256() -> str:
    """Hash of the program's own source, because another program may give other results."""
    digest = hashlib.sha256()
    for package in (das, precompute, sim):
        root = Path(str(package.__file__)).parent
        for path in sorted(root.rglob("*.py")):
            digest.update(f"{package.__name__}/{path.relative_to(root).as_posix()}\0".encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()
