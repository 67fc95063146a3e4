"""What the levels of a factor mean, in words for readers of a study who do not know the program."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from das.domain.levels import Level
from sim.drivers.kinds import DriverKind, FrictionPolicy, Presentation
from sim.drivers.presentations.presenter import presenter_of
from sim.experiment.factors import FactorLevel
from sim.experiment.setting import day_of

_FRICTION: Final = {
    FrictionPolicy.AS_MEASURED: "a share of each braking by friction brakes, as measured on real trains, whatever is "
    "advised",
    FrictionPolicy.ELECTRIC_FIRST: "friction brakes only where the motors cannot give what is asked",
    FrictionPolicy.BY_ADVICE: "as measured, but electric first while the driver follows advice on effort",
}
_DRIVERS: Final = {
    DriverKind.PERFECT: "follows advice exactly and at once",
    DriverKind.FAST: "drives as fast as is allowed",
    DriverKind.RMS: "never drives faster than the reduced maximum speed",
    DriverKind.TIMETABLE: "keeps to the timetable without advice",
    DriverKind.HUMAN: "a simulated human driver, who looks, reacts, errs and refuses",
}
_LEVELS: Final = {
    Level.L0_NOREG: "no losses, and everything that is braked is turned into heat",
    Level.L0_REG: "no losses",
    Level.L1: "a constant efficiency",
    Level.L2: "a constant efficiency and an idle part",
    Level.L3: "a map of losses over force and speed",
    Level.OWN: "the losses that the train's file gives",
}
_WORDS: Final[Mapping[str, Mapping[str, str]]] = {
    "loss_level": {str(level): text for level, text in _LEVELS.items()},
    "friction": {str(level): text for level, text in _FRICTION.items()},
    "driver": {str(level): text for level, text in _DRIVERS.items()},
}


def level_words(factor: str, level: FactorLevel) -> str:
    """What a level means; empty where its name says it. Raises DasError for a scenario that cannot be read."""
    if factor == "scenario":
        return day_of(level.value).title
    if factor == "presentation":
        return presenter_of(Presentation(level.text)).meaning
    return _WORDS.get(factor, {}).get(level.text, "")
