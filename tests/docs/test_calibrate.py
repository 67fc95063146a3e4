"""The calibration: the bundled vehicles against every published target, and its first stage again."""

from __future__ import annotations

import pytest

from das.domain.files.load import load_vehicle
from docs.studies import calibrate
from docs.studies import calibration_targets as paper
from docs.studies.calibrate import STAGE_1_START, chain_of, value_of, with_values
from docs.studies.cases import GTO_VEHICLE, IGBT_VEHICLE


def test_the_bundled_vehicles_meet_every_published_target() -> None:
    gto, chain = load_vehicle(GTO_VEHICLE), chain_of(GTO_VEHICLE)
    figures = paper.evaluate(gto, chain, load_vehicle(IGBT_VEHICLE), paper.other_runs(gto))
    missed = [target for target in paper.TARGETS if not target.met(figures[target.name])]
    said = [f"{one.name}: {figures[one.name]:.4f}, accepted {one.low:g} … {one.high:g}" for one in missed]
    assert not said, "\n".join(said)


@pytest.mark.slow
def test_stage_1_from_its_start_gives_the_bundled_parameters_again() -> None:
    bundled = chain_of(GTO_VEHICLE)
    start = with_values(bundled, STAGE_1_START)
    assert any(value_of(start, name) != value_of(bundled, name) for name in STAGE_1_START)
    solved = calibrate.rounded(calibrate.solve_stage_1(load_vehicle(GTO_VEHICLE), start), STAGE_1_START)
    for name in STAGE_1_START:
        assert value_of(solved, name) == pytest.approx(value_of(bundled, name), rel=2e-4), name
