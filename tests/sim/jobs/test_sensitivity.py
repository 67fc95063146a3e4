"""How much each parameter matters: only what is varied changes, and what has no effect changes nothing at all."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest

from das.domain.errors import DasError
from sim.drivers.kinds import FrictionPolicy, Presentation
from sim.drivers.parameters import load_population
from sim.jobs.sensitivity import Study, drive, middle_driver, sensitivities, sensitivity_markdown, variations


def study(path: Path, *parameters: str) -> Study:
    return Study(
        scenario=path, level=None, seeds=[0, 1, 2], advice=[Presentation.NONE], friction=FrictionPolicy.AS_MEASURED,
        population=load_population("default"), parameters=parameters,
    )  # fmt: skip


@pytest.mark.nightly
def test_what_matters_is_found_and_what_does_not_changes_nothing(flat: Callable[[str], Path]) -> None:
    """Without advice nobody complies with any: on the same days with the same chances the runs are the same."""
    asked = study(flat(""), "haste_ratio", "comply_hold_ratio", "friction_ratio")
    found = {one.variation.name: one for one in sensitivities(asked, map(drive, asked.jobs()))}
    assert list(found)[-1] == "comply_hold_ratio"
    assert (found["comply_hold_ratio"].points, found["comply_hold_ratio"].energy_kwh) == (0.0, 0.0)
    assert found["friction_ratio"].points > 0.1
    assert found["haste_ratio"].energy_kwh > 0.1
    assert not math.isnan(found["haste_ratio"].interval_points)
    assert "| none | `friction_ratio` (±20 %) | 0.32 | 0.48 | +" in sensitivity_markdown(list(found.values()))


def test_only_one_parameter_is_off_its_middle(flat: Callable[[str], Path]) -> None:
    population = load_population("default")
    middle = vars(middle_driver(population))
    asked = study(flat(""))
    names = [one.name for one in variations(population)]
    jobs = list(Study(**{**vars(asked), "parameters": None}).jobs())
    assert len(jobs) == 2 * 3 * len(names)
    for job in jobs:
        assert {name for name, value in vars(job.human).items() if value != middle[name]} <= {job.name}


def test_a_parameter_that_cannot_be_varied_is_named() -> None:
    with pytest.raises(DasError, match="--parameters notches: expected one of reaction_median_s, "):
        variations(load_population("default"), ["notches"])
