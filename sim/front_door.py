"""The functions of `import sim`: runs as arrays, recorded drives, their comparison and report, and studies. Files are
written to the given path, and existing files are never replaced.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from das.command_line.options import DEFAULT_TRAIN
from das.domain.errors import DasError, InputError
from das.domain.files.writing import check_writable, write_folder_whole
from das.domain.levels import Level
from das.domain.summary import Summary, needs
from das.domain.trajectory import EnergyBalance
from das.drawing.plotted import PlottedRun
from das.front_door import chosen
from sim.drive.drive import Drive
from sim.drivers.kinds import DriverKind, OwnClass, Presentation, named_driver
from sim.drivers.knowledge import LineKnowledge
from sim.drivers.parameters import Participant, participant_of
from sim.options import PageFiles, ReplayOptions, TripOptions
from sim.plant.kernels import PlantState
from sim.world.driving import How, drive_day, drive_kept
from sim.world.in_process import TRAIN
from sim.world.outcome import outcome
from sim.world.scenario import load_scenario
from sim.world.service import make_day, prepare_service

if TYPE_CHECKING:
    from sim.drive.comparison import AlignedDrives
    from sim.drive.table import DriveTable
    from sim.experiment.analysis.comparing import StudyFindings


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SimulatedDay(Summary):
    """A simulated run. `names` are scenario, driver and advice, `line` is the driver's knowledge, and `between_s` has
    the first departure and the last arrival (s).
    `states` holds the true state of the train once a second (see `columns`), `outcome` the figures that
    `das-sim run --json` prints: punctuality, energies (kWh) and their parts, and figures of the advice. `balance` is
    the energy balance from the first departure to the last arrival (J). `table` has the columns of a `Drive`.
    """

    states: Mapping[str, NDArray[np.float64]]
    outcome: Mapping[str, Any]
    balance: EnergyBalance
    names: tuple[str, ...]
    line: LineKnowledge
    between_s: tuple[float, float]
    table: DriveTable

    def facts(self) -> dict[str, str]:
        """Scenario, driver and advice, and the energy of the run."""
        told = dict(zip(("scenario", "driver", "advice"), self.names, strict=True))
        start_s, end_s = self.between_s
        late_s = self.outcome["late_s"]
        return {**told, "needed": needs(end_s - start_s, self.balance.input), "late": f"{late_s:+.0f} s"}

    def plotted(self) -> PlottedRun:
        """The drive between the first departure and the last arrival, for a picture; without temporary limits."""
        all_s, (start_s, end_s) = self.states["time_s"], self.between_s
        time_s = np.concatenate(([start_s], all_s[(all_s > start_s) & (all_s < end_s)], [end_s]))
        state = {name: np.interp(time_s, all_s, column) for name, column in self.states.items()}
        return PlottedRun(
            names=(*self.names[:2], f"advice {self.names[2]}"),
            time_s=state["time_s"],
            s_m=state["s_m"],
            speed_mps=state["speed_mps"],
            limit_mps=self.line.limits_mps.at(state["s_m"]),
            force_el_n=state["force_el_n"],
            force_friction_n=state["force_friction_n"],
            energy_j=state["input_j"] - state["input_j"][0],
            route=self.line.route,
        )

    def columns(self) -> dict[str, NDArray[np.float64]]:
        """The true state of the train once a second, as arrays of shape (seconds + 1,) by names with units.

        `time_s` is 0 at the timetable's departure; `s_m` and `speed_mps` are position and speed,
        `force_el_n` and `force_friction_n` wheel forces. Energies ending in `_j` count from the start of the run.
        """
        return dict(self.states)


def run_day(
    scenario: str | Path,
    seed: int = 0,
    *,
    driver: DriverKind | str = DriverKind.HUMAN,
    advice: Presentation | str = Presentation.GUIDE,
    level: Level | str | None = None,
    participant: int | None = None,
) -> SimulatedDay:
    """Simulate a run of a scenario in closed loop: train and driver, advised once a second, without a bus.

    `scenario` is the name of a bundled scenario or a TOML file. Disturbances and driver are drawn with `seed`; the same
    seed gives the same run. `driver` and `advice` name a driver (also a class, as "package.module:Class") and a
    presentation; `das-sim list` prints both. `level` is the loss model (by default the vehicle's own). `participant` is
    the number of a human driver of the default population, the same person in every run. Nothing is recorded; see
    `record_day`.

    Raises InputError for an unknown word, DasError for an unusable scenario or a train that does not arrive.

        >>> import sim
        >>> day = sim.run_day("clear-day", driver="perfect", advice="speed-and-effort")
        >>> abs(day.outcome["late_s"]) < 30, day.outcome["signals_passed"]
        (True, 0)
        >>> sim.run_day("clear-day", driver="nobody")
        Traceback (most recent call last):
        ...
        das.domain.errors.InputError: run_day: driver = 'nobody': expected one of perfect, literal, fast, top-speed, ...
    """
    kind, shown = _who(driver), chosen(Presentation, "run_day", "advice", advice)
    losses = None if level is None else chosen(Level, "run_day", "level", level)
    if not isinstance(seed, int) or isinstance(seed, bool) or seed < 0:
        raise InputError("run_day", "seed", seed, "a whole number >= 0")
    if not isinstance(scenario, str | Path):
        raise InputError("run_day", "scenario", scenario, "the name of a bundled scenario, or a path")
    person = _person(kind, participant)
    day = make_day(prepare_service(load_scenario(str(scenario)), level=losses), seed, person)
    run, table = drive_kept(day, day.driver(kind), How(driver=kind, advice=shown, train=TRAIN, command="sim.run_day"))
    columns = zip(PlantState._fields, zip(*run.states, strict=True), strict=True)
    states = {name: np.array(column) for name, column in columns}
    first, last = run.legs[0][0], run.legs[-1][1]
    return SimulatedDay(
        states=states,
        outcome=outcome(day, run, kind).as_dict(),
        balance=day.plant.balance(first, last),
        names=(day.service.scenario.id, str(kind), str(shown)),
        line=day.service.line,
        between_s=(first.time_s, last.time_s),
        table=table,
    )


def record_day(
    scenario: str | Path,
    out: str | Path,
    seed: int = 0,
    *,
    driver: DriverKind | str = DriverKind.HUMAN,
    advice: Presentation | str = Presentation.GUIDE,
    participant: int | None = None,
) -> Drive:
    """Simulate a run like `run_day`, but with the advice node and the recorder as processes, into a recording `out`.

    The parameters are as in `run_day`. The recording can be reviewed, compared, reported and used for what-ifs. Raises
    what `run_day` raises, and DasError if `out` cannot be written or exists, or if a process fails.

        drive = sim.record_day("departure-delay", "day.mcap", seed=3)
    """

    kind, shown = _who(driver), chosen(Presentation, "record_day", "advice", advice)
    path = _new(out)
    day = make_day(prepare_service(load_scenario(str(scenario))), seed, _person(kind, participant))
    how = How(driver=kind, advice=shown, train=DEFAULT_TRAIN, command="sim.record_day")
    drive_day(day, day.driver(kind), how, path)
    return Drive.read(path)


def replay(
    trip: str | Path,
    out: str | Path,
    *,
    route: str | Path | None = None,
    vehicle: str | Path | None = None,
    posts: str | Path | None = None,
    reverse: bool | None = None,
) -> Drive:
    """Replay a recorded trip with the advice node into a recording `out`, and return it as a drive.

    `trip` is a file of positions (.csv, .gpx) or a recording, `posts` a file of kilometre posts. `reverse`: the route
    is driven from its end. Values of None are taken from the recording; `das-sim replay` has more options.

    Raises DasError for a trip that cannot be used, for an `out` that exists or cannot be written, and if a process
    fails.

        drive = sim.replay("trip.csv", "replay.mcap", route="route.toml", vehicle="train.toml", posts="posts.csv")
    """
    from sim.runs.replay import prepare
    from sim.runs.replay import replay as run_replay
    from sim.runs.replay_figures import trip_energies

    said = TripOptions(
        route=None if route is None else str(route),
        vehicle=None if vehicle is None else str(vehicle),
        posts=None if posts is None else Path(posts),
        reverse=reverse,
    )
    job = prepare(Path(trip), ReplayOptions(trip=said), _new(out), "sim.replay")
    run_replay(job, lambda _done, _all: None, trip_energies(job).above.message)
    return Drive.read(job.processes.out)


def write_example(folder: str | Path) -> Path:
    """Write the files of `das-sim example` into a new folder: line, train, journey, scenario, and a recorded trip.

    The data are invented and meant to be changed. Raises DasError if the folder exists or cannot be written.

        sim.write_example("my-line")
    """
    from sim.bundled import example_files

    path = Path(folder)
    if path.exists():
        raise DasError(f"{folder}: is already there, expected a new folder")
    write_folder_whole(path, example_files())
    return path


def compare(first: Drive | str | Path, *others: Drive | str | Path, step_m: float = 10.0) -> AlignedDrives:
    """Drives of one line compared with the first at the same positions: times, speeds, energies, and the
    differences.

    A drive is a `Drive` or the file of a recording. In the result, `columns()` are arrays with a
    row for every `step_m`, `stretches(1)` lists where the second drive needed more than the first, and printing
    the result describes the differences in sentences.

    Raises DasError for recordings that cannot be used, and for drives of different lines.

        print(sim.compare("without.mcap", "guided.mcap"))
    """
    from sim.drive.comparison import AlignedDrives, drives_on_track

    if not others:
        raise InputError("compare", "drives", "one", "two or more; the others are compared with the first")
    return AlignedDrives.of(drives_on_track([_drive(one) for one in (first, *others)]), step_m)


def report(*drives: Drive | str | Path, out: str | Path) -> Path:
    """Write the report of `das-sim report` on recorded drives into a page `out` (.html or .pdf), and return its path.

    Several drives of one line are compared as well. Raises DasError for recordings that cannot be used, for a page that
    exists, cannot be written or has another extension, and if jinja2, matplotlib or, for a .pdf, Chromium
    is not installed.

        sim.report("day.mcap", out="day.html")
    """
    if not drives:
        raise InputError("report", "drives", "none", "at least one")
    written = PageFiles(out=_new(out))
    written.check((), overwrite=False)
    try:
        from sim.drive.comparison import compared
        from sim.review.page import page, subject_of
    except ImportError as error:
        raise DasError(f"a report needs {error.name}: pip install '.[view]' in the checkout") from None
    subjects = [subject_of(_drive(one).recording.path) for one in drives]
    written.write(lambda: page(subjects, *compared([one.drive for one in subjects])))
    return Path(out)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class StudyTables(Summary):
    """A completed and analysed study: the findings, and the tables as columns for `das.to_pandas`."""

    findings: StudyFindings

    def facts(self) -> dict[str, str]:
        """The folder, the number of trials, and the finding of each planned comparison."""
        from sim.experiment.analysis.page import in_short

        study = self.findings.study
        told = {"folder": str(study.folder), "trials": str(len(study.trials)), "failed": str(len(study.failed))}
        return {**told, **{name or "found": text for name, text in in_short(self.findings)}}

    def trials(self) -> dict[str, NDArray[Any]]:
        """A row for each trial: participant, seed, condition, and every measure."""
        trials = self.findings.study.trials
        who = {"participant": trials.participant, "position": trials.position, "practice": trials.practice}
        return {**who, "day": trials.day, **trials.levels, **trials.values}

    def differences(self) -> dict[str, NDArray[Any]]:
        """A row for each planned comparison: the mean difference in `unit` with its 95 % interval, p, and participants.

        `corrected` is p corrected for the number of comparisons.
        """
        found = [(one, one.shown, one.estimate) for one in self.findings.differences]
        rows = {
            "comparison": [one.title for one, _, _ in found],
            "mean": [shown.factor * estimate.mean for _, shown, estimate in found],
            "low": [shown.factor * estimate.interval[0] for _, shown, estimate in found],
            "high": [shown.factor * estimate.interval[1] for _, shown, estimate in found],
            "unit": [shown.difference_unit for _, shown, _ in found],
            "p": [estimate.probability for _, _, estimate in found],
            "corrected": [one.corrected for one, _, _ in found],
            "participants": [estimate.participants for _, _, estimate in found],
        }
        return {name: np.array(values) for name, values in rows.items()}


def run_experiment(design: str | Path, folder: str | Path, *, workers: int | None = None) -> StudyTables:
    """Check a design, simulate its trials into a folder, and analyse them.

    `design` is a design file (TOML) or a bundled study. Finished trials in the folder are kept, so that a stopped
    experiment resumes. `workers` is the number of processes (default: one per core). A script must call this function
    under `if __name__ == "__main__":`, because each process imports the script.

    Raises DasError for a design that is rejected, a folder of another design, a failed trial, and if scipy is
    not installed.

        study = sim.run_experiment("smoke", "smoke")
        das.to_pandas(study.differences())
    """
    try:
        from sim.experiment.analysis.comparing import analyse_study, read_study
    except ImportError as error:
        raise DasError(f"an analysis needs {error.name}: pip install '.[experiment]' in the checkout") from None
    from precompute.workers import Workers
    from sim.experiment.checking import checked_in, refuse_people
    from sim.experiment.design import load_design
    from sim.experiment.study_files import FAILED_TABLE
    from sim.experiment.trials import jobs_of, run_study

    asked, made_in = load_design(str(design)), Path(folder)
    refuse_people(asked, made_in)
    checked_in(asked, made_in)
    run = run_study(asked, jobs_of(asked, made_in), made_in, Workers.asked(workers))
    if run.failed:
        raise DasError(f"{folder}: {len(run.failed)} of {run.trials} trials failed: see {FAILED_TABLE} there")
    return StudyTables(findings=analyse_study(read_study(made_in)))


def _drive(given: Drive | str | Path) -> Drive:
    """The drive given as a `Drive`, or read from the given file."""
    return given if isinstance(given, Drive) else Drive.read(Path(given))


def _new(out: str | Path) -> Path:
    """The path of a new file that can be written; DasError for any other."""
    if Path(out).is_file():
        raise DasError(f"{out}: exists already, expected the name of a new file")
    check_writable(Path(out), overwrite=False)
    return Path(out)


def _person(driver: DriverKind | OwnClass, number: int | None) -> Participant | None:
    """The participant with a number; InputError for an invalid number, DasError if the driver is not human."""
    if number is not None and (not isinstance(number, int) or isinstance(number, bool) or number < 0):
        raise InputError("run_day", "participant", number, "a whole number >= 0")
    return participant_of(driver, number, None)


def _who(driver: DriverKind | str) -> DriverKind | OwnClass:
    """The driver given by its name or by the name of a class; InputError for anything else."""
    named = named_driver("run_day: driver", driver) if isinstance(driver, str) and ":" in driver else None
    return named if isinstance(named, OwnClass) else chosen(DriverKind, "run_day", "driver", driver)
