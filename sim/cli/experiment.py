"""The commands of `das-sim experiment`: they check a design, drive its trials, and analyse the data."""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from das.command_line.application import refuse_given
from das.command_line.options import JsonOption, OutFolder, OutFolderOption, OverwriteOption
from das.command_line.printing import busy, loading_solver, new_table, paragraph, print_table, say
from das.domain.errors import DasError
from das.domain.files.writing import check_writable, write_whole
from precompute.workers import Workers
from sim.cli.desk import SessionLooks, check_lsl, show_page
from sim.cli.options import FrictionOption, WorkersOption, check_packages, chosen, tell_written
from sim.drivers.kinds import DriverKind, FrictionPolicy, OwnClass, Presentation, named_driver
from sim.options import LEAST_DRIVERS, PageFiles, PopulationOption, typed_command

if TYPE_CHECKING:
    from sim.experiment.design import Design
    from sim.experiment.runner import TrialJob
    from sim.experiment.trials import StudyRun

DesignArgument = Annotated[
    str,
    typer.Argument(metavar="DESIGN", help="Design file (TOML), or a bundled study (das-sim list studies)."),
]


def check(
    design: DesignArgument,
    out: OutFolderOption = None,
    as_json: JsonOption = False,
) -> None:
    """Check a design: trials, balance, duration, factors without effect; freeze it in a folder.

    Nothing is driven. With --out, the design is frozen there, and only this design can be run in that folder.
    """
    with busy("reading the design …"):
        from sim.experiment.checking import check_design, made_folder, print_check
        from sim.experiment.design import freeze, load_design

        asked = load_design(design)
    with contextlib.nullcontext() if out is None else made_folder(out):
        found = check_design(asked)
        if out is not None and not found.refused:
            freeze(asked, out)
    print(json.dumps(asdict(found))) if as_json else print_check(asked, found, out)
    if found.refused:
        raise DasError(f"{asked.source}: {found.refused[0]}")


def desk(
    design: DesignArgument,
    out: OutFolder,
    *,
    participant: Annotated[str, typer.Option(metavar="PNN", help="Pseudonym of the participant: P1, P2, …")],
    looks: SessionLooks,
) -> None:
    """Run the session of a participant, who drives the trials of a design in the browser, from consent to debriefing.

    A stopped command goes on at the same step, also after a crash; several participants may be at desks at once. The
    folder holds trials.csv and recordings, as for simulated drivers, answers.csv, and a journal for each participant.
    """
    check_packages("desk", "starlette", "uvicorn", "websockets", "msgspec", "markdown_it")
    check_lsl(looks)
    with loading_solver():
        from sim.experiment.checking import checked_in
        from sim.experiment.design import DESIGN_JSON, load_design
        from sim.experiment.people.journal import ANSWERS_TABLE
        from sim.experiment.people.session import Sitting, serve
        from sim.experiment.people.steps import plan_of
        from sim.experiment.runner import FINISHED
        from sim.experiment.study_files import TRIALS_TABLE, participant_number

        asked = load_design(design)
    plan_of(asked)
    who = participant_number(participant, asked.people.count)
    if (out / FINISHED).exists():
        raise DasError(f"{out}: holds trials of simulated drivers, expected another folder for people")
    tables = [] if (out / DESIGN_JSON).exists() else [out / TRIALS_TABLE, out / ANSWERS_TABLE]
    if there := [path for path in tables if path.exists()]:
        raise DasError(f"{there[0]}: exists without a design: expected a new folder, or one of this design")
    checked_in(asked, out)
    sitting = Sitting(
        design=asked, folder=out, who=who, language=str(looks.language), command=typed_command(), lsl=looks.lsl
    )

    def tell(page: str, watch: str) -> None:
        show_page(page, opens=looks.opens)
        say(f"the experimenter's page: {watch}")

    serve(sitting, looks.port, tell)


OneOfTwo = Annotated[
    str | None,
    typer.Argument(metavar="[DESIGN]", help="Design file (TOML) or bundled study; or say --scenario."),
]
ScenariosOption = Annotated[
    str | None,
    typer.Option("--scenario", metavar="LIST", help="Without a design: scenarios or files, separated by commas."),
]
SeedsOption = Annotated[str, typer.Option(metavar="LIST", help="Seeds of the days, like 0-99 or 1,5,10-19.")]
SchedulerOption = Annotated[
    str | None,
    typer.Option(metavar="ADDRESS", help="Dask scheduler that drives the trials, like tcp://10.0.0.1:8786."),
]
RecordingsOption = Annotated[
    bool, typer.Option("--recordings", help="Drive over the bus and keep a recording of every trial (slower).")
]
AdviceListOption = Annotated[
    str,
    typer.Option("--advice", metavar="LIST", help="Contents of the display, separated by commas (see das-sim run -h)."),
]
DriversOption = Annotated[
    str,
    typer.Option(
        "--driver",
        metavar="LIST",
        help="The drivers, separated by commas: names (das-sim list drivers lists them) or classes of your own "
        "(package.module:Class).",
    ),
]
ParticipantsOption = Annotated[
    str | None,
    typer.Option(
        "--participants",
        metavar="RANGE",
        help="Human drivers of the population, like 1-30, each in every run [default: the average driver].",
    ),
]
ONE_LINE: Final = ("--driver", "--advice", "--seeds", "--friction", "--participants", "--population")
"""Options of `run` that go with --scenario, instead of a design."""


