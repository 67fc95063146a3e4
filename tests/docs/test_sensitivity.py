"""How much each parameter matters: only what is varied changes, and what has no effect changes nothing at all."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest

from das.domain.errors import DasError
from docs.studies.sensitivity import jobs, middle, sensitivities, table, variations
from sim.drivers.kinds import DriverKind, Presentation
from sim.drivers.parameters import load_population
from sim.experiment.one_line import DaysAsked
from sim.experiment.runner import attempted
from sim.experiment.trials import make_trial

POPULATION = load_population("default")


def asked(path: Path) -> DaysAsked:
    return DaysAsked(
        scenarios=[str(path)], drivers=[DriverKind.HUMAN], advice=[Presentation.NONE], seeds=[0, 1, 2]
    )  # fmt: skip


@pytest.mark.nightly
def test_what_matters_is_found_and_what_does_not_changes_nothing(flat: Callable[[str], Path], tmp_path: Path) -> None:
    """Without advice nobody complies with any: on the same days with the same chances the runs are the same."""
    varied = variations(POPULATION, ["haste_ratio", "comply_hold_ratio", "friction_ratio"])
    made = list(jobs(asked(flat("")), varied, tmp_path))
    rows = {job.inputs_sha256: attempted(make_trial, job) for _, job in made}
    listed = sensitivities(varied, made, rows)
    found = {one.variation.name: one for one in listed}
    assert list(found)[-1] == "comply_hold_ratio"
    assert (found["comply_hold_ratio"].points, found["comply_hold_ratio"].energy_kwh) == (0.0, 0.0)
    assert found["friction_ratio"].points > 0.1
    assert found["haste_ratio"].energy_kwh > 0.1
    assert not math.isnan(found["haste_ratio"].interval_points)
    assert any(line.startswith("| none | `friction_ratio` (±20 %) | 0.32 | 0.48 | +") for line in table(listed))


def test_only_one_parameter_is_off_its_middle(flat: Callable[[str], Path], tmp_path: Path) -> None:
    middles, varied = middle(POPULATION), variations(POPULATION)
    made = list(jobs(asked(flat("")), varied, tmp_path))
    assert len(made) == 2 * 3 * len(varied)
    for name, job in made:
        off = {one for one, value in job.trial.setting.human if value != middles.get(one)}
        assert off == {name}


def test_a_parameter_that_cannot_be_varied_is_named() -> None:
    with pytest.raises(DasError, match="--parameters notches: expected one of reaction_median_s, "):
        variations(POPULATION, ["notches"])
