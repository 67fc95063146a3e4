"""Success rate in finding the train of a record: 20 simulated drives of five trains with planted load and resistance.

A human driver without advice drives each train on the bundled line, on four journeys. A noisy GPS receiver records the
drive, and `find_train` tries all bundled trains on the record. `python -m docs.studies.planted_trains` updates the
table in docs/results/0.2/find-train.md, in about 6 min on one core.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from das.domain.files.load import load_route
from das.domain.units import MS
from docs.studies.output import DOCS, write_table
from sim.drivers.drivers import make_driver
from sim.drivers.kinds import DriverKind, Presentation
from sim.options import TripOptions
from sim.plant.kernels import PlantState
from sim.trips.find_train import FoundTrain, candidates, find_train, shares
from sim.trips.record import read_trip
from sim.trips.trip import Trip, load_trip
from sim.world.in_process import InProcess
from sim.world.loop import World
from sim.world.scenario import read_scenario
from sim.world.service import make_day, prepare_service

PAGE: Final = DOCS / "results" / "0.2" / "find-train.md"
LINE: Final = "zurich-luzern"
TRAINS: Final = (
    "re460-ic", "CH_Stadler_KISS_SBB", "CH_Stadler_FLIRT_TPF", "NL_Intercity_VIRM6", "CN_Beijing_Subway",
)  # fmt: skip
JOURNEYS: Final = ((None, None, False), (None, None, True), ("Zürich HB", "Zug", False), ("Luzern", "Thalwil", True))
"""Journeys: first stop, last stop, and whether the train runs from the line's end to its start."""
MASS_RATIOS, RESISTANCE_RATIOS = (0.9, 1.2), (0.85, 1.2)
"""Ranges of mass and resistance, relative to the file, from which the values of a drive are drawn uniformly."""
POSITION_SD_M, POSITION_MEMORY_S = 3.0, 30.0
"""Noise of the receiver's positions: standard deviation and correlation time."""
SPEED_SD_MPS: Final = 0.1
EPOCH_S: Final = 1_700_000_000


@dataclass(frozen=True, kw_only=True, eq=False)
class Planted:
    """A simulated drive of a known train, and the trains found for it, the most probable first."""

    train: str
    journey: str
    mass_ratio: float
    resistance_ratio: float
    found: tuple[FoundTrain, ...]

    @property
    def true(self) -> FoundTrain:
        """The result for the true train."""
        return next(one for one in self.found if self.train in one.names)

    @property
    def rank(self) -> int:
        """The rank of the true train, 1 for the first."""
        return 1 + self.found.index(self.true)

    @property
    def off_ratios(self) -> tuple[float, float]:
        """The relative errors of the mass and the resistance found."""
        return self.true.mass_ratio / self.mass_ratio - 1.0, self.true.resistance_ratio / self.resistance_ratio - 1.0


def planted_drives(trains: Sequence[str] = TRAINS, journeys: Iterable[int] = range(len(JOURNEYS))) -> Iterator[Planted]:
    """Drive each train on each journey (by its number), and find the trains again."""
    tried = candidates("all")
    chosen = tuple(journeys)
    for train in trains:
        for number in chosen:
            seed = 10 * TRAINS.index(train) + number
            rng = np.random.default_rng(seed)
            mass, resistance = (round(float(rng.uniform(*ends)), 2) for ends in (MASS_RATIOS, RESISTANCE_RATIOS))
            with tempfile.TemporaryDirectory(prefix="das-planted-") as folder:
                day = _scenario(train, number, mass, resistance)
                trip = record_of(Path(folder), _driven(Path(folder), day, seed), number, rng)
                yield Planted(
                    train=train,
                    journey=f"{trip.start.name} – {trip.end.name}",
                    mass_ratio=mass,
                    resistance_ratio=resistance,
                    found=find_train(trip, tried),
                )


