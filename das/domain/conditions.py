"""Conditions that may differ from the files: load, resistance, wind, receptivity, adhesion."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from das.domain.errors import DasError
from das.domain.route import Route, Stretches
from das.domain.vehicle import Vehicle

BOUNDS = {
    "mass_ratio": (0.01, 10.0),
    "resistance_ratio": (0.01, 10.0),
    "receptivity_ratio": (0.0, 1.0),
    "adhesion_ratio": (0.01, 10.0),
    "head_wind_mps": (-50.0, 50.0),
}
"""Least and greatest value of each condition, in the order in which a scenario draws them."""


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """Changes to a train and a line relative to their files; the defaults change nothing.

    `mass_ratio` and `resistance_ratio` multiply the mass and the running resistance, `receptivity_ratio` the share of
    the power fed back that the line accepts, and `adhesion_ratio` the adhesion of the rail. `head_wind_mps` is the
    speed of the wind against the train (tail wind < 0).
    """

    mass_ratio: float = 1.0
    resistance_ratio: float = 1.0
    head_wind_mps: float = 0.0
    receptivity_ratio: float = 1.0
    adhesion_ratio: float = 1.0

    def __post_init__(self) -> None:
        for name, (least, most) in BOUNDS.items():
            if not least <= (value := getattr(self, name)) <= most:
                raise DasError(f"conditions: {name} = {value}: expected {least:g} to {most:g}")

    @property
    def changes_nothing(self) -> bool:
        """Whether the train and the line remain as in their files."""
        return self == Conditions()

    def train(self, vehicle: Vehicle) -> Vehicle:
        """The train under these conditions.

        Raises DasError for a changed adhesion if the train's file does not state the mass on the driven axles.
        """
        if self.adhesion_ratio != 1 and np.isinf(vehicle.adhesive_mass_kg):
            raise DasError(f"{vehicle.source}: adhesion is missing: expected [adhesion] adhesive_mass_t in the file")
        if self.mass_ratio != 1:
            vehicle = vehicle.with_mass(self.mass_ratio * vehicle.mass_kg)
        return replace(
            vehicle,
            resistance=vehicle.resistance.scaled(self.resistance_ratio).in_head_wind(self.head_wind_mps),
            adhesion_ratio=self.adhesion_ratio * vehicle.adhesion_ratio,
        )

    def line(self, route: Route) -> Route:
        """The route under these conditions."""
        if self.receptivity_ratio == 1:
            return route
        given = route.receptivity_ratio
        taken = Stretches(start_m=given.start_m.copy(), value=self.receptivity_ratio * given.value)
        return replace(route, receptivity_ratio=taken)
