"""Options that only das-precompute has, in groups: a train on a section, and the files that commands write."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from das.command_line.application import refuse_given
from das.command_line.files import check_outputs, check_picture, load_route, load_vehicle
from das.command_line.options import (
    FromOption,
    JsonOption,
    LevelOption,
    LoadOption,
    LossMapOption,
    ModeOption,
    OverwriteOption,
    PlotOption,
    ReverseOption,
    RouteArgument,
    ToOption,
    VehicleArgument,
)
from das.command_line.printing import tell
from das.domain.errors import DasError
from das.domain.units import KMH

if TYPE_CHECKING:
    from das.domain.conditions import Conditions
    from das.domain.route import Route
    from das.domain.vehicle import Vehicle
    from das.solver.section import Section


MOST_PERCENT = 1e4

RefineOption = Annotated[
    str, typer.Option("--refine", metavar="off|on", help="Refine optimal runs beyond the solver's table.")
]


@dataclass(frozen=True, kw_only=True)
class LineOptions:
    """The line that is driven, and its direction; `reverse`: from its end to its start."""

    route: RouteArgument
    reverse: ReverseOption = False


@dataclass(frozen=True, kw_only=True)
class OnRoute:
    """The route of a journey, and its direction there."""

    route: Annotated[
        str | None,
        typer.Option(metavar="ROUTE", help="Route of the journey: bundled, TOML file or TTOBench track (JSON)."),
    ] = None
    reverse: Annotated[bool, typer.Option("--reverse", help="The journey runs from the route's end to its start.")] = (
        False
    )

    def line(self) -> Route | None:
        """The route that is named, in the direction of the journey; DasError if it is unusable."""
        if self.route is None:
            if self.reverse:
                raise DasError("--reverse: needs --route")
            return None
        found = load_route(self.route)
        return found.reversed() if self.reverse else found

    def words(self) -> str:
        """The options as typed for a command that plans or drives the journey."""
        return f"{self.route or 'ROUTE'} VEHICLE{' --reverse' if self.reverse else ''}"


@dataclass(frozen=True, kw_only=True)
class EndsOptions:
    """The stops where a section begins and ends; None: the first and the last of the route."""

    from_stop: FromOption = None
    to_stop: ToOption = None


@dataclass(frozen=True, kw_only=True)
class TrainOptions:
    """The train, and differences from its file; None = as in the file."""

    vehicle: VehicleArgument
    level: LevelOption = None
    loss_map: LossMapOption = None
    load: LoadOption = None
    mode: ModeOption = None


@dataclass(frozen=True, kw_only=True)
class WorldOptions:
    """Differences from the files in load, weather, supply and rail; the defaults change nothing."""

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

    time_s: Annotated[float | None, typer.Option("--time", metavar="S", help="Trip time in s.")] = None
    buffer_percent: Annotated[
        float | None, typer.Option("--buffer", metavar="PERCENT", help="Trip time as % above the least possible one.")
    ] = None

    def check(self, *, needed: bool) -> None:
        """Raise DasError if both are given, or if neither is given although a time is `needed`."""
        given = (self.time_s is not None) + (self.buffer_percent is not None)
        if given > 1 or (needed and not given):
            raise DasError("give either --time (s) or --buffer (%)")

    def wanted_s(self, min_time_s: float) -> float | None:
        """The requested trip time (s), given the least time; None if not given. DasError for an impossible buffer."""
        return self.time_s if self.buffer_percent is None else buffered(min_time_s, self.buffer_percent)


def buffered(min_time_s: float, buffer_percent: float) -> float:
    """Trip time (s) of a buffer in % on the least time; DasError for an impossible buffer."""
    if not 0 <= buffer_percent < MOST_PERCENT:
        raise DasError(f"buffer {buffer_percent} %: expected a number from 0 to {MOST_PERCENT:.0f}")
    return min_time_s * (1 + buffer_percent / 100)


def is_refined(text: str) -> bool:
    """Whether `--refine` is on; DasError for anything but on and off."""
    if text not in ("off", "on"):
        raise DasError(f"--refine {text}: expected off or on")
    return text == "on"


def buffer_numbers(text: str) -> list[float]:
    """The buffers (%) that `--buffers` lists; DasError for an impossible buffer or anything that is not a number."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        raise DasError(f"--buffers {text}: expected numbers separated by commas, like 0,5,10") from None
    for value in values:
        buffered(1.0, value)
    return values


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
        """The differences from the files; raises DasError if they are impossible."""
        from das.domain.conditions import Conditions

        world = self.world
        return Conditions(
            mass_ratio=world.mass_ratio,
            resistance_ratio=world.resistance_ratio,
            head_wind_mps=world.head_wind_kmh * KMH,
            receptivity_ratio=world.receptivity_ratio,
            adhesion_ratio=world.adhesion_ratio,
        )

    def route(self) -> Route:
        """The route in the requested direction, under the user's conditions."""
        route = self.conditions().line(load_route(self.where.route))
        return route.reversed() if self.where.reverse else route

    def vehicle(self) -> Vehicle:
        """The vehicle in its mode and load, under the user's conditions.

        A loss map changes only the vehicle's losses.
        """
        from das.domain.files.vehicles import read_loss_map

        asked = self.driven
        vehicle = picked(load_vehicle(asked.vehicle), asked.mode, asked.load)
        if asked.loss_map is not None:
            vehicle = vehicle.with_loss_map(read_loss_map(asked.loss_map))
        return self.conditions().train(vehicle)


