"""A trial with a person at the desk, in a process of its own: `python -m sim.experiment.people.trial`.

The session starts it, watches it, and talks with it over the bus. It writes the trial's row as a JSON file.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import msgspec

from das.domain.files.writing import make_folder, write_whole
from sim.desk.messages import given_to
from sim.drivers.kinds import DESK
from sim.experiment.design import check_frozen, load_design
from sim.experiment.driving import AtDesk, Driven, JobRecording, drive
from sim.experiment.measures import measured, needs_table
from sim.experiment.people.steps import plan_of
from sim.experiment.study_files import recording_file
from sim.experiment.trials import trials_of
from sim.world.lockstep import run_child
from sim.world.loop import TICK_S

GIVEN: Final = "DAS_TRIAL"
"""The environment variable with the trial's settings; other users of the machine cannot read it."""


class TrialGiven(msgspec.Struct, frozen=True, kw_only=True):
    """The settings of a trial: design and study's folder, number of the trial, the desk, and the files to write."""

    design: str
    folder: str
    number: int
    row: str
    command: str
    desk: AtDesk


def driven_row(given: TrialGiven) -> dict[str, Any]:
    """Drive a trial; returns its measures, and the longest time (s) within the criterion of practice.

    Raises DasError for a design that differs from the frozen one, and as `drive` does.
    """
    from das.solver.warm_up import warm_up

    design = load_design(given.design)
    check_frozen(design, Path(given.folder))
    plan, trial = plan_of(design), trials_of(design)[given.number - 1]
    trial = replace(trial, setting=replace(trial.setting, driver=DESK))
    warm_up()
    record = JobRecording(Path(given.folder) / recording_file(trial), given.command)
    make_folder(record.file.parent)
    driven = drive(trial, design.people.population, record, keep=needs_table(design.measures), desk=given.desk)
    held_s = longest_held_s(driven, plan.practice_criterion_mps)
    return {"measures": measured(driven, list(design.measures)), "held_s": held_s}


def longest_held_s(driven: Driven, band_mps: float) -> float:
    """The longest time (s) for which the moving train was within a band of the shown speed; without one, the limit."""
    longest = now = 0
    for state, look in driven.moving:
        shown = math.nan if look.shown is None else look.shown.shown_speed_mps
        target_mps = look.limit_mps if math.isnan(shown) else shown
        now = now + 1 if abs(state.speed_mps - target_mps) <= band_mps else 0
        longest = max(longest, now)
    return longest * TICK_S


def main() -> None:
    """Drive the trial; a session that ends stops it, and the recording remains readable."""

    def drive_given() -> None:
        given = given_to(GIVEN, TrialGiven, "das-sim experiment desk")
        write_whole(Path(given.row), json.dumps(driven_row(given)).encode())

    run_child(drive_given)


if __name__ == "__main__":
    main()
