"""`python -m docs.studies.real_trips [DATA]`: review of two real trips, for docs/results/0.2/real-trips.md.

DATA is the folder with the public data sets (trips, ttobench), by default ../shared/data. The tables of the page and
real-trips-*.png next to it are written; the data are not copied.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure

from das.bus.recording import read_recording
from das.command_line.files import save_figure
from das.domain.files.load import load_route, load_vehicle
from das.domain.restriction import Restriction
from das.domain.units import KM, KWH, kmh, kwh
from das.drawing.colors import LINES, SEVERAL
from das.solver.section import build_section
from das.solver.solve import solve_front
from docs.studies.output import DOCS, write_table
from sim.drive.attribution import Attribution
from sim.drive.causes import EnergyCause
from sim.drive.drive import Drive
from sim.drive.legs import LikelyRange, likely_range
from sim.meanings import LIGHT, Meaning
from sim.options import ReplayOptions, TripOptions
from sim.recording.opening import DriveInputs
from sim.review.pictures import INK, light_figure, named, page_legend
from sim.runs.replay import prepare, replay
from tests.support.benchmark import SHARED

PAGE: Final = DOCS / "results" / "0.2" / "real-trips.md"
PICTURES: Final = PAGE.parent
TRIPS: Final = {"29 July 2016": "kolback_vasteras_clean.csv", "5 August 2016": "kolback_vasteras_dropouts.csv"}
ROUTE, POSTS = "SE_Vasteras_Kolback.json", "kolback_vasteras_kmposts.csv"
TRAINS: Final = {
    "KISS": "CH_Stadler_KISS_SBB.json",
    "FLIRT": "CH_Stadler_FLIRT_TPF.json",
    "VIRM6": "NL_Intercity_VIRM6.json",
}
"""Trains that may have run the trips, by their files in ttobench/trains; the true train is unknown."""
FIRST: Final = "KISS"
LIMIT: Final = LIGHT.of[Meaning.LIMIT]
ENTRY_M: Final = 18_000.0
"""Position (m) from which both trips were much slower than the line allows, possibly because of an obstruction."""
LEAST_J: Final = 0.5 * KWH
"""Energy (J) below which a cause has no row, if it is below on every trip."""
PARTS: Final = (("start", 0.0, 3.0), ("middle", 3.0, 16.0), ("end", 16.0, 20.0))
"""Parts of the line (km from Kolbäck)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TripAttribution:
    """The energy attribution of one trip with one possible train."""

    trip: str
    train: str
    attribution: Attribution
    likely: LikelyRange
    entry_j: float
    """Energy (J) above an optimum as slow as the trip from `ENTRY_M` on, that is, without the part explained by a slow
    entry."""

    @property
    def possible(self) -> bool:
        """Whether the train could have run the trip in its time."""
        return not self.attribution.above.why_not

    @property
    def above_ratio(self) -> float:
        """The energy above the optimum as a share of the optimum."""
        return self.attribution.above.difference_j / self.attribution.above.optimum_j


def trip_attributions(data: Path) -> list[TripAttribution]:
    """Replay each trip and attribute its energy, with each train; DasError for a missing file or an impossible run."""
    found = []
    route_file = data / "ttobench" / "tracks" / ROUTE
    route = load_route(route_file).reversed()
    for trip, name in TRIPS.items():
        with tempfile.TemporaryDirectory(prefix="das-real-trips-") as folder:
            out = Path(folder) / "trip.mcap"
            options = TripOptions(
                route=str(route_file), vehicle=str(_train(data, FIRST)), reverse=True, posts=data / "trips" / POSTS
            )
            job = prepare(data / "trips" / name, ReplayOptions(trip=options), out, "python -m docs.studies.real_trips")
            replay(job, lambda _tick, _ticks: None)
            recording = read_recording(out)
            for train in TRAINS:
                print(f"{trip}, {train} …", flush=True)
                vehicle = load_vehicle(_train(data, train))
                level = vehicle.default_level
                inputs = DriveInputs(route=route, vehicle=vehicle, level=level, source=train)
                drive = Drive(recording=recording, given=inputs)
                attribution = drive.energy.any_attribution
                likely = likely_range(attribution.legs, drive.energy.smoothed)
                entry_j = above_slow_entry_j(attribution)
                found.append(
                    TripAttribution(trip=trip, train=train, attribution=attribution, likely=likely, entry_j=entry_j)
                )
    return found