@dataclass(frozen=True, kw_only=True)
class Pose(TrainOnLine):
    """One section and the train on it, as the options describe them."""

    ends: EndsOptions

    def section(self) -> Section:
        """Read the files and build the section; DasError for anything unusable."""
        from das.domain.route import section_stops
        from das.solver.section import build_section

        route = self.route()
        start, end = section_stops(route, self.ends.from_stop, self.ends.to_stop)
        return build_section(
            route, self.vehicle(), level=self.driven.level, start_m=start.position_m, end_m=end.position_m
        )


def picked(vehicle: Vehicle, mode: str | None, load: str | None) -> Vehicle:
    """The vehicle in a mode and a load state; None: as in its file. DasError if there is no such mode or state."""
    if load is not None and vehicle.modes.keys() & set(load.split("+")):
        refuse_given(f"--load {load} also names a mode", "--mode")
    vehicle = vehicle if mode is None else vehicle.in_mode(mode)
    return vehicle if load is None else vehicle.loaded(load)


class Files:
    """The files that a command writes, and whether it prints JSON.

    A group of options redeclares fields that the user can give; a command without such an option keeps the default.
    `field()` makes an option that the user must give. `suffix` must end the name of `out`; "" allows all names.
    """

    out: Path | None = None
    plot: Path | None = None
    overwrite: bool = False
    as_json: bool = False
    suffix = ""

    def outputs(self) -> tuple[Path | None, ...]:
        """All files to write; None for one that was not requested."""
        return self.out, self.plot

    def check(self, *inputs: str | Path | None) -> None:
        """Raise DasError, before the work begins, for files that cannot be written or would replace an input."""
        if self.out is not None and self.suffix not in ("", self.out.suffix.lower()):
            raise DasError(f"{self.out}: expected a file name that ends in {self.suffix}")
        check_picture(self.plot)
        check_outputs(*self.outputs(), inputs=inputs, overwrite=self.overwrite)

    def tell(self) -> None:
        """Print the files that were written."""
        for path in self.outputs():
            if path is not None:
                tell(f"written: {path}")


@dataclass(frozen=True, kw_only=True)
class RunFiles(Files):
    """The files that a command writes of one run (its trajectory as CSV, a picture), and whether it prints JSON."""

    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="Trajectory to write (.csv), one row per grid node."),
    ] = None
    plot: PlotOption = None
    overwrite: OverwriteOption = False
    as_json: JsonOption = False


@dataclass(frozen=True, kw_only=True)
class MadeFile(Files):
    """The TOML file that a command makes."""

    suffix = ".toml"
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="File to write (.toml).")] = field()
    overwrite: OverwriteOption = False

    def write(self, text: str, notes: Iterable[str] = (), about: str = "") -> None:
        """Write the text; print the notes (assumptions), and the name and the content of the file."""
        from das.domain.files.writing import write_whole

        write_whole(self.out, text.encode())
        for note in notes:
            tell(f"note: {note}")
        tell(f"written: {self.out}{f': {about}' if about else ''}")
