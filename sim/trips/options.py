"""What a user says about a recorded trip: where it ran, with which train, and how strictly it is read."""

from __future__ import annotations

from dataclasses import dataclass

from das.command_line.options import (
    DirectionOption,
    FromOption,
    LevelOption,
    LossMapOption,
    PointMassOption,
    RecordedRouteOption,
    RecordedVehicleOption,
    StrictOption,
    ToOption,
)
from sim.options import LineOption, OfTrainOption


@dataclass(frozen=True, kw_only=True)
class TripOptions:
    """What is said about a trip besides its file; None means: as the recording says, or the default.

    `reverse` None: nobody says in which direction the trip ran. Stops None: the route's first and last. `line` are
    kilometre posts. `strict` refuses a trip of which points would be dropped, or that runs the other way.
    """

    route: RecordedRouteOption = None
    vehicle: RecordedVehicleOption = None
    reverse: DirectionOption = None
    line: LineOption = None
    from_stop: FromOption = None
    to_stop: ToOption = None
    strict: StrictOption = False
    level: LevelOption = None
    loss_map: LossMapOption = None
    point_mass: PointMassOption = False
    of_train: OfTrainOption = None

    @property
    def direction_said(self) -> bool:
        """Whether the user said the direction."""
        return self.reverse is not None or None not in (self.from_stop, self.to_stop)
