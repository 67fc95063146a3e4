"""Least energies for the public benchmark TTOBench, in a table that others can compute again and compare with theirs.

`python -m docs.studies.results --ttobench FOLDER` solves every track with every train at one buffer, and the problems
of the compared file. The rows go to docs/results/0.2/ttobench/results.csv; datapackage.json beside it explains the
problem and the columns. At the end, or at once without FOLDER, the command prints the compared energies beside ours.
"""

from __future__ import annotations

import argparse
import csv
import io
import math
import platform
import re
import subprocess
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple

import das
from das.command_line.application import run_command
from das.command_line.printing import loading_solver, progress_bar, tell, warn
from das.domain.effort import EffortEnvelope
from das.domain.errors import DasError, InfeasibleError, InputError
from das.domain.files.load import load_route, load_vehicle
from das.domain.files.reading import read_text
from das.domain.files.vehicles import read_loss_map
from das.domain.files.writing import check_writable, write_whole
from das.domain.levels import Level
from das.domain.losses import EfficiencyLoss, LossMap
from das.domain.route import Route
from das.domain.units import KMH, KW, kwh
from das.domain.vehicle import BrakePolicy, Vehicle
from das.offline.refinement import refined, warm_up_refinement
from das.solver.section import Section, SectionOptions, build_section
from das.solver.solution import Fit
from das.solver.solve import solve_front
from das.solver.state import fastest
from docs.studies.output import DOCS, csv_text

