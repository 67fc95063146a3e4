"""Options of a replay, and of a look at a trip."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from das.domain.losses import Level


@dataclass(frozen=True, kw_only=True)
class ReplayOptions:
    """What `das-sim replay` or `trip` is told besides the trip; None = from the recording, or the default.

    `speed` is in times real time, None for as fast as node and recorder keep up.
    """

    route: str | None = None
    vehicle: str | None = None
    reverse: bool = False
    line: Path | None = None
    strict: bool = False
    from_stop: str | None = None
    to_stop: str | None = None
    arrival_s: float | None = None
    delay_s: float | None = None
    speed: float | None = None
    level: Level | None = None
    loss_map: Path | None = None
    point_mass: bool = False
    train: str = "train-1"
    bus: Path | None = None
    insecure_bus: bool = False
    out: Path | None = None
    as_json: bool = False