def run(
    out: OutFolder,
    design: OneOfTwo = None,
    scenario: ScenariosOption = None,
    driver: DriversOption = "human",
    advice: AdviceListOption = "guide",
    seeds: SeedsOption = "0-9",
    friction: FrictionOption = FrictionPolicy.AS_MEASURED,
    participants: ParticipantsOption = None,
    population: PopulationOption = None,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
    recordings: RecordingsOption = False,
    as_json: JsonOption = False,
) -> None:
    """Simulate all trials of a design, or every scenario with every driver, presentation and seed.

    A stopped experiment continues where it ended and repeats failed trials. The folder holds trials.csv with one
    row a trial, the design, a README, and recordings if requested. A design is checked and frozen there first, unless
    that has been done. Without a design, means over the seeds and the savings by advice are printed.
    """
    hands = Workers.asked(workers, scheduler)
    if recordings and scheduler is not None:
        raise DasError("--recordings: not together with --scheduler, because recordings are written on this machine")
    if scenario is None:
        refuse_given("needs --scenario; a design has its own", *ONE_LINE)
        if design is None:
            raise DasError("expected a design (das-sim list studies has the bundled ones), or --scenario")
    elif design is not None:
        raise DasError(f"--scenario {scenario}: not together with a design ({design})")
    with busy("reading the design …"):
        from sim.experiment.checking import checked_in, made_folder, refuse_people
        from sim.experiment.design import freeze, load_design
        from sim.experiment.trials import jobs_of, run_study

        asked = load_design(str(design)) if scenario is None else _days(scenario, driver, advice, seeds, friction,
            participants, population)  # fmt: skip
    if scenario is None:
        refuse_people(asked, out)
        checked_in(asked, out)
    else:
        with made_folder(out):
            freeze(asked, out)
    jobs = jobs_of(asked, out, record=recordings)
    _tell_run(asked, jobs, run_study(asked, jobs, out, hands), as_json=as_json)


def _days(*given: Any) -> Design:
    from sim.drivers.parameters import DEFAULT
    from sim.experiment.one_line import DaysAsked, parse_participants, parse_seeds

    scenario, driver, advice, seeds, friction, participants, population = given
    drivers = _drivers(driver)
    if DriverKind.HUMAN not in drivers:
        refuse_given(f"needs --driver {DriverKind.HUMAN}: only this driver has habits", "--participants", "--friction")
    if participants is None:
        refuse_given("needs --participants", "--population")
    return DaysAsked(
        scenarios=[part.strip() for part in scenario.split(",")],
        drivers=drivers,
        advice=list(dict.fromkeys(chosen(Presentation, "--advice", part.strip()) for part in advice.split(","))),
        seeds=parse_seeds(seeds),
        friction=friction,
        participants=None if participants is None else parse_participants(participants),
        population=DEFAULT if population is None else population,
    ).design()


def _drivers(text: str) -> list[DriverKind | OwnClass]:
    """The drivers of a list; DasError for an unknown name, and for a driver in a separate process."""
    found: dict[DriverKind | OwnClass, None] = {}
    for part in text.split(","):
        driver = named_driver("--driver", part.strip())
        if not isinstance(driver, DriverKind | OwnClass):
            raise DasError(f"--driver {driver}: an experiment cannot use an external driver; use das-sim run")
        found[driver] = None
    return list(found)


def _tell_run(design: Design, jobs: Sequence[TrialJob], found: StudyRun, *, as_json: bool) -> None:
    from sim.experiment.checking import print_run
    from sim.experiment.one_line import print_summary, told
    from sim.experiment.study_files import FAILED_TABLE

    if design.source.is_file():
        print(json.dumps(found.as_dict())) if as_json else print_run(design, found)
    else:
        said = told(jobs, found)
        plain = {**said, "savings": [one.as_dict() for one in said["savings"]]}
        print(json.dumps(plain)) if as_json else print_summary(said)
    if found.failed:
        where = found.folder / FAILED_TABLE
        print(f"{len(found.failed)} of {found.trials} trials failed: see {where}", file=sys.stderr)
        raise typer.Exit(1)


StudyArgument = Annotated[
    Path, typer.Argument(metavar="DIR", help="Folder of a study made by das-sim experiment run or desk.")
]