def above_slow_entry_j(attribution: Attribution) -> float:
    """The energy (J) above an optimum that is no faster than the trip from `ENTRY_M` on, as for a forced slow entry."""
    (leg,) = attribution.legs
    motion, section = leg.leg.motion, leg.optimum.section
    slow_mps = float(motion.speed_mps[motion.s_m >= ENTRY_M].max())
    slow = Restriction(start_m=ENTRY_M, end_m=section.route.length_m, limit_mps=slow_mps)
    other = build_section(section.route.with_restrictions([slow]), section.vehicle, level=section.level)
    return leg.driven_j - solve_front(other).trajectory(leg.leg.trip_s).balance.input


def _train(data: Path, train: str) -> Path:
    return data / "ttobench" / "trains" / TRAINS[train]


def above_table(found: Sequence[TripAttribution]) -> Iterator[str]:
    """The energy of the trips above the optimum, by trip and train."""
    wanted = ("driven", "optimum", "above it", "likely", "if the entry had to be slow", "if friction braked")
    yield f"| trip | train assumed | {' | '.join(wanted)} |"
    yield "|---|---|---:|---:|---:|---:|---:|---:|"
    for one in found:
        attribution, likely = one.attribution, one.likely
        if not one.possible:
            (leg,) = attribution.legs
            why = f"its least time is {leg.optimum.least_time_s:.0f} s, the trip took {leg.leg.trip_s:.0f} s"
            yield f"| {one.trip} | {one.train} | not possible with this train: {why} | | | | | |"
            continue
        low, high = kwh(likely.low_j), kwh(likely.high_j)
        friction = "–" if np.isnan(likely.by_friction_j) else f"{kwh(likely.by_friction_j):.0f} kWh"
        driven, optimum = kwh(attribution.above.driven_j), kwh(attribution.above.optimum_j)
        saved = f"{kwh(attribution.above.difference_j):.0f} kWh ({one.above_ratio:.0%})"
        cells = (f"{driven:.0f} kWh", f"{optimum:.0f} kWh", saved, f"{low:.0f} to {high:.0f} kWh")
        yield f"| {one.trip} | {one.train} | {' | '.join(cells)} | {kwh(one.entry_j):.0f} kWh | {friction} |"


def cause_table(found: Sequence[TripAttribution]) -> Iterator[str]:
    """The energy above the optimum by cause, as a range over the assumed trains."""
    yield f"| cause | {' | '.join(TRIPS)} |"
    yield f"|---|{'---:|' * len(TRIPS)}"
    for cause in EnergyCause:
        if all(abs(_of(one, cause)) < LEAST_J for one in found):
            continue
        cells = (_ends([_of(one, cause) for one in found if one.trip == trip]) for trip in TRIPS)
        yield f"| {cause.label} | {' | '.join(cells)} |"


def _of(one: TripAttribution, cause: EnergyCause) -> float:
    return one.attribution.by_cause.get(cause, 0.0)


def place_table(found: Sequence[TripAttribution]) -> Iterator[str]:
    """The energy lost above the optimum by part of the line, as a range over the assumed trains."""
    yield f"| part of the way | {' | '.join(TRIPS)} |"
    yield f"|---|{'---:|' * len(TRIPS)}"
    for name, start_km, end_km in PARTS:
        upto = min(end_km, 19.3)
        cells = (
            _ends([_lost_j(one, start_km * KM, end_km * KM) for one in found if one.trip == trip]) for trip in TRIPS
        )
        yield f"| {name}, km {start_km:g} to {upto:g} | {' | '.join(cells)} |"


def _lost_j(one: TripAttribution, start_m: float, end_m: float) -> float:
    (leg,) = one.attribution.legs
    middle_m = 0.5 * (leg.even.start_m + leg.even.end_m)
    return float(leg.even.lost_more_j[(middle_m >= start_m) & (middle_m < end_m)].sum())


