"""From what the command line says to a section: route, train, overrides, level."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from das.command_line.loading import load_route, load_vehicle
from das.domain.units import KMH, KN, KW
from precompute.cli.options import EndsOptions, GridOptions, LineOptions, TrainOptions, WorldOptions

if TYPE_CHECKING:
    from das.domain.conditions import Conditions
    from das.domain.route import Route
    from das.domain.vehicle import EffortEnvelope, Vehicle
    from das.solver.section import Section


@dataclass(frozen=True, kw_only=True)
class TrainOnLine:
    """A train on a line as a user poses it."""

    where: LineOptions
    driven: TrainOptions
    world: WorldOptions

    def inputs(self) -> tuple[str | Path | None, ...]:
        """Names of bundled files, or paths, of all that is read: no output may replace one of them."""
        return self.where.route, self.driven.vehicle, self.driven.loss_map

    def conditions(self) -> Conditions:
        """What differs from the files; raises DasError where it cannot be."""
        from das.domain.conditions import Conditions

        world = self.world
        return Conditions(
            mass_ratio=world.mass_ratio,
            resistance_ratio=world.resistance_ratio,
            head_wind_mps=world.head_wind_kmh * KMH,
            receptivity_ratio=world.receptivity_ratio,
            adhesion_ratio=world.adhesion_ratio,
        )

    def route(self, conditions: Conditions | None = None) -> Route:
        """The route, driven the way asked for, under the user's or other conditions."""
        route = (conditions or self.conditions()).line(load_route(self.where.route))
        return route.reversed() if self.where.reverse else route

    def vehicle(self, conditions: Conditions | None = None) -> Vehicle:
        """The loaded vehicle with the overrides, under the user's or other conditions.

        A loss map changes its losses and nothing else.
        """
        from das.domain.files.loss_map_csv import read_loss_map
        from das.domain.vehicle import BrakePolicy

        asked = self.driven
        vehicle = load_vehicle(asked.vehicle)
        if asked.load is not None:
            vehicle = vehicle.loaded(asked.load)
        if asked.loss_map is not None:
            vehicle = vehicle.with_loss_map(read_loss_map(asked.loss_map))
        power_w = asked.max_power_kw * KW if asked.max_power_kw is not None else None
        changed = replace(
            vehicle,
            traction=_changed(vehicle.traction, asked.max_force_kn, power_w),
            electric_brake=_changed(vehicle.electric_brake, asked.max_brake_force_kn, power_w),
            max_speed_mps=asked.max_speed_kmh * KMH if asked.max_speed_kmh is not None else vehicle.max_speed_mps,
            brake_policy=BrakePolicy.ELECTRIC if asked.no_friction_brake else vehicle.brake_policy,
        )
        return (conditions or self.conditions()).train(changed)


@dataclass(frozen=True, kw_only=True)
class Pose(TrainOnLine):
    """One section as a user poses it."""

    ends: EndsOptions
    grid: GridOptions

    def section(self, conditions: Conditions | None = None) -> Section:
        """Read the files and build the section (default: the user's conditions); DasError for anything unusable."""
        from das.domain.route import section_stops
        from das.solver.section import SectionOptions, build_section

        route, ends = self.route(conditions), self.ends
        start, end = section_stops(route, ends.from_stop, ends.to_stop)
        return build_section(
            route,
            self.vehicle(conditions),
            level=self.driven.level,
            start_m=start.position_m,
            end_m=end.position_m,
            options=SectionOptions(
                start_speed_mps=_either(ends.start_speed_mps, ends.boundary_speed_mps),
                end_speed_mps=_either(ends.end_speed_mps, ends.boundary_speed_mps),
                point_mass=self.driven.point_mass,
                longest_step_m=self.grid.step_m,
            ),
        )


def _either(own_mps: float | None, both_mps: float) -> float:
    return both_mps if own_mps is None else own_mps


def _changed(envelope: EffortEnvelope, force_kn: float | None, power_w: float | None) -> EffortEnvelope:
    return replace(
        envelope,
        max_force_n=force_kn * KN if force_kn is not None else envelope.max_force_n,
        max_power_w=power_w if power_w is not None else envelope.max_power_w,
    )
