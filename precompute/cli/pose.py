"""From what the command line says to a section: route, train, overrides, level."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from das.command_line.running import warn_unusual
from das.domain.conditions import Conditions
from das.domain.files.load import load_route, load_vehicle
from das.domain.files.loss_map_csv import read_loss_map
from das.domain.losses import Level
from das.domain.route import Route, section_stops
from das.domain.units import KMH, KN, KW
from das.domain.vehicle import BrakePolicy, EffortEnvelope, Vehicle
from das.solver.section import Section, SectionOptions, build_section


@dataclass(frozen=True, kw_only=True)
class Pose:
    """One problem as posed by a user; None = as the files say."""

    route: str
    vehicle: str
    from_stop: str | None = None
    to_stop: str | None = None
    reverse: bool = False
    level: Level | None = None
    loss_map: Path | None = None
    point_mass: bool = False
    boundary_speed_mps: float = 0.0
    start_speed_mps: float | None = None
    end_speed_mps: float | None = None
    max_power_kw: float | None = None
    max_force_kn: float | None = None
    max_brake_force_kn: float | None = None
    max_speed_kmh: float | None = None
    no_friction_brake: bool = False
    load: str | None = None
    mass_ratio: float = 1.0
    resistance_ratio: float = 1.0
    head_wind_kmh: float = 0.0
    receptivity_ratio: float = 1.0
    adhesion_ratio: float = 1.0

    def conditions(self) -> Conditions:
        """What differs from the files; raises DasError where it cannot be."""
        return Conditions(
            mass_ratio=self.mass_ratio,
            resistance_ratio=self.resistance_ratio,
            head_wind_mps=self.head_wind_kmh * KMH,
            receptivity_ratio=self.receptivity_ratio,
            adhesion_ratio=self.adhesion_ratio,
        )

    def line(self, conditions: Conditions | None = None) -> Route:
        """The route, driven the way asked for, under the pose's or other conditions."""
        read = load_route(self.route)
        warn_unusual(read)
        route = (conditions or self.conditions()).line(read)
        return route.reversed() if self.reverse else route

    def section(self, conditions: Conditions | None = None) -> Section:
        """Read the files and build the section (default: the pose's conditions); DasError for anything unusable."""
        route = self.line(conditions)
        start, end = section_stops(route, self.from_stop, self.to_stop)
        return build_section(
            route,
            self.train(conditions),
            level=self.level,
            start_m=start.position_m,
            end_m=end.position_m,
            options=SectionOptions(
                start_speed_mps=self._end_speed(self.start_speed_mps),
                end_speed_mps=self._end_speed(self.end_speed_mps),
                point_mass=self.point_mass,
            ),
        )

    def _end_speed(self, speed_mps: float | None) -> float:
        return self.boundary_speed_mps if speed_mps is None else speed_mps

    def train(self, conditions: Conditions | None = None) -> Vehicle:
        """The loaded vehicle with the overrides, under the pose's or other conditions.

        A loss map changes its losses and nothing else.
        """
        vehicle = load_vehicle(self.vehicle)
        warn_unusual(vehicle)
        if self.load is not None:
            vehicle = vehicle.loaded(self.load)
        if self.loss_map is not None:
            vehicle = vehicle.with_loss_map(read_loss_map(self.loss_map))
        traction, electric = vehicle.traction, vehicle.electric_brake
        power_w = self.max_power_kw * KW if self.max_power_kw is not None else None
        changed = replace(
            vehicle,
            traction=_changed(traction, self.max_force_kn, power_w),
            electric_brake=_changed(electric, self.max_brake_force_kn, power_w),
            max_speed_mps=self.max_speed_kmh * KMH if self.max_speed_kmh is not None else vehicle.max_speed_mps,
            brake_policy=BrakePolicy.ELECTRIC if self.no_friction_brake else vehicle.brake_policy,
        )
        return (conditions or self.conditions()).train(changed)


def _changed(envelope: EffortEnvelope, force_kn: float | None, power_w: float | None) -> EffortEnvelope:
    return EffortEnvelope(
        max_force_n=force_kn * KN if force_kn is not None else envelope.max_force_n,
        max_power_w=power_w if power_w is not None else envelope.max_power_w,
    )
