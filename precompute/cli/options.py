"""Options that only das-precompute has, in groups, and the route, train and section that they describe."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from das.command_line.files import load_route, load_vehicle
from das.command_line.given import refuse_given
from das.command_line.options import (
    FromOption,
    LevelOption,
    LoadOption,
    LossMapOption,
    ModeOption,
    PointMassOption,
    ReverseOption,
    RouteArgument,
    ToOption,
    VehicleArgument,
)
from das.domain.errors import DasError
from das.domain.units import KMH, KN, KW

if TYPE_CHECKING:
    from das.domain.conditions import Conditions
    from das.domain.effort import EffortEnvelope
    from das.domain.route import Route
    from das.domain.vehicle import Vehicle
    from das.solver.section import Section


MOST_PERCENT = 1e4
FASTEST_END_MPS = 200.0
LARGEST = 1e9
"""Upper bound of powers (kW), forces (kN) and speeds (km/h) on the command line."""
SHORTEST_STEP_M, LONGEST_STEP_M = 5.0, 150.0
"""Range of the decision steps that `--step` accepts (m)."""

TimeOption = Annotated[float | None, typer.Option("--time", metavar="S", help="Trip time in s.")]
BufferOption = Annotated[
    float | None, typer.Option("--buffer", metavar="PERCENT", help="Trip time as % above the least possible one.")
]
RefineOption = Annotated[
    str,
    typer.Option(
        "--refine",
        metavar="off|on|SECONDS",
        help="Refine optimal runs beyond the solver's table until savings are small, or at most for this many seconds.",
    ),
]

BoundOption = Annotated[
    str,
    typer.Option(
        "--bound",
        metavar="quick|tight|SECONDS",
        help="Prove a tighter bound for a loss map: until gains are small (minutes), or for about this many seconds.",
    ),
]


@dataclass(frozen=True, kw_only=True)
class LineOptions:
    """Which line is driven, and in which direction; `reverse`: from its end to its start."""

    route: RouteArgument
    reverse: ReverseOption = False


@dataclass(frozen=True, kw_only=True)
class EndsOptions:
    """Where a section begins and ends, and how fast the train is there (m/s).

    A stop of None is the first or last of the route; a start or end speed of None is `boundary_speed_mps`. Raises
    DasError for an impossible speed.
    """

    from_stop: FromOption = None
    to_stop: ToOption = None
    boundary_speed_mps: Annotated[float, typer.Option(help="Speed at both ends of the section in m/s.")] = 0.0
    start_speed_mps: Annotated[float | None, typer.Option(help="Speed at the start only in m/s.")] = None
    end_speed_mps: Annotated[float | None, typer.Option(help="Speed at the end only in m/s.")] = None

    def __post_init__(self) -> None:
        for name in ("boundary_speed_mps", "start_speed_mps", "end_speed_mps"):
            value = getattr(self, name)
            if value is not None and not 0 <= value < FASTEST_END_MPS:
                raise DasError(f"{_spelled(name)} {value}: expected a speed from 0 to {FASTEST_END_MPS:g} m/s")
        if None not in (self.start_speed_mps, self.end_speed_mps):
            refuse_given("--start-speed-mps and --end-speed-mps give both speeds", "--boundary-speed-mps")


@dataclass(frozen=True, kw_only=True)
class GridOptions:
    """How finely the solver decides. Raises DasError for an impossible step."""

    step_m: Annotated[
        float | None,
        typer.Option(
            "--step",
            metavar="M",
            help="Largest decision step in m: 25 for dense limits, steep gradients, short sections "
            "[default: 3.2 s of the fastest run, by the line, at most 150 m].",
            show_default=False,
        ),
    ] = None

    def __post_init__(self) -> None:
        if self.step_m is not None and not SHORTEST_STEP_M <= self.step_m <= LONGEST_STEP_M:
            raise DasError(f"--step {self.step_m:g}: expected a step from {SHORTEST_STEP_M:g} to {LONGEST_STEP_M:g} m")


@dataclass(frozen=True, kw_only=True)
class TrainOptions:
    """Which train runs, and what differs from its file; None = as in the file.

    Raises DasError for an impossible value.
    """

    vehicle: VehicleArgument
    level: LevelOption = None
    loss_map: LossMapOption = None
    load: LoadOption = None
    mode: ModeOption = None
    point_mass: PointMassOption = False
    max_power_kw: Annotated[
        float | None, typer.Option(help="Largest power of traction and of the electric brake in kW.")
    ] = None
    max_force_kn: Annotated[float | None, typer.Option(help="Largest traction force in kN.")] = None
    max_brake_force_kn: Annotated[float | None, typer.Option(help="Largest force of the electric brake in kN.")] = None
    max_speed_kmh: Annotated[float | None, typer.Option(help="Largest speed of the train in km/h.")] = None
    no_friction_brake: Annotated[bool, typer.Option("--no-friction-brake", help="Brake with the motors only.")] = False

    def __post_init__(self) -> None:
        for name in ("max_power_kw", "max_force_kn", "max_brake_force_kn", "max_speed_kmh"):
            value = getattr(self, name)
            if value is not None and not 0 < value < LARGEST:
                raise DasError(f"{_spelled(name)} {value}: expected a number > 0 and below 1e9")


@dataclass(frozen=True, kw_only=True)
class WorldOptions:
    """What differs from the files about load, weather, supply and rail; the defaults change nothing."""

    mass_ratio: Annotated[float, typer.Option("--mass", help="Mass, as a multiple of the file's.")] = 1.0
    resistance_ratio: Annotated[
        float, typer.Option("--resistance", help="Running resistance, as a multiple of the file's.")
    ] = 1.0
    head_wind_kmh: Annotated[float, typer.Option(help="Wind against the train in km/h; tail wind is negative.")] = 0.0
    receptivity_ratio: Annotated[
        float, typer.Option("--receptivity", help="Share of the recovered power that the line accepts, 0 to 1.")
    ] = 1.0
    adhesion_ratio: Annotated[
        float, typer.Option("--adhesion", help="Adhesion, as a multiple of that on dry rail.")
    ] = 1.0


@dataclass(frozen=True, kw_only=True)
class TripTime:
    """The time in which a section is driven: in s, or in % above the least possible time."""

    time_s: TimeOption = None
    buffer_percent: BufferOption = None

    def check(self, *, needed: bool) -> None:
        """Raise DasError if both are given, or if neither is given although a time is `needed`."""
        given = (self.time_s is not None) + (self.buffer_percent is not None)
        if given > 1 or (needed and not given):
            raise DasError("give either --time (s) or --buffer (%)")

    def wanted_s(self, min_time_s: float) -> float | None:
        """The trip time (s) asked for, given the least time; None if none was. DasError for an impossible buffer."""
        return self.time_s if self.buffer_percent is None else buffered(min_time_s, self.buffer_percent)


def buffered(min_time_s: float, buffer_percent: float) -> float:
    """Trip time (s) of a buffer in % on the least time; DasError for an impossible buffer."""
    if not 0 <= buffer_percent < MOST_PERCENT:
        raise DasError(f"buffer {buffer_percent} %: expected a number from 0 to {MOST_PERCENT:.0f}")
    return min_time_s * (1 + buffer_percent / 100)


def refine_seconds(text: str) -> float:
    """The seconds that `--refine` allows: a number, 0 for off, or inf for on; DasError for any other text."""
    return _seconds("--refine", text, "off", "on")


def bound_seconds(text: str) -> float:
    """The seconds that `--bound` allows: a number, 0 for quick, or inf for tight; DasError for any other text."""
    return _seconds("--bound", text, "quick", "tight")


def _seconds(option: str, text: str, none: str, unlimited: str) -> float:
    """A budget of time (s) as an option gives it: seconds, a word for none, or a word for no limit."""
    if text in (none, unlimited):
        return math.inf if text == unlimited else 0.0
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not 0 <= seconds < LARGEST:
        raise DasError(f"{option} {text}: expected {none}, {unlimited}, or a number of seconds from 0")
    return seconds


def numbers(option: str, text: str) -> list[float]:
    """The numbers of an option's comma-separated list; DasError for anything that is not a number."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise DasError(f"{option} {text}: expected numbers separated by commas, like 0,5,10") from None


