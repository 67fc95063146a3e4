"""The human drivers of a scenario: parameters that differ from the defaults; every seed draws one driver."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from das.domain.errors import DasError, InputError
from das.domain.files.reading import Fields
from sim.drivers.parameters import HumanParameters
from sim.drivers.population import Participant
from sim.world.drawn import Drawn, read_range

STREAM = 4
"""Number of the stream of random numbers, among those of a seed, from which the driver is drawn."""
TRIPS = "trips"
COUNTED = ("notches",)
"""Parameters that are whole numbers."""


@dataclass(frozen=True, kw_only=True)
class HumanRange:
    """Parameters of human drivers by name, and `trips`, the trips that a driver has made before.

    A parameter that is not given has its default.
    """

    given: Mapping[str, Drawn]

    def draw(self, seed: int) -> tuple[HumanParameters, dict[str, float]]:
        """The driver of a seed, and the drawn values of the parameters that are given."""
        random = np.random.default_rng([seed, STREAM])
        drawn = {name: figure.draw(random) for name, figure in self.given.items()}
        return _driver(drawn), drawn

    def of(self, seed: int, who: Participant | None, source: Path) -> tuple[HumanParameters, dict[str, float]]:
        """The driver that a participant is, or without one the driver of a seed; and the values that make him."""
        return self.draw(seed) if who is None else self.participant(who, source)

    def participant(self, who: Participant, source: Path) -> tuple[HumanParameters, dict[str, float]]:
        """The driver that a participant is, and the values that make him.

        Values of the scenario (`source`) replace those of the population. Raises DasError where the scenario gives a
        range, from which every seed would draw another driver, or where the values contradict each other.
        """
        for name, figure in self.given.items():
            if figure.low != figure.high:
                expected = "expected one value, because a participant stays the same on every day"
                raise DasError(f"{source}: human.{name} is a range: {expected}")
        fixed = {name: figure.low for name, figure in self.given.items()}
        values = who.population.draw(who.number) | fixed
        try:
            return _driver(values), {"participant": who.number, **values}
        except InputError as error:
            raise DasError(f"{who.population.source}: participant {who.number}: {error}") from None


def read_human(table: Fields) -> HumanRange:
    """Read the table `[human]` of a scenario; raises InputError or DasError for anything unusable."""
    table.check_keys([TRIPS, *(item.name for item in fields(HumanParameters))])
    given = {name: read_range(table, name) for name in table.data}
    for name, figure in given.items():
        if name in COUNTED and figure.low != figure.high:
            raise table.error(name, table.data[name], "one whole number")
    lows = {name: figure.low for name, figure in given.items()}
    highs = {name: figure.high for name, figure in given.items()}
    # The mean of a glance must be above the least even where they are drawn nearest to each other.
    nearest = lows | {name: highs[name] for name in ("glance_least_s",) if name in highs}
    for ends in (nearest, highs):
        try:
            _driver(ends)
        except InputError as error:
            raise DasError(f"{table.source}: {str(error).replace('human driver: ', table.prefix, 1)}") from None
    return HumanRange(given=given)


def _driver(values: Mapping[str, float]) -> HumanParameters:
    of_driver: dict[str, Any] = {name: value for name, value in values.items() if name != TRIPS}
    counted = {name: int(of_driver[name]) for name in COUNTED if name in of_driver and of_driver[name] % 1 == 0}
    return HumanParameters(**(of_driver | counted)).after(values.get(TRIPS, 0.0))
