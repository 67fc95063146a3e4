"""The sections of a day's true train; a train that cannot be driven on them is refused before it sets off."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from das.domain.conditions import Conditions
from das.domain.errors import DasError, RunawayError
from das.domain.levels import Level
from das.domain.route import Route, Stop
from das.domain.vehicle import Vehicle
from das.solver.section import Section, build_section
from sim.world.drawn import Truth
from sim.world.scenario import Scenario

AS_PLANNED = Conditions()
MASS_STEP_RATIO = 0.01
"""The largest mass that the brakes hold is given in such steps of the mass ratio."""


def check_train(
    scenario: Scenario, route: Route, stops: Sequence[Stop], planned: tuple[Vehicle, Level], conditions: Conditions
) -> None:
    """Raise DasError, as `true_sections` does, if the true train is not the planned one and cannot be driven."""
    if not (scenario.truth.is_as_planned and conditions.changes_nothing):
        true_sections(scenario, route, stops, planned, conditions)


def true_sections(
    scenario: Scenario, route: Route, stops: Sequence[Stop], planned: tuple[Vehicle, Level], conditions: Conditions
) -> tuple[Section, ...]:
    """The sections between the stops for the true train, where a train and its level of losses are planned.

    Raises DasError, which names the scenario's keys, for a train that cannot be driven under the conditions: its brakes
    do not hold it on a descent, it stalls, or its losses do not cover what it can do.
    """
    vehicle, level = scenario.truth.train(*planned)

    def sections(mass_ratio: float) -> tuple[Section, ...]:
        changed = replace(conditions, mass_ratio=mass_ratio)
        line, train = changed.line(route), changed.train(vehicle)
        return tuple(
            build_section(line, train, level=level, start_m=a.position_m, end_m=b.position_m)
            for a, b in pairwise(stops)
        )

    try:
        return sections(conditions.mass_ratio)
    except DasError as error:
        most = _most_mass(sections, conditions.mass_ratio) if isinstance(error, RunawayError) else ""
        changed = ", ".join(_changed(scenario.truth, conditions, most))
        raise DasError(f"{scenario.source}: {changed or 'truth'}: the true train: {error}") from None


def _most_mass(sections: Callable[[float], tuple[Section, ...]], mass_ratio: float) -> str:
    """What is expected of the mass of a train that its brakes do not hold; empty if no smaller mass helps."""

    def too_heavy(ratio: float) -> bool:
        try:
            sections(ratio)
        except DasError:
            return True
        return False

    ratios = np.arange(MASS_STEP_RATIO, mass_ratio, MASS_STEP_RATIO)
    held = bisect_left(ratios, True, key=too_heavy)
    return f" (expected at most {ratios[held - 1]:.2f})" if held else ""


def _changed(truth: Truth, conditions: Conditions, most_mass: str) -> Iterator[str]:
    """What the scenario changes about the train: each key with its value, and between what this is drawn."""
    for name, drawn in truth.conditions.items():
        value = getattr(conditions, name)
        if value != getattr(AS_PLANNED, name):
            ends = "" if drawn.low == drawn.high else f", drawn from {drawn.low:g} to {drawn.high:g}"
            yield f"truth.{name} = {value:.4g}{ends}{most_mass if name == 'mass_ratio' else ''}"
    for name in ("vehicle", "load"):
        if getattr(truth, name) is not None:
            yield f"truth.{name} = {getattr(truth, name)}"
