"""The cells of the matrix of any train on any line: generated extremes, bundled lines, and public data sets."""

from __future__ import annotations

import os
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple

from das.domain.files.load import catalogue, locate_route, locate_vehicle
from precompute.vehicle_import import import_train
from sim.world.scenario import read_scenario
from sim.world.service import Service, prepare_service
from tests.support.benchmark import DATA, SHARED, track_path

BUFFER_PERCENT, DWELL_S = 8, 30
Rows = Sequence[tuple[float, float]]
"""Rows of a table of a route file: a position (km) and a value."""


class Who(StrEnum):
    """The drivers of the matrix."""

    OBEDIENT = "obedient"
    """Driver who follows only the card, without regard to limits, boards or signals."""
    HUMAN = "human"
    CARELESS = "careless"
    """Driver who looks every 10 to 20 s, acts 3 s late, ignores a third of the advice and brakes a fifth too weakly."""


class Cell(NamedTuple):
    """A run of the matrix; `line` and `train` are names in `LINES`, `TRAINS`, or those of files."""

    line: str
    train: str
    who: Who
    seed: int

    def __str__(self) -> str:
        return f"{self.line}, {self.train}, {self.who}, seed {self.seed}"


def _line(
    stops_km: Sequence[float], limits: Rows, permille: Rows = ((0, 0),), *,
    neutral: Rows = (), no_regeneration: Rows = (),
) -> str:  # fmt: skip
    """The text of a route file: limits (km, km/h), gradients (km, ‰), and stretches of the supply (km, length in m)."""

    def table(name: str, column: str, rows: Rows) -> str:
        return f'[{name}]\ncolumns = ["position_km", "{column}"]\nrows = {[list(row) for row in rows]}\n'

    text = f"length_km = {float(stops_km[-1])}\n"
    text += "".join(f'[[stops]]\nname = "S{i}"\nposition_km = {float(km)}\n' for i, km in enumerate(stops_km))
    text += table("speed_limits", "limit_kmh", limits) + table("gradients", "gradient_permille", permille)
    text += table("neutral_sections", "length_m", neutral) if neutral else ""
    return text + (table("no_regeneration", "length_m", no_regeneration) if no_regeneration else "")


def _train(
    figures: tuple[float, float, float], held: tuple[float, float, float], pulls: tuple[float, float],
    electric: tuple[float, float] | None, friction_kn: float | None, service: tuple[float, float],
) -> str:  # fmt: skip
    """The text of a vehicle file: mass (t), length (m), top speed (km/h); resistance (kN, m/s); traction and electric
    brake (kN, kW); friction brake; the deceleration (m/s²) and build-up (s) of service braking.
    """
    mass_t, length_m, top_kmh = figures
    text = f"mass_t = {mass_t}\nrotating_mass_ratio = 0.06\nlength_m = {length_m}\nmax_speed_kmh = {top_kmh}\n"
    text += "[resistance]\nc0_kn = {}\nc1_kn_per_mps = {}\nc2_kn_per_mps2 = {}\n".format(*held)
    text += "[traction]\nmax_force_kn = {}\nmax_power_kw = {}\n".format(*pulls)
    text += "[electric_brake]\nmax_force_kn = {}\nmax_power_kw = {}\n".format(*electric) if electric else ""
    text += f"[friction_brake]\nmax_force_kn = {friction_kn}\n" if friction_kn else ""
    both = "blended" if electric else "friction"
    text += f'[brakes]\npolicy = "{both if friction_kn else "electric"}"\n'
    text += "[service_brake]\ndeceleration_mps2 = {}\nbuild_up_s = {}\n".format(*service)
    return text + '[losses]\ndefault = "own"\n[losses.own]\nmean_efficiency_ratio = 0.85\nidle_kw = 20\n'


