"""The commands of `das-sim experiment`, each imported when it is called."""

from __future__ import annotations

from typing import Final

from das.command_line.application import Entry

ENTRIES: Final = (
    Entry(
        name="analyse",
        where="sim.experiment.analysis.command:analyse",
        summary="Analyse a study that was run: paired differences with intervals, a mixed model, checks.",
        examples=("das-sim experiment analyse study -o report.html", "das-sim experiment analyse study --effect 0.78"),
    ),
    Entry(
        name="power",
        where="sim.experiment.analysis.command:power",
        summary="Say how often an experiment would find a difference, and how many participants it needs.",
        examples=(
            "das-sim experiment power pilot --effect 1 --participants 24,48,76",
            "das-sim experiment power --effect 0.78 --sd 2.4",
        ),
    ),
)