def buffer_numbers(text: str) -> list[float]:
    """The buffers (%) that `--buffers` lists; DasError for an impossible buffer or anything that is not a number."""
    values = numbers("--buffers", text)
    for value in values:
        buffered(1.0, value)
    return values


def _spelled(name: str) -> str:
    return f"--{name.replace('_', '-')}"


@dataclass(frozen=True, kw_only=True)
class TrainOnLine:
    """A train on a line, as the options describe them."""

    where: LineOptions
    driven: TrainOptions
    world: WorldOptions

    def inputs(self) -> tuple[str | Path | None, ...]:
        """All files that are read, by bundled name or path: no output may replace one of them."""
        return self.where.route, self.driven.vehicle, self.driven.loss_map

    def conditions(self) -> Conditions:
        """What differs from the files; raises DasError if it is impossible."""
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
        """The route in the direction asked for, under given conditions (default: the user's)."""
        route = (conditions or self.conditions()).line(load_route(self.where.route))
        return route.reversed() if self.where.reverse else route

    def vehicle(self, conditions: Conditions | None = None) -> Vehicle:
        """The loaded vehicle with the overrides, under given conditions (default: the user's).

        A loss map changes the vehicle's losses and nothing else.
        """
        from das.domain.files.vehicles import read_loss_map
        from das.domain.vehicle import BrakePolicy

        asked = self.driven
        vehicle = picked(load_vehicle(asked.vehicle), asked.mode, asked.load)
        if asked.loss_map is not None:
            vehicle = vehicle.with_loss_map(read_loss_map(asked.loss_map))
        power_w = asked.max_power_kw * KW if asked.max_power_kw is not None else None
        if not (power_w or vehicle.electric_brake.max_power_w):
            refuse_given(f"{vehicle.id} has no electric brake", "--max-brake-force-kn")
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
    """One section and the train on it, as the options describe them."""

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


def picked(vehicle: Vehicle, mode: str | None, load: str | None) -> Vehicle:
    """The vehicle in a mode and a load state; None leaves it as its file says. DasError if there is none."""
    if load is not None and vehicle.modes.keys() & set(load.split("+")):
        refuse_given(f"--load {load} also names a mode", "--mode")
    vehicle = vehicle if mode is None else vehicle.in_mode(mode)
    return vehicle if load is None else vehicle.loaded(load)


def _either(own_mps: float | None, both_mps: float) -> float:
    return both_mps if own_mps is None else own_mps


def _changed(envelope: EffortEnvelope, force_kn: float | None, power_w: float | None) -> EffortEnvelope:
    """The envelope with another largest force or power; DasError for more than an effort curve has."""
    if envelope.curve is not None:
        force_n = force_kn * KN if force_kn is not None else 0.0
        if force_n > envelope.max_force_n or (power_w or 0.0) > envelope.max_power_w:
            most = f"{envelope.max_force_n / KN:g} kN and {envelope.max_power_w / KW:g} kW"
            raise DasError(f"the effort curve of the train has at most {most}: options can lower it, not raise it")
    return replace(
        envelope,
        max_force_n=force_kn * KN if force_kn is not None else envelope.max_force_n,
        max_power_w=power_w if power_w is not None else envelope.max_power_w,
    )
