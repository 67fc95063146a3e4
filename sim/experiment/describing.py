"""What every column of a study's tables means, as sidecars in the form of BIDS: LongName, Description, Units."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from das.domain.levels import Level
from sim.drivers.kinds import DriverKind, FrictionPolicy, Presentation
from sim.drivers.parameters import HumanParameters
from sim.drivers.presentations.presenter import presenter_of
from sim.experiment.design import Design
from sim.experiment.factors import FACTORS, FactorLevel
from sim.experiment.files import (
    CONDITION,
    PARTICIPANT,
    PERSON_ID,
    PERSON_NUMBER,
    POSITION,
    PRACTICE,
    SEED,
    SESSION,
    TRIAL,
)
from sim.experiment.measures import MEASURES
from sim.experiment.setting import day_of

Sidecar = dict[str, dict[str, Any]]
NO_UNIT: Final = "n/a"

_TRIAL_COLUMNS: Final = {
    TRIAL: ("Trial", "number of the trial in the study, from 1"),
    PARTICIPANT: ("Participant", "who drove; participants.tsv describes each"),
    SESSION: ("Session", "part of the trials between two breaks"),
    POSITION: ("Position", "place of the trial in the order of its participant, from 1, practice included"),
    PRACTICE: ("Practice", "1 for a practice trial, which is not for analysis, else 0"),
    CONDITION: ("Condition", "levels of all factors in the order of the design, joined by _"),
}
EVENT_KINDS: Final = {
    "glance": "the driver looks at the display; value: mode shown",
    "noticed": "the driver notices new advice; value: its mode",
    "reaction": "a reaction begins; value: its length (s)",
    "followed": "the driver decides to follow the advice that was noticed; value: its mode",
    "refused": "the driver decides not to follow the advice that was noticed; value: its mode",
    "acted": "a decision takes effect; value: 1 if the driver now follows the advice, else 0",
    "lapse": "the driver's attention goes away; value: for how long (s), unless the train warns",
    "lever": "a controller that stood still begins to move; value: its aim (−1 … 1)",
    "changed": "advice was replaced before the driver acted on it; value: mode of the advice that is gone",
    "shown": "what is read off the display changes; value: mode shown, 0 for none",
    "departure": "the train departs from a stop; value: delay (s)",
    "arrival": "the train arrives at a stop; value: delay (s)",
}
"""Kinds of events, and what the number beside each is."""
CLOCKS: Final = {
    "monotonic_ns": ("Monotonic clock", "time since the trial began, on a clock that is never set", "ns"),
    "utc_ns": ("UTC", "time since 1970-01-01 UTC; of a simulated trial that of the simulated day", "ns"),
}
EVENT_COLUMNS: Final = {
    "onset": ("Onset", "time since the trial began, which is when its series begins", "s"),
    "duration": ("Duration", "how long the event lasts; 0 for a moment", "s"),
    "trial_type": ("Kind of event", "what happened", NO_UNIT),
    "value": ("Value", "a number that goes with the event; its kind says which", NO_UNIT),
    "time_s": ("Clock of the trip", "time since the first departure by the timetable", "s"),
    **CLOCKS,
}
SERIES_COLUMNS: Final = {
    "time_s": ("Clock of the trip", "time since the first departure by the timetable", "s"),
    **CLOCKS,
    "s_m": ("Position", "position of the train's head on the route", "m"),
    "speed_mps": ("Speed", "true speed of the train", "m/s"),
    "acceleration_mps2": ("Acceleration", "true acceleration of the train", "m/s²"),
    "limit_mps": ("Speed limit", "limit that the cab shows", "m/s"),
    "force_el_n": ("Electric force", "wheel force of the motors, braking < 0", "N"),
    "force_friction_n": ("Friction force", "wheel force of the friction brakes, <= 0", "N"),
    "energy_input_j": ("Energy", "energy at the current collector since the trial began", "J"),
    "lever_ratio": ("Controller", "setting of the controller: 1 full traction, −1 all brakes; empty without one", "1"),
    "shown_mode": ("Mode shown", "mode of the advice on the display; empty where nothing is shown", NO_UNIT),
    "shown_speed_mps": ("Speed shown", "speed on the display; empty where none is shown", "m/s"),
    "shown_effort_ratio": ("Effort shown", "effort on the display on the controller's scale; empty without one", "1"),
}
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


def trials_sidecar(design: Design) -> Sidecar:
    """What the columns of the table of trials mean."""
    found = {name: _entry(title, text, NO_UNIT) for name, (title, text) in _TRIAL_COLUMNS.items()}
    for factor in design.factors:
        known = FACTORS[factor.name]
        levels = ", ".join(level.text for level in factor.levels)
        within = "within" if factor.within else "between"
        found[factor.name] = _entry(
            known.title, f"{known.meaning}; levels {levels}; {within} participants", known.unit or NO_UNIT
        )
        meant = {level.text: level_words(factor.name, level) for level in factor.levels}
        if any(meant.values()):
            found[factor.name]["Levels"] = meant
    found[SEED] = _entry("Seed", "seed of the day; trials with one seed meet the same day", NO_UNIT)
    for name in design.plan.measures:
        measure = MEASURES[name]
        found[name] = _entry(measure.title, f"{measure.formula} ({measure.source})", measure.unit)
    return found


def participants_sidecar(design: Design, parameters: list[str]) -> Sidecar:
    """What the columns of participants.tsv mean: the group, and each parameter of the driver."""
    found = {
        PERSON_ID: _entry("Participant", "who drove", NO_UNIT),
        "population": _entry("Population", "the population that the participant is drawn from", NO_UNIT),
        PERSON_NUMBER: _entry("Person", "number of the participant in the population", NO_UNIT),
    }
    found |= {
        factor.name: _entry(FACTORS[factor.name].title, "the one level that the participant meets", NO_UNIT)
        for factor in design.factors
        if not factor.within
    }
    for name in parameters:
        item = HumanParameters.__dataclass_fields__[name].metadata
        unit = "1" if item["unit"] == "–" else item["unit"]
        found[name] = _entry(name, f"{item['meaning']}, before practice and what the scenario says", unit)
    return found


def events_sidecar() -> Sidecar:
    """What the columns of the files of events mean."""
    found = {name: _entry(*texts) for name, texts in EVENT_COLUMNS.items()}
    found["trial_type"]["Levels"] = dict(EVENT_KINDS)
    return found


def series_sidecar() -> Sidecar:
    """What the columns of the series mean."""
    return {name: _entry(*texts) for name, texts in SERIES_COLUMNS.items()}


def _entry(title: str, text: str, unit: str) -> dict[str, Any]:
    return {"LongName": title, "Description": text, "Units": unit}


def level_words(factor: str, level: FactorLevel) -> str:
    """What a level means; empty where its name says it. Raises DasError for a scenario that cannot be read."""
    if factor == "scenario":
        return day_of(level.value).title
    if factor == "presentation":
        return presenter_of(Presentation(level.text)).meaning
    return _WORDS.get(factor, {}).get(level.text, "")
