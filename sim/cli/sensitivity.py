"""The command `das-sim sensitivity`: how much each parameter of the human driver matters."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import closing
from typing import TYPE_CHECKING, Annotated

import typer

from das.command_line.options import JsonOption, LevelOption
from das.command_line.printing import busy, print_table, tell
from das.command_line.running import interrupt_on_termination
from das.domain.errors import DasError
from sim.cli.options import FrictionOption, ScenarioArgument
from sim.cli.shared import chosen
from sim.drivers.kinds import FrictionPolicy, Presentation

if TYPE_CHECKING:
    from sim.jobs.sensitivity import Sensitivity, SensitivityJob, SensitivityRun


AdviceListOption = Annotated[
    str, typer.Option("--advice", metavar="LIST", help="What the display shows, with commas between.")
]
DaysOption = Annotated[
    str, typer.Option("--seeds", metavar="LIST", help="Days, like 0-3 or 1,5: the same for every driver.")
]
ParametersOption = Annotated[
    str | None,
    typer.Option(
        "--parameters",
        metavar="LIST",
        help="Parameters to vary, with commas between [default: all].",
        show_default=False,
    ),
]
HowTheyDifferOption = Annotated[
    str | None,
    typer.Option(
        "--population",
        metavar="FILE",
        help="How drivers differ: a TOML file [default: the bundled population].",
        show_default=False,
    ),
]
WorkersOption = Annotated[int, typer.Option("--workers", metavar="N", help="Number of processes.", min=1, max=1024)]
MarkdownOption = Annotated[bool, typer.Option("--markdown", help="Print the table as Markdown, for a document.")]


def sensitivity(
    scenario: ScenarioArgument,
    advice: AdviceListOption = "vector",
    seeds: DaysOption = "0-3",
    parameters: ParametersOption = None,
    population: HowTheyDifferOption = None,
    friction: FrictionOption = FrictionPolicy.AS_MEASURED,
    level: LevelOption = None,
    workers: WorkersOption = 1,
    markdown: MarkdownOption = False,
    as_json: JsonOption = False,
) -> None:
    """Say by how many points the gap to the optimum changes with one standard deviation of each parameter.

    Every parameter is set one standard deviation below and above its median, all others to theirs, on the same days
    with the same chances. A parameter that the population does not draw is varied by a fifth of its default.
    """
    with busy("reading the scenario …"):
        from sim.drivers.population import DEFAULT, load_population
        from sim.jobs.batch import parse_seeds
        from sim.jobs.sensitivity import Study, sensitivities, sensitivity_markdown
        from sim.world.scenario import load_scenario

        study = Study(
            scenario=load_scenario(scenario).source,
            level=level,
            seeds=parse_seeds(seeds),
            advice=list(dict.fromkeys(chosen(Presentation, "--advice", part.strip()) for part in advice.split(","))),
            friction=friction,
            population=load_population(population or DEFAULT),
            parameters=None if parameters is None else [name.strip() for name in parameters.split(",")],
        )
        jobs = list(study.jobs())
    interrupt_on_termination()
    found = sensitivities(study, _driven(jobs, workers))
    if as_json:
        print(json.dumps([one.as_dict() for one in found]))
    elif markdown:
        print(sensitivity_markdown(found))
    else:
        _print(found)


def _driven(jobs: Sequence[SensitivityJob], workers: int) -> list[SensitivityRun]:
    """All runs of a study, with progress; DasError for one that cannot be made."""
    from precompute.workers import Workers
    from sim.jobs.runner import JobWords, made_with_progress
    from sim.jobs.sensitivity import drive

    found: list[SensitivityRun] = []
    words = JobWords("sensitivity", "runs", "make")
    with closing(made_with_progress(drive, jobs, Workers(count=workers), words, f"{len(jobs)} runs")) as coming:
        for made in coming:
            if made.result is None:
                raise made.error or DasError("a run came to nothing")
            found.append(made.result)
    return found


def _print(found: Sequence[Sensitivity]) -> None:
    """Print the table."""
    from rich.table import Table

    from sim.jobs.sensitivity import shown_points

    table = Table(title="points of gap to the optimum per standard deviation", title_justify="left")
    table.add_column("advice, parameter", no_wrap=True)
    for name in ("−1 sd", "+1 sd", "points", "kWh"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("source")
    for one in found:
        varied = one.variation
        name = f"{one.advice}, {varied.name}" + ("" if varied.drawn else " *")
        figures = (f"{varied.low:.3g}", f"{varied.high:.3g}", shown_points(one), f"{one.energy_kwh:+.1f}")
        table.add_row(name, *figures, varied.source)
    print_table(table)
    tell("* not drawn by the population: varied by a fifth of its default")
