"""The commands of `das-sim experiment`, each imported when it is called."""

from __future__ import annotations

from typing import Final

from das.command_line.application import Entry

ENTRIES: Final = (
    Entry(
        name="check",
        where="sim.experiment.command:check",
        summary="Check a design: trials, balance, duration, and whether the driver senses every factor; freeze it.",
        examples=("das-sim experiment check smoke", "das-sim experiment check design.toml -o study"),
    ),
    Entry(
        name="run",
        where="sim.experiment.command:run",
        summary="Drive all trials of a design; an experiment that was stopped goes on where it was.",
        examples=("das-sim experiment run smoke -o study", "das-sim experiment run design.toml -o study --workers 4"),
    ),
    Entry(
        name="studies",
        where="sim.experiment.command:studies",
        summary="List the bundled studies and where their files are.",
        examples=("das-sim experiment studies",),
    ),
)
