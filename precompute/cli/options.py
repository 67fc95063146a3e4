"""Options that the commands of das-precompute share, and the problem they pose."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from das.domain.errors import DasError
from das.domain.losses import Level
from precompute.cli.pose import Pose

RouteArgument = Annotated[str, typer.Argument(help="Bundled route name, TOML file or TTOBench track (JSON).")]
VehicleArgument = Annotated[str, typer.Argument(help="Bundled vehicle name, TOML file or TTOBench train (JSON).")]
FromOption = Annotated[str | None, typer.Option("--from", help="First stop: name or number [default: the route's].")]
ToOption = Annotated[str | None, typer.Option("--to", help="Last stop [default: the route's]; no stop between.")]
ReverseOption = Annotated[bool, typer.Option("--reverse", help="Drive the route the other way.")]
LevelOption = Annotated[Level | None, typer.Option(help="Loss level [default: the vehicle's].")]
LossMapOption = Annotated[
    Path | None, typer.Option(help="CSV loss map (speed_kmh, force_n, loss_w): its losses and nothing else.")
]
PointMassOption = Annotated[bool, typer.Option("--point-mass", help="Take the train's length as 0.")]
BoundaryOption = Annotated[float, typer.Option(help="Speed at both ends of the section.")]
StartSpeedOption = Annotated[float | None, typer.Option(help="Speed at the start only.", show_default=False)]
EndSpeedOption = Annotated[float | None, typer.Option(help="Speed at the end only.", show_default=False)]
PowerOption = Annotated[float | None, typer.Option(help="Power of traction and of the electric brake.")]
ForceOption = Annotated[float | None, typer.Option(help="Largest traction force.")]
BrakeForceOption = Annotated[float | None, typer.Option(help="Largest force of the electric brake.")]
SpeedOption = Annotated[float | None, typer.Option(help="Largest speed of the train.")]
NoFrictionOption = Annotated[bool, typer.Option("--no-friction-brake", help="Brake with the motors only.")]
LoadOption = Annotated[str | None, typer.Option(help="Load state that the vehicle's file names [default: its mass].")]
MassOption = Annotated[float, typer.Option("--mass", help="Mass, as a multiple of the plan's.")]
ResistanceOption = Annotated[float, typer.Option("--resistance", help="Running resistance, as a multiple.")]
WindOption = Annotated[float, typer.Option(help="Wind against the train in km/h (tail wind < 0).")]
ReceptivityOption = Annotated[float, typer.Option("--receptivity", help="Share of fed back power the line takes.")]
AdhesionOption = Annotated[float, typer.Option("--adhesion", help="Adhesion, as a multiple of a dry rail's.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a table.")]

COMPILING = "compiling the solver (once on a machine, about 10 s) …"


def posed(options: dict[str, Any]) -> Pose:
    """The problem posed by the options of a command (its `locals()`); DasError for a number that cannot be."""
    pose = Pose(**{name: options[name] for name in Pose.__dataclass_fields__})
    for name in ("max_power_kw", "max_force_kn", "max_brake_force_kn", "max_speed_kmh"):
        value = getattr(pose, name)
        if value is not None and not 0 < value < 1e9:
            raise DasError(f"--{name.replace('_', '-')} {value}: expected a number > 0 and below 1e9")
    for name in ("boundary_speed_mps", "start_speed_mps", "end_speed_mps"):
        value = getattr(pose, name)
        if value is not None and not 0 <= value < 200:
            raise DasError(f"--{name.replace('_', '-')} {value}: expected a speed from 0 to 200 m/s")
    return pose


def buffered(min_time_s: float, buffer_percent: float | None) -> float:
    """Trip time (s) of a buffer in % on the least time; DasError for a buffer that cannot be."""
    if buffer_percent is None or not 0 <= buffer_percent < 1e4:
        raise DasError(f"buffer {buffer_percent} %: expected a number from 0 to 10000")
    return min_time_s * (1 + buffer_percent / 100)