_METRO = [(k * 1.2 + at, slope) for k in range(4) for at, slope in ((0.2, -30), (0.4, 0), (0.9, 30), (1.15, 0))]
_KMH = (90, 60, 140, 40, 120, 70, 100, 50, 80, 140)
LINES = {
    "tram": _line((0, 0.4, 0.7, 1.2, 1.55, 2, 2.4), [(0, 50), (0.55, 25), (0.63, 50), (1.3, 15), (1.34, 50), (2.2, 30)],
                  [(0, 0), (0.6, 40), (0.9, -35), (1.4, 0), (2, 40)]),
    "short900": _line((0, 0.9, 1.8, 2.7), [(0, 80), (1, 60), (1.5, 100)], [(0, 0), (0.9, 10), (1.3, -10)]),
    "metro12": _line((0, 1.2, 2.4, 3.6, 4.8), [(0, 80), (2.9, 60), (3.4, 80)], [(0, 0), *_METRO]),
    "platform30": _line((0, 4), [(0, 120), (3.88, 30)]),
    "limstop": _line((0, 5, 10, 15), [(0, 120), (4.94, 40), (5.05, 120), (9.75, 30), (10.1, 140), (14.995, 20)],
                     [(0, 0), (3, 6), (7, -8), (12, 0)]),
    "limits30": _line((0, 10), [(round(i / 3, 3), _KMH[i % 10] + 10 * (i // 10)) for i in range(30)],
                      [(0, 0), (2, 8), (4, -6), (7, 12), (8.5, -12)]),
    "brow": _line((0, 4), [(0, 80)], [(0, 0), (0.8, -28), (3.2, 0)]),
    "gradestop": _line((0, 3, 6, 9), [(0, 100)], [(0, 0), (2, -25), (3.6, 0), (5, 25), (6.5, -20), (8, -30)]),
    "neutralstop": _line((0, 6, 12), [(0, 120), (4, 100), (8, 140)], [(0, 0), (5.2, -8), (6, 0), (10.8, -12)],
                         neutral=[(5.6, 250), (8, 300), (11.5, 300)], no_regeneration=[(2.5, 1500)]),
    "mountain": _line((0, 8, 12, 18), [(0, 60), (2, 50), (4, 40), (5, 55), (9, 45), (12.4, 60), (14, 40), (15, 55)],
                      [(0, 0), (0.4, 25), (1.5, 40), (7.6, 5), (8.2, 38), (11.7, 2), (12.3, -40), (17.6, 0)]),
    "descent": _line((0, 13), [(0, 80), (6, 60), (12.5, 50)], [(0, 0), (0.8, -20), (12.2, 0)]),
    "rolling": _line((0, 14, 28), [(0, 100), (8, 90), (12, 110), (21, 80), (24, 120)],
                     [(km, (12, -12)[km % 2]) for km in range(28)]),
    "hs300": _line((0, 61), [(0, 80), (1.5, 160), (4, 300), (30, 270), (34, 300), (57, 230), (60, 100)],
                   [(0, 0), (6, 10), (12, -8), (18, 25), (22, -25), (26, 0), (31, 35), (33, -35), (36, 0)],
                   neutral=[(9, 400), (24, 400), (44, 800), (59.2, 300)]),
    "hill": _line((0, 8), [(0, 80)], [(0, 0), (2, 35), (6, 0)]),
}  # fmt: skip
"""The generated lines: extremes."""
TRAINS = {
    "tram": _train((42, 32, 70), (0.6, 0.01, 0.0035), (55, 600), (50, 700), 60, (1.1, 0.8)),
    "metro": _train((220, 120, 80), (3, 0.02, 0.012), (260, 3600), (240, 3900), 260, (0.9, 1.2)),
    "no-electric": _train((180, 80, 120), (3, 0.04, 0.009), (120, 1600), None, 200, (0.6, 2.5)),
    "no-friction": _train((120, 60, 140), (2.2, 0.03, 0.008), (150, 2400), (130, 2400), None, (0.7, 1)),
    "freight1600": _train((1600, 520, 100), (22, 0.15, 0.055), (300, 5600), (150, 2600), 320, (0.15, 6)),
    "high-speed": _train((420, 200, 320), (4, 0.11, 0.0068), (280, 9200), (220, 6000), 420, (0.55, 2)),
    "railcar": _train((60, 26, 100), (1, 0.015, 0.005), (60, 400), None, 60, (0.6, 2)),
}
"""The generated trains: a light and a heavy one, one without an electric and one without a friction brake."""
KISS, FLIRT, VIRM, METRO = "CH_Stadler_KISS_SBB", "CH_Stadler_FLIRT_TPF", "NL_Intercity_VIRM6", "CN_Beijing_Subway"
IMPORTED = {"br642": (DATA / "railtoolkit" / "br642.yaml", "0.3"),
            "railtoolkit-freight": (SHARED / "lines" / "railtoolkit" / "freight.yaml", "0.85"),
            "railtoolkit-intercity": (SHARED / "lines" / "railtoolkit" / "longdistance.yaml", "0.85")}  # fmt: skip
"""Rolling stock of railtoolkit, with its losses."""
GOERLITZ = "goerlitz-dresden"
PAIRS = (
    ("platform30", "re460-ic"), ("tram", "tram"), ("brow", "no-electric"), ("short900", FLIRT), ("metro12", "metro"),
    ("zurich-luzern", "re460-ic"), ("limstop", "no-electric"), ("limits30", "no-electric"),
    ("gradestop", "no-friction"), ("neutralstop", "re460-ic"), ("mountain", "railcar"),
    ("descent", "freight1600"), ("hs300", "high-speed"),
    ("CH_Fribourg_Bern", FLIRT), ("CH_StGallen_Wil", KISS), ("CH_Stadelhofen_Altstetten", KISS),
    ("CN_Songjiazhuang_Yizhuang", METRO), ("SE_Vasteras_Kolback", VIRM), (GOERLITZ, "br642"),
    ("00_var_speed_limit_100", VIRM), ("rolling", "freight1600"), ("limstop", "re460-ic"), ("platform30", FLIRT),
    ("gradestop", FLIRT), ("limits30", FLIRT), ("mountain", "no-electric"), ("short900", "no-electric"),
    ("neutralstop", "no-friction"), ("limstop", "freight1600"), ("metro12", METRO), ("zurich-luzern", KISS),
    ("00_var_gradient_minusplus_6", VIRM), ("00_reference_with_tunnels", FLIRT), ("00_var_gradient_plus_10", FLIRT),
    ("00_var_gradient_minus_10", KISS), ("00_var_speed_limit_wind", FLIRT),
    ("CH_StGallen_Wil", "railtoolkit-intercity"), (GOERLITZ, "railtoolkit-intercity"),
    (GOERLITZ, "railtoolkit-freight"),
)  # fmt: skip
REFUSED = (Cell("hill", "freight1600", Who.HUMAN, 0), Cell("mountain", "freight1600", Who.HUMAN, 0))
"""Cells whose train cannot run on the line because it stalls on a hill."""
JOURNEYS = {("zurich-luzern", "re460-ic"): "zurich-luzern"}
"""The lines and trains with a timetable; the others get a buffer."""


def is_here(cell: Cell) -> bool:
    """Whether the files of a cell exist; a user's clone has none of ../shared."""
    ours = cell.line in {*LINES, GOERLITZ, *catalogue("routes")}
    train = IMPORTED.get(cell.train)
    return (ours or track_path(cell.line).is_file()) and (train is None or train[0].is_file())


def cell_of(number: int) -> Cell:
    """The cell with a number: each round contains every pair once, three rounds contain each pair with every driver."""
    turn, place = divmod(number, len(PAIRS))
    return Cell(*PAIRS[place], tuple(Who)[(turn + place) % len(Who)], turn // len(Who))


def cells(count: int, first: int = 0) -> list[Cell]:
    """A number of cells; those whose files do not exist are omitted unless CI is set."""
    drawn = (cell_of(number) for number in range(first, first + count))
    return [cell for cell in drawn if os.environ.get("CI") or is_here(cell)]


def files_of(cell: Cell, folder: Path) -> tuple[Path, Path]:
    """The route and vehicle files of a cell; generated ones are written to a folder."""
    head = 'schema_version = 1\n[{0}]\nid = "{1}"\nname = "{1}"\n'
    route, vehicle = folder / f"line-{cell.line}.toml", folder / f"train-{cell.train}.toml"
    if cell.line in LINES:
        route.write_text(head.format("route", cell.line) + LINES[cell.line], encoding="utf-8")
    elif cell.line == GOERLITZ:
        text = (DATA / "railtoolkit" / f"{GOERLITZ}.toml").read_text(encoding="utf-8")
        way = '[[stops]]\nname = "km 22"\nposition_m = 22000\n\n[[stops]]\nname = "Dresden"'
        route.write_text(text.replace('[[stops]]\nname = "Dresden"', way), encoding="utf-8")
    else:
        route = track_path(cell.line) if track_path(cell.line).is_file() else locate_route(cell.line)
    if cell.train in TRAINS:
        made = 'source = "made up for the matrix"\n'
        vehicle.write_text(head.format("vehicle", cell.train) + made + TRAINS[cell.train], encoding="utf-8")
    elif cell.train in IMPORTED:
        vehicle.write_text(import_train(*IMPORTED[cell.train]).text, encoding="utf-8")
    else:
        vehicle = locate_vehicle(cell.train)
    return route, vehicle


def service_of(cell: Cell, folder: Path) -> Service:
    """The service of a cell; raises DasError for a train that cannot run on its line."""
    route, vehicle = files_of(cell, folder)
    journey = JOURNEYS.get((cell.line, cell.train))
    main = f'id = "matrix"\ntitle = "{cell}"\nroute = "{route}"\nvehicle = "{vehicle}"\n'
    main += f'journey = "{journey}"\n' if journey else ""
    main += 'to = "km 22"\n' if cell.line == GOERLITZ else ""
    times = "" if journey else f"[timetable]\nbuffer_percent = {BUFFER_PERCENT}\ndwell_s = {DWELL_S}\n"
    path = folder / "scenario.toml"
    path.write_text(f"schema_version = 1\n[scenario]\n{main}{times}", encoding="utf-8")
    return prepare_service(read_scenario(path))