def _ends(energies_j: Sequence[float]) -> str:
    low, high = (round(kwh(end(energies_j))) for end in (min, max))
    return f"{low} kWh" if low == high else f"{low} to {high} kWh"


def trip_figure(found: Sequence[TripAttribution]) -> Figure:
    """One trip: speeds with the optima, and the cumulative energy lost above them, for each train."""
    figure, (speed, lost) = light_figure((2.8, 2.0))
    for i, one in enumerate(found):
        (leg,) = one.attribution.legs
        run, motion = leg.optimum.trajectory, leg.leg.motion
        if i == 0:
            section = leg.optimum.section
            speed.step(section.node_m / KM, _held(kmh(section.limit_mps), section.node_m), where="post", color=LIMIT,
                       linewidth=1.0, label="limit")  # fmt: skip
            speed.plot(motion.s_m / KM, kmh(motion.speed_mps), color=INK, linewidth=1.6, label="driven")
        style: dict[str, Any] = {"color": SEVERAL[i], "linestyle": LINES[i], "linewidth": 1.3}
        speed.plot(run.s_m / KM, kmh(run.v_mps), label=f"optimum, {one.train}", **style)
        upto = np.concatenate(([0.0], np.cumsum(kwh(leg.even.lost_more_j))))
        at_km = np.concatenate((leg.even.start_m, leg.even.end_m[-1:])) / KM
        lost.plot(at_km, upto, label=one.train, **style)
    lost.axhline(0.0, color=INK, linewidth=0.7)
    speed.set_ylim(bottom=0.0)
    named(speed, y="speed, km/h")
    named(lost, x="position, km from Kolbäck", y="lost above the optimum,\nsummed, kWh")
    page_legend(speed, columns=5)
    return figure


def _held(values: Any, nodes_m: Any) -> Any:
    """Values of intervals at their first nodes, with the last value repeated at the end."""
    return values if len(values) == len(nodes_m) else np.append(values, values[-1])


def above_figure(found: Sequence[TripAttribution]) -> Figure:
    """The energy above the optimum of each trip with each train: the estimate, its likely range, and the worst case."""
    figure, (axis,) = light_figure((2.6,))
    for row, one in enumerate(found[::-1]):
        low, high = kwh(one.likely.low_j), kwh(one.likely.high_j)
        first = row == 0
        axis.plot([low, high], [row, row], color=SEVERAL[0], linewidth=5.0, alpha=0.45, solid_capstyle="butt",
                  label="likely" if first else None)  # fmt: skip
        axis.plot(
            kwh(one.attribution.above.difference_j), row, "o", color=SEVERAL[0], label="estimate" if first else None
        )
        axis.plot(kwh(one.entry_j), row, "s", markerfacecolor="none", color=SEVERAL[2],
                  label="if the entry had to be slow" if first else None)  # fmt: skip
        if not np.isnan(one.likely.by_friction_j):
            axis.plot(kwh(one.likely.by_friction_j), row, "D", markerfacecolor="none", color=SEVERAL[1],
                      label="if friction did all braking" if first else None)  # fmt: skip
    axis.set_yticks(range(len(found)), [f"{one.trip}, {one.train}" for one in found[::-1]])
    axis.set_xlim(left=0.0)
    axis.grid(visible=False, axis="y")
    named(axis, x="energy above the optimum for the same times, kWh")
    page_legend(axis)
    return figure


def main() -> None:
    """Make the tables and the pictures again."""
    parser = argparse.ArgumentParser(prog="python -m docs.studies.real_trips", description=__doc__)
    parser.add_argument("data", type=Path, nargs="?", default=SHARED, help="Folder of the data sets.")
    found = trip_attributions(parser.parse_args().data)
    possible = [one for one in found if one.possible]
    for name, lines in (
        ("above", above_table(found)),
        ("causes", cause_table(possible)),
        ("places", place_table(possible)),
    ):
        write_table(PAGE, name, lines)
    save_figure(PICTURES / "real-trips-above.png", above_figure(possible))
    for number, trip in enumerate(TRIPS, start=1):
        of_trip = [one for one in possible if one.trip == trip]
        save_figure(PICTURES / f"real-trips-{number}.png", trip_figure(of_trip))


if __name__ == "__main__":
    main()
