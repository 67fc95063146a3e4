"""`python -m docs.studies.own_lines [DATA]`: import of real lines, and the effect of altitudes on energies.

It writes docs/results/0.2/lines.md.

DATA is the folder with the public data (lines), by default ../shared/data. The tables of the page and own-line-*.png
next to it are written; the data are not copied.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from das.domain.files.load import load_route, load_vehicle
from das.domain.route import Altitudes, Floats, Route, Stretches
from das.domain.units import KM, PERCENT, PERMILLE, kmh, kwh
from das.solver.section import build_section
from das.solver.solve import solve_front
from docs.studies.output import DOCS, write_table
from precompute.cli.route_report import draw_line
from precompute.route_import import imported
from precompute.route_import.altitudes import climb_and_fall_m, with_altitudes
from precompute.route_import.line import ImportedLine, ImportOrder, Words
from precompute.route_import.tables import LineTable
from tests.support.benchmark import SHARED

PAGE: Final = DOCS / "results" / "0.2" / "lines.md"
PICTURES: Final = PAGE.parent
BUFFER: Final = 1.07
NOISE_M, NOISE_LENGTH_M, EVERY_M, SEEDS = 4.0, 250.0, 50.0, (1, 2, 3, 4)
"""Noise of altitudes: standard deviation (m) and spacing (m) of points joined by straight lines."""
TRAIN: Final = "re460-ic"


class RealLine(NamedTuple):
    """A real line in the data folder: its files, its ends, and the credit that its licence requires."""

    files: tuple[str, ...]
    start: str
    end: str
    words: Words
    picture: str = ""
    flat: bool = True
    """Whether the files have no gradients."""


REAL_LINES: Final = (
    RealLine(
        ("osm/sankt_poelten_overpass.json",),
        "St. Pölten=48.2083,15.6237",
        "Melk=48.2242,15.3499",
        Words(),
        "own-line-osm.png",
    ),
    RealLine(
        ("railtoolkit/realworld.yaml",),
        "Görlitz",
        "Dresden",
        Words(source="TrainRuns.jl, after FBS and railML.org", licence="ISC"),
        "own-line-tables.png",
        flat=False,
    ),
    RealLine(
        ("sncf/lignes-vitesses-830000-752000.geojson",),
        "Paris=48.84405,2.37615",
        "Lyon=45.7485,4.826",
        Words(source="SNCF Réseau", licence="ODbL"),
    ),
)


def line_of(data: Path, source: RealLine) -> Route:
    """A real line, imported as by a user."""
    files = [data / "lines" / name for name in source.files]
    return imported(files, ImportOrder(start=source.start, end=source.end, flat=source.flat), source.words).route


def line_table(lines: list[Route]) -> Iterator[str]:
    """The imported data of each line."""
    yield (
        "| line | data | km | number of limits | km/h | number of gradients | ‰ | climb and fall, m | tunnels, km "
        "| points of geometry |"
    )
    yield "|---|---|---:|---:|---|---:|---|---|---:|---:|"
    for line in lines:
        limits, gradients = line.limits_mps.value, line.gradients_ratio.value / PERMILLE
        climb_m, fall_m = climb_and_fall_m(line)
        hilly = line.altitudes is not Altitudes.NONE
        steep = f"{gradients.max():+.1f} to {gradients.min():+.1f}" if hilly else "flat"
        slowest, fastest = kmh(float(limits.min())), kmh(float(limits.max()))
        yield (
            f"| {line.name} | {line.credit} | {line.length_m / KM:.3f} | {len(limits)} | {slowest:.0f} to "
            f"{fastest:.0f} | {len(gradients) if hilly else 0} | {steep} | "
            f"{f'{climb_m:.1f} and {fall_m:.1f}' if hilly else '–'} | "
            f"{sum(x.length_m for x in line.tunnels) / KM:.2f} | {len(line.geometry_position_m)} |"
        )


class KnownSection(NamedTuple):
    """A section of a line with known altitudes, by the numbers of its stops."""

    route: Route
    first: int
    last: int

    @property
    def name(self) -> str:
        """The names of the two ends."""
        return f"{self.route.stops[self.first].name} – {self.route.stops[self.last].name}"

    def energy_j(self, line: Route, time_s: float | None = None) -> tuple[float, float]:
        """Least energy (J) of the section on a variant of its line, and its time (s; None: 7 % above the minimum)."""
        ends = (self.route.stops[i].position_m for i in (self.first, self.last))
        front = solve_front(build_section(line, load_vehicle(TRAIN), start_m=next(ends), end_m=next(ends)))
        wanted_s = BUFFER * front.fastest().time_s if time_s is None else time_s
        return front.trajectory(wanted_s).balance.input, wanted_s

    def with_altitudes(self, at_m: Floats, altitude_m: Floats, order: ImportOrder) -> Route:
        """The line with gradients derived from altitudes as in an import."""
        numbers = {"position": tuple(at_m.tolist()), "altitude": tuple(altitude_m.tolist())}
        table = LineTable(path=Path("altitudes.csv"), lines=tuple(range(len(at_m))), numbers=numbers)
        return with_altitudes(ImportedLine(route=self.route, structures=self.route.tunnels), table, order).route


def altitude_table(sections: Sequence[KnownSection]) -> Iterator[str]:
    """The error of the energy of each section with poorer altitudes, at the same trip time."""
    yield "| section | true altitudes | flat | altitudes of the stops | 4 m of noise, raw | smoothed over 2 km |"
    yield "|---|---:|---:|---:|---:|---:|"
    for section in sections:
        true_j, time_s = section.energy_j(section.route)

        def wrong(line: Route, one: KnownSection = section, right_j: float = true_j, in_s: float = time_s) -> float:
            return (one.energy_j(line, in_s)[0] / right_j - 1.0) / PERCENT

        flat = replace(section.route, gradients_ratio=Stretches.constant(0.0))
        stops_m = np.array([stop.position_m for stop in section.route.stops])
        few = section.with_altitudes(stops_m, section.route.altitude_m(stops_m), ImportOrder())
        noisy = [list(map(wrong, both)) for both in noisy_lines(section)]
        raw, smooth = zip(*noisy, strict=True)
        ranges = [f"{min(values):+.1f} to {max(values):+.1f} %" for values in (raw, smooth)]
        off = [f"{wrong(flat):+.1f} %", f"{wrong(few):+.1f} %", *ranges]
        yield f"| {section.name} | {kwh(true_j):.1f} kWh | {' | '.join(off)} |"


def noisy_lines(section: KnownSection) -> Iterator[tuple[Route, Route]]:
    """The line from noisy altitudes, raw and smoothed, for each seed."""
    at_m = np.arange(0.0, section.route.length_m, EVERY_M)
    knots_m = np.arange(0.0, section.route.length_m + NOISE_LENGTH_M, NOISE_LENGTH_M)
    for seed in SEEDS:
        noise_m = NOISE_M * np.random.default_rng(seed).standard_normal(len(knots_m))
        altitude_m = section.route.altitude_m(at_m) + np.interp(at_m, knots_m, noise_m)
        yield (
            section.with_altitudes(at_m, altitude_m, ImportOrder(smooth_m=0.0)),
            section.with_altitudes(at_m, altitude_m, ImportOrder()),
        )


def main() -> None:
    """Import the lines, compute the energies, and write tables and pictures."""
    parser = argparse.ArgumentParser(description="Import of real lines, and the effect of altitudes on energies.")
    parser.add_argument("data", nargs="?", type=Path, default=SHARED)
    data = parser.parse_args().data
    lines = [line_of(data, source) for source in REAL_LINES]
    write_table(PAGE, "lines", line_table(lines))
    for line, source in zip(lines, REAL_LINES, strict=True):
        if source.picture:
            draw_line(line).save(PICTURES / source.picture, overwrite=True)
    bundled = load_route("zurich-luzern")
    sections = [KnownSection(bundled, i, i + 1) for i in range(3)]
    write_table(PAGE, "altitudes", altitude_table([*sections, KnownSection(lines[1], 0, 1)]))


if __name__ == "__main__":
    main()
