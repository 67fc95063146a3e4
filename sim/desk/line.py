"""What never changes while a page is open: the line, the train, and the words of the advice. Nothing is solved."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any, Final

import numpy as np

from das.advice.wording import Language, words
from das.domain.route import Route, Stop, Stretches
from das.domain.units import NS
from das.domain.vehicle import Vehicle
from sim.desk.messages import plain
from sim.drivers.cab import AdviceView, Efforts
from sim.drivers.kinds import Presentation
from sim.drivers.presentations.presenter import SpeedIs, presenter_of
from sim.plant.plant import train_numbers

SPEED_STEP_MPS: Final = 2.0
"""Step of the table of efforts (m/s)."""
MODES: Final = range(10)
"""The numbers of the modes on the bus."""


def line_of(route: Route, stops: Sequence[Stop]) -> dict[str, Any]:
    """The line for the way ahead: limits, gradients, tunnels and stops, positions in m."""
    return {
        "length_m": route.length_m,
        "limits": _pairs(route.limits_mps),
        "gradients": _pairs(route.gradients_ratio),
        "tunnels": [[one.start_m, one.length_m] for one in route.tunnels],
        "stops": [[one.position_m, one.name] for one in stops],
    }


def train_of(vehicle: Vehicle) -> dict[str, Any]:
    """The train: its length (m), top speed (m/s), and largest efforts (N) at speeds 0, 2, 4 … m/s.

    An effort has three figures: traction, the electric brake, and both brakes together.
    """
    numbers = train_numbers(vehicle)
    speeds = np.arange(0.0, vehicle.max_speed_mps + SPEED_STEP_MPS, SPEED_STEP_MPS)
    return {
        "length_m": vehicle.train_length_m,
        "top_mps": vehicle.max_speed_mps,
        "step_mps": SPEED_STEP_MPS,
        "efforts_n": [[round(force) for force in Efforts.at(float(speed), numbers)] for speed in speeds],
    }


def presentations() -> dict[int, dict[str, Any]]:
    """How the page shows each presentation, by its number on the bus: what its speed means, and the words of modes."""
    shown = {}
    for name in Presentation:
        if name is Presentation.NONE:
            continue
        presenter = presenter_of(name)
        shown[presenter.number] = {
            "name": str(name),
            "says_mode": presenter.says_mode,
            "highest": presenter.speed_is(0) is SpeedIs.HIGHEST,
            "modes": {str(one): [presenter.mode_words(number, one) for number in MODES] for one in Language},
        }
    return shown


def utc_offset_min(route: Route, time_ns: int) -> int:
    """The line's clock less UTC (min) at a moment (ns since 1970)."""
    offset = datetime.fromtimestamp(time_ns * NS, UTC).astimezone(route.zone).utcoffset()
    return 0 if offset is None else round(offset.total_seconds() / 60)


def cab_fields(message: Any) -> dict[str, Any]:
    """Every field of a message Cab by its name, for JSON: exactly what is recorded, with null for NaN."""
    found: dict[str, Any] = {}
    for field in message.DESCRIPTOR.fields:
        value = getattr(message, field.name)
        if field.is_repeated:
            found[field.name] = [cab_fields(one) if field.message_type else plain(one) for one in value]
        else:
            found[field.name] = cab_fields(value) if field.message_type else plain(value)
    return found


def reasons(view: AdviceView | None, route: Route) -> dict[str, str]:
    """Why the advice says what it says, in every language; empty where it does not say it."""
    if view is None or not view.reason:
        return {}
    return {str(one): words(view.reason, one, route.zone) for one in Language}


def _pairs(stretches: Stretches) -> list[list[float]]:
    """Starts (m) and values of stretches, without those that change nothing."""
    pairs = list(zip(stretches.start_m.tolist(), stretches.value.tolist(), strict=True))
    return [[s, v] for i, (s, v) in enumerate(pairs) if not i or v != pairs[i - 1][1]]
