"""The names of drivers, presentations and friction policies; its imports are light, because command lines need it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from das.domain.errors import DasError, now_called, one_of
from sim.doors import DRIVERS, PRESENTATIONS, installed


class DriverKind(StrEnum):
    """The bundled drivers of a simulated train."""

    PERFECT = "perfect"
    LITERAL = "literal"
    FAST = "fast"
    TOP_SPEED = "top-speed"
    TIMETABLE = "timetable"
    HUMAN = "human"


@dataclass(frozen=True, kw_only=True)
class OwnClass:
    """A user's own driver: a class `name` in a module that Python can import."""

    module: str
    name: str

    def __str__(self) -> str:
        return f"{self.module}:{self.name}"


class External(StrEnum):
    """A driver in a separate process that drives over the bus."""

    EXTERNAL = "external"
    DESK = "desk"
    """A person at the cab desk, in a browser."""


EXTERNAL: Final = External.EXTERNAL
DESK: Final = External.DESK
DriverName = DriverKind | OwnClass | External
"""The drivers that a command line can name for a run."""
_OWN_CLASS = re.compile(r"([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*):([A-Za-z_]\w*)")


def named_driver(option: str, text: str) -> DriverName:
    """The driver named by a text; raises DasError for any other text, with a message that begins with `option`."""
    if text in list(DriverKind):
        return DriverKind(text)
    if text in list(External):
        return External(text)
    if (door := installed(DRIVERS).get(text)) is not None:
        return OwnClass(module=door.module, name=door.attribute)
    match = _OWN_CLASS.fullmatch(text)
    if match is None:
        expected = one_of([*DriverKind, *External, *installed(DRIVERS)], text)
        raise DasError(f"{option} {text}: expected {expected}, or a class of your own as package.module:Class")
    return OwnClass(module=match[1], name=match[2])


class Presentation(StrEnum):
    """The presentations: the parts of the same advice that a display shows.

    A new presentation needs one line here and a module of the same name in `sim/drivers/presentations`; or another
    package with an entry point `das.presentations`.
    """

    _ignore_ = "one, member"
    NONE = "none"
    DEVIATION = "deviation"
    """Seconds early or late, updated every 35 s; no advice on how to drive."""
    TOP_SPEED = "top-speed"
    """One reduced maximum speed."""
    FOUR_MODE = "four-mode"
    """Full traction, a speed to hold, coasting, braking; and the time of the next change."""
    SPEED_AND_EFFORT = "speed-and-effort"
    """Speed and effort now, and for the next seconds."""
    GUIDE = "guide"
    """The manner of driving now, its speed and effort, and the next two changes."""
    SHEET = "sheet"
    """Instructions by kilometre on paper, which never change."""
    for one in installed(PRESENTATIONS):
        if (member := one.upper().replace("-", "_")) not in vars():  # Names of bundled presentations are not replaced.
            vars()[member] = one


class FrictionPolicy(StrEnum):
    """The brake that a human driver uses if the motors could brake: a habit, or a rule of the railway."""

    AS_MEASURED = "as-measured"
    """The share `friction_ratio` of the braking effort by friction, whatever the display shows."""
    ELECTRIC_FIRST = "electric-first"
    """The friction brake only if the motors are not sufficient."""
    BY_ADVICE = "by-advice"
    """Friction as measured, but electric first while the driver follows advice on effort."""


def as_now_called(run: Mapping[str, str]) -> dict[str, str]:
    """The metadata of a recorded run, with today's names of its driver and its display."""
    known = [*DriverKind, *Presentation]
    names = {key: run[key] for key in ("driver", "advice") if key in run}
    return {**run, **{key: now_called(name, known) or name for key, name in names.items()}}