def _scenario(train: str, number: int, mass: float, resistance: float) -> str:
    start, end, reverse = JOURNEYS[number]
    ends = "".join(f'{key} = "{stop}"\n' for key, stop in (("from", start), ("to", end)) if stop is not None)
    return (
        f'schema_version = 1\n[scenario]\nid = "planted"\ntitle = "Planted"\nroute = "{LINE}"\nvehicle = "{train}"\n'
        f"reverse = {str(reverse).lower()}\n{ends}[timetable]\nbuffer_percent = 8\n"
        f"[truth]\nmass_ratio = {mass}\nresistance_ratio = {resistance}\n"
    )


def _driven(folder: Path, scenario: str, seed: int) -> tuple[PlantState, ...]:
    """The states of a simulated drive without advice."""
    path = folder / "planted.toml"
    path.write_text(scenario, encoding="utf-8")
    service = prepare_service(read_scenario(path))
    driver = make_driver(DriverKind.HUMAN, service.line, seed=seed)
    return World(make_day(service, seed), driver, Presentation.NONE, InProcess(service)).run().states


def record_of(folder: Path, states: Sequence[PlantState], number: int, rng: np.random.Generator) -> Trip:
    """The trip recorded by a noisy GPS receiver, one point a second, cleaned and matched."""
    start, end, reverse = JOURNEYS[number]
    file = load_route(LINE)
    driven = file.reversed() if reverse else file
    whole = np.arange(math.ceil(states[0].time_s), math.floor(states[-1].time_s) + 1)
    time_s, s_m, speed_mps = (np.array([getattr(one, key) for one in states]) for key in ("time_s", "s_m", "speed_mps"))
    s_m, speed_mps = (np.interp(whole, time_s, values) for values in (s_m, speed_mps))
    kept, off_m = math.exp(-1.0 / POSITION_MEMORY_S), 0.0
    rows = ["time_ms,latitude_deg,longitude_deg,speed_mps"]
    for second, place_m, true_mps in zip(whole, s_m, speed_mps, strict=True):
        off_m = kept * off_m + POSITION_SD_M * math.sqrt(1.0 - kept**2) * float(rng.standard_normal())
        read_mps = max(true_mps + SPEED_SD_MPS * float(rng.standard_normal()), 0.0) if true_mps > 0 else 0.0
        where = driven.location_deg(place_m + (off_m if true_mps > 0 else 0.0))
        assert where is not None  # the bundled line has geometry
        rows.append(f"{(EPOCH_S + second) / MS:.0f},{where[0]:.7f},{where[1]:.7f},{read_mps:.3f}")
    path = folder / "planted.csv"
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return load_trip(path, read_trip(path), file, TripOptions(reverse=reverse, from_stop=start, to_stop=end))


def train_row(drives: Sequence[Planted]) -> str:
    """The row of the drives of one train."""
    train, count = drives[0].train, len(drives)
    likely = [100.0 * shares(one.found).get(one.true.names[0], 0.0) for one in drives]
    mass, resistance = (100.0 * max(map(abs, off)) for off in zip(*(one.off_ratios for one in drives), strict=True))
    return (
        f"| {train} | {sum(one.rank == 1 for one in drives)} of {count} | {min(likely):.0f} to {max(likely):.0f} % | "
        f"{mass:.0f} % | {resistance:.0f} % | {sum(one.true.mass_known for one in drives)} of {count} |"
    )


def planted_table(drives: Sequence[Planted]) -> Iterator[str]:
    """The lines of the table, in Markdown, and a summary."""
    yield (
        "| train that drove | found first | its probability | mass off, at most | resistance off, at most | "
        "mass shown by the record |"
    )
    yield "|---|---:|---:|---:|---:|---:|"
    for train in TRAINS:
        yield train_row([one for one in drives if one.train == train])
    yield ""
    known = [one for one in drives if one.true.mass_known]
    near, near_known = (sum(abs(one.off_ratios[0]) <= 0.1 for one in some) for some in (drives, known))
    yield (
        f"The train that drove is among the possible ones in {sum(one.true.possible for one in drives)} of "
        f"{len(drives)} drives, and first in {sum(one.rank == 1 for one in drives)}. Its mass is found within 10 % in "
        f"{near} of {len(drives)}, and in {near_known} of the {len(known)} in which the record shows it."
    )


if __name__ == "__main__":
    write_table(PAGE, "planted", planted_table(list(planted_drives())))
