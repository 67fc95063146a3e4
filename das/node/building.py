"""The cab that a node is started with: the line, the trains and the settings that its options name."""

from __future__ import annotations

from dataclasses import dataclass

from das.advice.coach.settings import CoachSettings
from das.advice.settings import AdviceSettings
from das.cab.cab import Cab, CabSettings, no_stopwatch
from das.cab.fronts import Fronts
from das.cab.orders import Post
from das.cab.situation import Situation
from das.cab.trains import Trains
from das.command_line.loading import load_route, load_vehicle, warn_of_braking, warn_unusual
from das.domain.braking import SiteBraking
from das.domain.clocks import WALL_STOPWATCH
from das.domain.files.loss_map_csv import read_loss_map
from das.domain.route import Route, section_stops
from das.domain.units import KMH
from das.domain.vehicle import Vehicle
from das.node.options import AdviceGiven, ClockKind, LineServed, NodeOptions, TrainServed


@dataclass(frozen=True, kw_only=True, eq=False)
class CabPlan:
    """What a cab is made of. `stops_m` are the positions (m) of the stops that the node is for."""

    post: Post
    situation: Situation
    fronts: Fronts
    settings: CabSettings
    stops_m: list[float]

    def cab(self) -> Cab:
        """A new cab, which has heard nothing."""
        return Cab(self.post, self.situation, self.fronts, self.settings)


def plan_cab(options: NodeOptions) -> CabPlan:
    """Read what the options name. Raises DasError for anything that cannot be used."""
    line, driven, advice = options.line, options.driven, options.advice
    route, stops_m = _line(line)
    base = _vehicle(driven)
    started = base if driven.load is None else base.loaded(driven.load)
    trains = Trains(started, base, driven.other_vehicle or ())
    warn_unusual(*trains.known)
    for vehicle in trains.known:
        warn_of_braking(vehicle)
    return CabPlan(
        post=Post(train=options.place.train, route=route, trains=trains, reverse=line.reverse),
        situation=Situation(
            route=route,
            vehicle=started,
            level=driven.level,
            point_mass=driven.point_mass,
            braking=SiteBraking(
                deceleration_mps2=advice.led.planning_brake,
                reaction_s=advice.led.reaction,
                below_limit_mps=advice.led.below_limit * KMH,
            ),
        ),
        fronts=Fronts(advice.tables),
        settings=_settings(advice),
        stops_m=stops_m,
    )


def _line(line: LineServed) -> tuple[Route, list[float]]:
    """The route in the direction it is driven, and the positions (m) of the stops the node is for."""
    route = load_route(line.route)
    route = route.reversed() if line.reverse else route
    start, end = section_stops(route, line.from_stop, line.to_stop)
    return route, [x.position_m for x in route.stops if start.position_m <= x.position_m <= end.position_m]


def _vehicle(driven: TrainServed) -> Vehicle:
    """The train without a load state."""
    vehicle = load_vehicle(driven.vehicle)
    return vehicle.with_loss_map(read_loss_map(driven.loss_map)) if driven.loss_map is not None else vehicle


def _settings(advice: AdviceGiven) -> CabSettings:
    by_wall = advice.clock is ClockKind.WALL
    return CabSettings(
        advice_period_s=1.0 / advice.rate,
        no_restrictions=advice.no_restrictions,
        calibrate=advice.calibrate,
        background=by_wall,
        advice=AdviceSettings(coach=CoachSettings(enabled=advice.led.coach)),
        stopwatch=WALL_STOPWATCH if by_wall else no_stopwatch,
    )
