"""Data for a page when it opens: the line, the train, and the words of the advice. No optimisation runs here."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta
from typing import Any, Final

import msgspec
import numpy as np

from das.advice import wording
from das.advice.regimes import KIND_OF, Regime
from das.advice.shown import OVERSPEED_MPS, SAME_READING_MPS
from das.advice.wording import Language
from das.domain.route import Route, Stop, Stretches
from das.domain.units import NS
from das.domain.vehicle import Vehicle
from sim.desk.messages import PageSettings
from sim.drivers.cab import AT_STOP_M, AdviceView
from sim.drivers.kinds import Presentation
from sim.drivers.presentations.presenter import SpeedIs, presenter_of
from sim.plant.plant import Efforts, train_numbers

SPEED_STEP_MPS: Final = 2.0
"""Speed step (m/s) of the table of efforts."""


def hello_of(
    line: tuple[Route, Vehicle, Sequence[Stop]],
    time_ns: int,
    language: str,
    page: PageSettings,
) -> dict[str, Any]:
    """The constant data of a page, as its message `hello`.

    The title of the scenario is not included, because it describes coming events that the person must not know.
    `time_ns` (since 1970) is a time of the drive, for the line's clock. `kinds` maps each mode's number on the bus to
    the kind of its instruction, which determines the sign on the page.
    """
    route, vehicle, stops = line
    offset = datetime.fromtimestamp(time_ns * NS, route.zone).utcoffset() or timedelta()
    return {
        "t": "hello",
        "language": language,
        **msgspec.structs.asdict(page),
        "at_stop_m": AT_STOP_M,
        "too_fast_mps": [OVERSPEED_MPS, SAME_READING_MPS],
        "line": _line(route, stops),
        "train": _train(vehicle),
        "kinds": [KIND_OF.get(mode, mode.name.lower()) for mode in Regime],
        "presentations": _presentations(),
        "words": {
            one: {"no_advice": wording.mode_words(Regime.NONE, one), **wording.lateness(one)} for one in Language
        },
        "utc_offset_min": round(offset.total_seconds() / 60),
    }


def _line(route: Route, stops: Sequence[Stop]) -> dict[str, Any]:
    return {
        "length_m": route.length_m,
        "limits": _pairs(route.limits_mps),
        "gradients": _pairs(route.gradients_ratio),
        "stops": [[one.position_m, one.name] for one in stops],
    }


def _train(vehicle: Vehicle) -> dict[str, Any]:
    """The train: length (m), top speed (m/s), and largest efforts (N) at speeds 0, 2, 4 … m/s.

    Each row of efforts has three values: traction, electric brake, and both brakes together.
    """
    numbers = train_numbers(vehicle)
    speeds = np.arange(0.0, vehicle.max_speed_mps + SPEED_STEP_MPS, SPEED_STEP_MPS)
    return {
        "length_m": vehicle.train_length_m,
        "top_mps": vehicle.max_speed_mps,
        "step_mps": SPEED_STEP_MPS,
        "efforts_n": [[round(force) for force in Efforts.at(float(speed), numbers)] for speed in speeds],
    }


def _presentations() -> dict[int, dict[str, Any]]:
    """What the page draws for each presentation: nothing for the sheet, which is on paper beside it.

    The names would tell a participant the condition.
    """
    drawn = (name for name in Presentation if name not in (Presentation.NONE, Presentation.SHEET))
    presenters = {name: presenter_of(name) for name in drawn}
    return {
        one.number: {
            "lateness": name is Presentation.DEVIATION,
            "path": name is Presentation.SPEED_AND_EFFORT,
            "highest": one.speed_is(Regime.NONE) is SpeedIs.HIGHEST,
            "modes": {language: [one.mode_words(mode, language) for mode in Regime] for language in Language},
            "before_speed": {
                language: [one.words_before_speed(mode, language) for mode in Regime] for language in Language
            },
        }
        for name, one in presenters.items()
    }


def cab_fields(message: Any) -> dict[str, Any]:
    """All fields of a Cab message by name, exactly as recorded."""
    found: dict[str, Any] = {}
    for field in message.DESCRIPTOR.fields:
        value = getattr(message, field.name)
        if field.message_type is None:
            found[field.name] = list(value) if field.is_repeated else value
        else:
            found[field.name] = [cab_fields(one) for one in value] if field.is_repeated else cab_fields(value)
    return found


def reasons(view: AdviceView | None, route: Route) -> dict[Language, str]:
    """The reason for the advice in every language; empty if the advice gives none."""
    if view is None or not view.reason:
        return {}
    return {one: wording.words(view.reason, one, route.zone) for one in Language}


def _pairs(stretches: Stretches) -> list[list[float]]:
    """Starts (m) and values of stretches, without those that repeat the value before."""
    pairs = list(zip(stretches.start_m.tolist(), stretches.value.tolist(), strict=True))
    return [[s, v] for i, (s, v) in enumerate(pairs) if not i or v != pairs[i - 1][1]]