def analyse(
    folder: StudyArgument,
    written: PageFiles,
    other: Annotated[
        Path | None,
        typer.Option("--with", metavar="DIR", help="Another study of the same design, whose drivers are compared."),
    ] = None,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Analyse a completed study: planned differences with intervals, corrected p, effect sizes, a forest plot.

    With --with, two studies are analysed together, for example of people and of simulated drivers: every measure of
    their drivers is compared. Their designs may differ in participants, driver and desk only.
    """
    check_packages("experiment", "jinja2", "matplotlib", "scipy")
    from sim.experiment.analysis.comparing import analyse_study, read_study
    from sim.experiment.analysis.page import as_dict, group_words, hangs_on, in_short, page
    from sim.experiment.analysis.together import analyse_both, read_both
    from sim.experiment.design import DESIGN_JSON
    from sim.experiment.study_files import TRIALS_TABLE

    folders = [folder] if other is None else [folder, other]
    inputs = [place / name for place in folders for name in (DESIGN_JSON, TRIALS_TABLE)]
    written.check(inputs, overwrite=overwrite)
    with busy("analysing the trials …"):
        together = None if other is None else analyse_both(read_both(folder, other))
        found = analyse_study(read_study(folder)) if together is None else together.findings
    written.write(lambda: page(found, together))
    if as_json:
        print(json.dumps(as_dict(found, together)))
        return
    for line in hangs_on(found):
        paragraph(line)
    for name, line in in_short(found):
        paragraph(f"{name}: {line}" if name else line)
    if together is not None:
        for title, some in together.tables.items():
            paragraph(f"{title}:")
            for one in some:
                paragraph(group_words(one, together.levels), hanging="  ")
    tell_written(*written.paths)


def rescore(
    folder: StudyArgument,
    out: OutFolder,
    measure: Annotated[
        list[str] | None,
        typer.Option("--measure", metavar="NAME", help="Measure; may be given several times [default: all]."),
    ] = None,
) -> None:
    """Compute measures from the recordings of a study, in another folder that can be analysed.

    Only measures that need nothing but a recording are computed, also those of other packages (das-sim list).
    """
    from sim.experiment.measures import MEASURES
    from sim.experiment.study_files import rescore as written

    names = measure or [one.name for one in MEASURES.values() if one.of_table is not None]
    count = written(folder, names, out)
    paragraph(f"{len(names)} measures of {count} trials")
    tell_written(out)


def fit(
    folder: StudyArgument,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="Population file to write (.toml).")],
    participant: Annotated[
        list[str] | None,
        typer.Option("--participant", metavar="P07", help="Pseudonym; may be given several times [default: all]."),
    ] = None,
    design: Annotated[
        Path | None,
        typer.Option("--design", metavar="FILE", help="The design, if it names scenario, train or population files."),
    ] = None,
    drivers: Annotated[int, typer.Option("--drivers", min=LEAST_DRIVERS, help="Number of simulated drivers.")] = 80,
    workers: WorkersOption = None,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Fit a population of drivers to the recordings of at least six people, for --population and designs.

    Simulated drivers, whose parameters are spread over ranges, drive the same trials; the fit is the population
    that drives as the people did. A parameter that the recordings do not reveal keeps its default, with the reason.
    """
    check_packages("experiment", "scipy")
    from sim.experiment.people.fitting import fit as fitted
    from sim.experiment.people.fitting import population_text, recorded

    check_writable(out, overwrite=overwrite)
    hands = Workers.asked(workers, None)
    found = fitted(recorded(folder, design, participant or []), folder.resolve().name, drivers, hands)
    write_whole(out, population_text(found, out.stem).encode())
    if as_json:
        print(json.dumps(asdict(found)))
        return
    table = new_table("", ("estimate", "95 % interval", "sd between drivers"), whole=("parameter",))
    for one in found.parameters:
        got = one.figures
        row = ("", "", f"not fitted: {one.why}") if got is None else (
            f"{got.value:.3g}", f"{got.low:.3g} to {got.high:.3g}", f"{got.sd:.2g}")  # fmt: skip
        table.add_row(one.name, *row)
    print_table(table)
    tell_written(out)


def forget(
    folder: StudyArgument,
    participant: Annotated[str, typer.Option("--participant", metavar="P07", help="Pseudonym of the participant.")],
    as_json: JsonOption = False,
) -> None:
    """Remove a participant from the folder of a study with people.

    The journal, the recordings, and the rows in the tables of trials and answers are removed; the pseudonym and the
    date stay. An interrupted command can be repeated.
    """
    from sim.experiment.people.forget import forget as removed

    found = removed(folder, participant)
    if as_json:
        print(json.dumps(asdict(found)))
        return
    paragraph(
        f"{found.participant}: {found.files} files and {found.rows} rows of tables removed, {found.bytes} bytes. "
        "Copies, reports and fitted populations made before are not touched."
    )
