"""The commands of `das-sim experiment`, each imported when it is called."""

from __future__ import annotations

from typing import Final

from das.command_line.application import Entry

ENTRIES: Final = (
    Entry(
        name="check",
        where="sim.cli.experiment:check",
        summary="Check a design: trials, balance, duration, and whether the driver senses every factor; freeze it.",
        examples=("das-sim experiment check smoke", "das-sim experiment check design.toml -o study"),
    ),
    Entry(
        name="run",
        where="sim.cli.experiment:run",
        summary="Drive all trials of a design; an experiment that was stopped goes on where it was.",
        examples=("das-sim experiment run smoke -o study", "das-sim experiment run design.toml -o study --workers 4"),
    ),
    Entry(
        name="studies",
        where="sim.cli.experiment:studies",
        summary="List the bundled studies and where their files are.",
        examples=("das-sim experiment studies",),
    ),
    Entry(
        name="analyse",
        where="sim.cli.experiment_analysis:analyse",
        summary="Analyse a study that was run: paired differences with intervals, a mixed model, checks.",
        examples=("das-sim experiment analyse study -o report.html", "das-sim experiment analyse study --effect 0.78"),
    ),
    Entry(
        name="power",
        where="sim.cli.experiment_analysis:power",
        summary="Say how often an experiment would find a difference, and how many participants it needs.",
        examples=(
            "das-sim experiment power pilot --effect 1 --participants 24,48,76",
            "das-sim experiment power --effect 0.78 --sd 2.4",
        ),
    ),
)