FOLDER: Final = DOCS / "results" / "0.2" / "ttobench"
RESULTS: Final = FOLDER / "results.csv"
PEER: Final = FOLDER / "ms-eetc.csv"
KINDS: Final = ("tracks", "trains")
ELECTRIC, BOTH = BRAKES = ("electric", "electric+pneumatic")
BUFFER_RATIO: Final = 0.1
"""Buffer of every pair; the running time is rounded up to 0.1 s."""
ROUNDING_KWH: Final = 0.005
"""Tolerance (kWh) of energies of others, which may be rounded to two decimals."""
TOLERANCE_S: Final = 1e-3
"""Largest excess (s) of a run over the time of its row."""
POINT: Final = SectionOptions(point_mass=True, start_speed_mps=1.0, end_speed_mps=1.0)
CHAIN_TRAIN: Final = "NL_Intercity_VIRM6"
"""Train that has `CHAIN_EFFORT` and `CHAIN_SPEED_MPS` with its loss map, and with electric brakes only."""
CHAIN_EFFORT: Final = EffortEnvelope(max_force_n=213.9e3, max_power_w=3129.278 * KW)
CHAIN_SPEED_MPS: Final = 160 * KMH
CONSTANT: Final = re.compile(r"constant (\d+(?:\.\d+)?)/(\d+(?:\.\d+)?)")
NAME = (r"[\w-]+", "the name of a file of TTOBench without its ending")
NUMBER = (r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?", "a number")
CELLS: Final = {
    "track": NAME,
    "train": NAME,
    "loss_model": (rf"{CONSTANT.pattern}|map [\w-]+", "constant TRACTION/BRAKE (efficiencies), or map NAME"),
    "brakes": ("|".join(map(re.escape, BRAKES)), " or ".join(BRAKES)),
    "time_s": NUMBER,
    "energy_kwh": NUMBER,
}
"""Columns of a file to compare: the pattern of a cell, and the words for it."""
FIGURES: Final = ("running_time_s", "least_time_s", "energy_kwh", "bound_kwh", "gap_percent", "computing_s")
COLUMNS: Final = (*list(CELLS)[:-1], *FIGURES, "machine", "version", "commit")
"""Columns of our table."""


class Instance(NamedTuple):
    """A problem of the benchmark for any running time: track and train by their files, losses and brakes."""

    track: str
    train: str
    loss_model: str
    brakes: str


Row = Mapping[str, str]
Key = tuple[Instance, float]
"""Problem and longest running time (s) of a row."""
Rows = dict[Key, Row]


def constant(traction: float, brake: float) -> str:
    """The name of losses by their efficiencies: equal efficiencies give equal names."""
    return f"constant {traction:g}/{brake:g}"


def read_rows(path: Path, columns: Sequence[str] = tuple(CELLS)) -> list[tuple[Key, Row]]:
    """Key and cells of each row of a table; InputError for a missing column or an invalid cell."""
    table = csv.DictReader(io.StringIO(read_text(path)), restval="")
    found: list[tuple[Key, Row]] = []
    try:
        rows = list(table)
    except csv.Error as error:
        raise DasError(f"{path}: not a table ({error})") from error
    if lacking := [name for name in columns if name not in (table.fieldnames or ())]:
        raise InputError(path, "columns", ", ".join(table.fieldnames or ()), f"also {', '.join(lacking)}")
    for number, row in enumerate(rows, start=2):
        for name, (pattern, expected) in CELLS.items():
            if not re.fullmatch(pattern, row[name]):
                raise InputError(path, f"line {number}, {name}", row[name], expected)
        own = CONSTANT.fullmatch(row["loss_model"])
        model = constant(*map(float, own.groups())) if own else row["loss_model"]
        found.append(((Instance(row["track"], row["train"], model, row["brakes"]), float(row["time_s"])), row))
    return found


def posed(problem: Instance, route: Route, vehicle: Vehicle, loss_map: LossMap | None = None) -> Section:
    """The section of a problem: the whole track without a stop on the way, for a point mass from and to 1 m/s.

    A problem with a map needs `loss_map`. Raises InfeasibleError for what the train cannot do.
    """
    if problem.brakes == ELECTRIC:
        vehicle = replace(vehicle, brake_policy=BrakePolicy.ELECTRIC)
    if own := CONSTANT.fullmatch(problem.loss_model):
        loss = EfficiencyLoss.from_efficiencies(*map(float, own.groups()))
        vehicle = replace(vehicle, losses=MappingProxyType({Level.OWN: loss}))
    elif loss_map is None:
        raise DasError(f"{problem.loss_model}: expected a loss map of this name")
    else:
        vehicle = vehicle.with_loss_map(loss_map)
    if problem.train == CHAIN_TRAIN and (problem.brakes == ELECTRIC or not own):
        chain = CHAIN_EFFORT
        vehicle = replace(vehicle, traction=chain, electric_brake=chain, max_speed_mps=CHAIN_SPEED_MPS)
    return build_section(route, vehicle, options=POINT)


def every_pair(folder: Path) -> Iterator[Instance]:
    """Every track with every train of a folder and the train's own losses; DasError if the folder has none."""
    tracks, trains = (sorted((folder / kind).glob("*.json")) for kind in KINDS)
    if not tracks or not trains:
        raise DasError(f"{folder}: expected the folder of TTOBench, with tracks/*.json and trains/*.json")
    for path, vehicle in zip(trains, map(load_vehicle, trains), strict=True):
        own = vehicle.loss_model(Level.OWN)
        assert isinstance(own, EfficiencyLoss)  # the format has no other losses
        model = constant(1.0 / (1.0 + own.traction_ratio), 1.0 - own.brake_ratio)
        brakes = ELECTRIC if vehicle.brake_policy is BrakePolicy.ELECTRIC else BOTH
        yield from (Instance(track.stem, path.stem, model, brakes) for track in tracks)


def solved(problem: Instance, section: Section, times_s: Iterable[float]) -> Iterator[tuple[float, dict[str, str]]]:
    """Each running time (s) with its cells of the table; a time below the least one has none."""
    began_s = time.process_time()
    front = solve_front(section, threads=1)
    front_s = time.process_time() - began_s
    for time_s in times_s:
        began_s = time.process_time()
        run = refined(front.trajectory(time_s, tolerance_s=TOLERANCE_S))
        if run.fit is Fit.LATE:
            warn(f"{' '.join(problem)}: no row for {time_s:g} s; the least running time is {run.least_time_s:.1f} s")
            continue
        bound = ("", "") if run.gap_reason else (f"{kwh(run.bound_j):.4f}", f"{100.0 * run.gap_ratio:.4f}")
        times = (f"{run.time_s:.3f}", f"{run.least_time_s:.3f}")
        spent = f"{front_s + time.process_time() - began_s:.1f}"
        figures = zip(FIGURES, (*times, f"{kwh(run.balance.input):.4f}", *bound, spent), strict=True)
        yield time_s, {**problem._asdict(), "time_s": f"{time_s:.10g}", **dict(figures)}


def solve_missing(folder: Path, maps: Mapping[str, LossMap], asked: Iterable[Key], out: Path) -> Rows:
    """Solve the asked problems and every pair of a folder of TTOBench, except rows that the file has; returns all rows.

    The file is written after each section, so that an interrupted run continues there.
    """
    rows: Rows = dict(read_rows(out, COLUMNS)) if out.exists() else {}
    pairs = list(every_pair(folder))
    times: dict[Instance, set[float]] = {one: set() for one in pairs}
    for problem, time_s in asked:
        if problem.loss_model.startswith("constant") or problem.loss_model in maps:
            times.setdefault(problem, set()).add(time_s)
    made = provenance()
    with progress_bar("results", f"{len(times)} sections", "sections") as progress:
        for number, (problem, wanted_s) in enumerate(times.items(), start=1):
            try:
                track, train = (folder / kind / f"{name}.json" for kind, name in zip(KINDS, problem[:2], strict=True))
                section = posed(problem, load_route(track), load_vehicle(train), maps.get(problem.loss_model))
            except InfeasibleError as error:
                warn(f"{' '.join(problem)}: no row; {error}")
                continue
            if problem in pairs:
                wanted_s.add(math.ceil(10.0 * (1.0 + BUFFER_RATIO) * fastest(section).time_s) / 10.0)
            if missing_s := sorted(one for one in wanted_s if (problem, one) not in rows):
                rows |= {(problem, at_s): cells | made for at_s, cells in solved(problem, section, missing_s)}
                lines = ([row[name] for name in COLUMNS] for _, row in sorted(rows.items()))
                write_whole(out, csv_text([COLUMNS, *lines]).encode())
            progress(number, len(times))
    return rows


def provenance() -> dict[str, str]:
    """Machine, version and commit of the rows made here; the commit is marked if the solver has been changed since."""
    info = Path("/proc/cpuinfo")  # Linux
    model = re.search(r"model name\s*: (.*)", info.read_text(encoding="utf-8")) if info.exists() else None
    asked = (["git", "rev-parse", "--short=8", "HEAD"], ["git", "status", "--porcelain", "das"])
    try:
        head, changed = (
            subprocess.check_output(one, cwd=DOCS.parent, stderr=subprocess.DEVNULL, text=True).strip() for one in asked
        )
    except (OSError, subprocess.CalledProcessError):  # no git, or no clone
        head, changed = "", ""
    machine = f"1 core of {model[1] if model else platform.processor()} ({platform.machine()})"
    return {"machine": machine, "version": das.__version__, "commit": head + ("-changed" if changed else "")}


def comparison(common: Iterable[tuple[Key, Row, Row]]) -> Iterator[str]:
    """A Markdown table of the energies in rows of others beside those of our rows of the same key."""
    yield "| track | train | losses | brakes | time s | theirs kWh | ours kWh | bound kWh | theirs above ours |"
    yield f"|{'---|' * 4}{'---:|' * 5}"
    for (problem, time_s), theirs, ours in common:
        their_kwh, our_kwh = float(theirs["energy_kwh"]), float(ours["energy_kwh"])
        above = f"{100.0 * (their_kwh - our_kwh) / abs(our_kwh):+.2f} %"
        figures = f"{time_s:g} | {their_kwh:.2f} | {our_kwh:.2f} | {ours['bound_kwh'][:-2]} | {above}"
        yield f"| {' | '.join(problem)} | {figures} |"


def results(ttobench: Path | None, loss_map: Path | None, compare: Path, out: Path) -> None:
    """Solve what is missing in the table `out` if TTOBench is given, and print the compared rows beside ours."""
    theirs = read_rows(compare)
    if ttobench is None:
        if loss_map is not None:
            raise DasError("--loss-map: expected together with --ttobench FOLDER")
        rows = dict(read_rows(out, COLUMNS))
    else:
        check_writable(out, overwrite=True)
        maps = {} if loss_map is None else {f"map {loss_map.stem}": read_loss_map(loss_map)}
        with loading_solver():
            warm_up_refinement()
        rows = solve_missing(ttobench, maps, [key for key, _ in theirs], out)
    common = [(key, row, rows[key]) for key, row in theirs if key in rows]
    for line in comparison(common):
        tell(line)
    below = (float(row["energy_kwh"]) + ROUNDING_KWH < float(ours["bound_kwh"] or "-inf") for _, row, ours in common)
    if low := sum(below):
        warn(f"energies below the proven bound: {low} of {len(common)}; integrate in fine steps, and check the problem")
    if lacking := len(theirs) - len(common):
        warn(f"{lacking} of {len(theirs)} rows of {compare} have no row for the same time in {out}")


def main() -> None:
    """Run the command; an input error gives one line and exit code 2."""
    parser = argparse.ArgumentParser(prog="python -m docs.studies.results", description=__doc__)
    parser.add_argument("--ttobench", type=Path, metavar="FOLDER", help="Copy of TTOBench: solve the missing rows.")
    parser.add_argument("--loss-map", type=Path, metavar="CSV", help="Loss map of the rows with the losses map NAME.")
    parser.add_argument("--compare", type=Path, metavar="CSV", default=PEER, help="Results of another solver.")
    parser.add_argument("-o", "--out", type=Path, metavar="CSV", default=RESULTS, help="Our table; rows are added.")
    run_command(lambda: results(**vars(parser.parse_args())))


if __name__ == "__main__":
    main()
