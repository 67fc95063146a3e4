"""The setting of a trial, and the factors that an experiment can vary, with their meanings and levels."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Literal

from das.domain.errors import DasError, InputError, one_of
from das.domain.files.load import bundled_files, load_vehicle
from das.domain.files.reading import Fields
from das.domain.levels import Level
from das.domain.units import PERCENT
from sim.drivers.kinds import DESK, DriverKind, External, FrictionPolicy, OwnClass, Presentation, named_driver
from sim.drivers.own_class import driver_versions
from sim.drivers.parameters import HumanParameters
from sim.drivers.screen import LONGEST_S, ScreenSettings
from sim.recording.opening import sha256
from sim.world.scenario import Drawn, Scenario, bundled_scenarios, load_scenario
from sim.world.service import scenario_files

LONGEST_PREVIEW_S: Final = 3600.0
OF_HUMAN: Final = "human_"
"""Prefix of factors that are parameters of the human driver; such a parameter is the same for all participants."""


def study_days() -> dict[str, Path]:
    """The scenario files of the bundled studies, by name."""
    return bundled_files("sim.experiment", "studies/days")


def day_of(name_or_path: str) -> Scenario:
    """Read a bundled scenario, a day of the bundled studies or a TOML file; raises DasError for anything unusable."""
    return load_scenario(str(study_days().get(name_or_path, name_or_path)))


@dataclass(frozen=True, kw_only=True)
class Setting:
    """The setting of a trial. `loss_level` is the level of losses used to plan the advice (None: the train's own); it
    does not change the losses of the true train. `scenario` and `train` are names of bundled files or paths; a
    `train` None is the scenario's. Times are in s; `preview_s` is infinite if the display shows everything ahead.
    `buffer_percent` replaces the times of a scenario without a journey, and `receptivity_ratio` its receptivity; None
    is the scenario's. `human` contains parameters of a human driver that replace the participant's own, by name. The
    driver `desk` is a person at the cab desk, whose page shows the delay of the train with `punctuality`.
    """

    scenario: str = "clear-day"
    train: str | None = None
    driver: DriverKind | OwnClass | Literal[External.DESK] = DriverKind.HUMAN
    presentation: Presentation = Presentation.GUIDE
    loss_level: Level | None = None
    friction: FrictionPolicy = FrictionPolicy.AS_MEASURED
    update_interval_s: float = 0.0
    hold_s: float = 0.0
    preview_s: float = math.inf
    reason: bool = True
    punctuality: bool = True
    buffer_percent: float | None = None
    receptivity_ratio: float | None = None
    human: tuple[tuple[str, float], ...] = ()

    @property
    def screen(self) -> ScreenSettings:
        """The settings of the display."""
        return ScreenSettings(
            update_interval_s=self.update_interval_s,
            hold_s=self.hold_s,
            preview_s=self.preview_s,
            reason=self.reason,
        )

    def read_scenario(self) -> Scenario:
        """The scenario with the train, buffer and receptivity of this setting; raises DasError for unusable files."""
        scenario = day_of(self.scenario)
        if self.train is not None:
            scenario = replace(scenario, vehicle=self.train, load=None)
        if self.buffer_percent is not None:
            if scenario.journey is not None:
                raise InputError(scenario.source, "scenario.journey", scenario.journey, "none with a buffer_percent")
            scenario = replace(scenario, buffer_ratio=self.buffer_percent * PERCENT, running_s=None)
        if self.receptivity_ratio is not None:
            same = Drawn(low=self.receptivity_ratio, high=self.receptivity_ratio)
            truth = replace(scenario.truth, conditions={**scenario.truth.conditions, "receptivity_ratio": same})
            scenario = replace(scenario, truth=truth)
        return scenario

    def figures(self) -> dict[str, Any]:
        """Every field in a form for JSON; an infinite preview is None."""
        found = {name: getattr(self, name) for name in self.__dataclass_fields__}
        found |= {name: str(found[name]) for name in ("driver", "presentation", "friction")}
        found["loss_level"] = None if self.loss_level is None else str(self.loss_level)
        found["preview_s"] = None if math.isinf(self.preview_s) else self.preview_s
        return found


def setting_files(setting: Setting) -> dict[str, str]:
    """The hash of each file of a setting: scenario, route, vehicle, losses, and the user's own driver, if any."""
    scenario = setting.read_scenario()
    where = scenario.id if setting.train is None else f"{scenario.id} with {Path(scenario.vehicle).stem}"
    found = {f"{where}: {name}": sha256(path) for name, path in scenario_files(scenario).items()}
    return found | {f"{setting.driver}: {name}": text for name, text in driver_versions(setting.driver).items()}


@dataclass(frozen=True, kw_only=True)
class FactorLevel:
    """A level of a factor: the text in tables, and the value in a `Setting`.

    A named level has no value, but `settings`: the level of each factor that it fixes, by name.
    """

    text: str
    value: Any = None
    settings: Mapping[str, FactorLevel] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class KnownFactor:
    """A factor that experiments may vary: its name, meaning, unit and allowed levels.

    `read` makes a level from a table, a key and the value of the key, and raises InputError for a value that is not
    allowed.
    """

    name: str
    title: str
    meaning: str
    unit: str
    expected: str
    read: Callable[[Fields, str, Any], FactorLevel]


def _choice(name: str, title: str, meaning: str, kind: Any) -> KnownFactor:
    """A factor whose levels are the members of an enumeration."""

    def read(table: Fields, key: str, value: Any) -> FactorLevel:
        if not isinstance(value, str) or value not in list(kind):
            raise table.error(key, value, one_of(kind, value))
        return FactorLevel(text=value, value=kind(value))

    return KnownFactor(name=name, title=title, meaning=meaning, unit="", expected=", ".join(kind), read=read)


def _number(
    name: str, title: str, meaning: str, ends: tuple[float, float], unit: str = "", *, or_all: bool = False
) -> KnownFactor:
    """A factor whose levels are numbers between two ends; with `or_all` also "all", read as infinity."""
    low, high = ends
    otherwise = ', or "all"' if or_all else ""

    def read(table: Fields, key: str, value: Any) -> FactorLevel:
        if or_all and value == "all":
            return FactorLevel(text="all", value=math.inf)
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            raise table.error(key, value, f"a number from {low:g} to {high:g} ({unit or 'a ratio'}){otherwise}")
        return FactorLevel(text=f"{value:.12g}", value=float(value))

    expected = f"{low:g} to {high:g} {unit}".rstrip() + otherwise
    return KnownFactor(name=name, title=title, meaning=meaning, unit=unit, expected=expected, read=read)


def _shown(name: str, title: str, meaning: str) -> KnownFactor:
    """A factor whose levels are "shown" and "hidden"."""

    def read(table: Fields, key: str, value: Any) -> FactorLevel:
        if not isinstance(value, bool):
            raise table.error(key, value, "true or false")
        return FactorLevel(text="shown" if value else "hidden", value=value)

    return KnownFactor(name=name, title=title, meaning=meaning, unit="", expected="true, false", read=read)


def _parameter(name: str) -> KnownFactor:
    """The factor of a parameter of human drivers."""
    about = HumanParameters.__dataclass_fields__[name].metadata
    meaning, ends = f"of human drivers: {about['meaning']}", (about["low"], about["high"])
    return _number(f"{OF_HUMAN}{name}", name, meaning, ends, about["unit"].replace("–", ""))


def _scenario(table: Fields, key: str, value: Any) -> FactorLevel:
    bundled = value in (*bundled_scenarios(), *study_days())
    return _file(table, key, value, lambda name: day_of(name).id, bundled=bundled)


def _train(table: Fields, key: str, value: Any) -> FactorLevel:
    beside = isinstance(value, str) and value.endswith((".toml", ".json"))
    return _file(table, key, value, lambda name: load_vehicle(name).id, bundled=not beside)


def _file(table: Fields, key: str, value: Any, id_of: Callable[[str], str], *, bundled: bool) -> FactorLevel:
    """A bundled name, or a path relative to the design's file; the text of the level is the id in that file."""
    if not isinstance(value, str) or not value:
        raise table.error(key, value, "the name of a bundled file, or a path")
    name = value if bundled else str((table.source.parent / Path(value)).resolve())
    try:
        return FactorLevel(text=id_of(name), value=name)
    except DasError as error:
        raise DasError(f"{table.source}: {table.prefix}{key}: {error}") from None


def _driver(table: Fields, key: str, value: Any) -> FactorLevel:
    try:
        driver = named_driver(key, value) if isinstance(value, str) else None
    except DasError:
        driver = None
    if not isinstance(driver, DriverKind | OwnClass) and driver is not DESK:
        expected = one_of([*DriverKind, DESK], value)
        raise table.error(key, value, f"{expected}, or a class of your own as package.module:Class")
    return FactorLevel(text=str(driver).replace(":", "."), value=driver)


FACTORS: Final = {
    one.name: one
    for one in (
        _choice("presentation", "Presentation", "content of the display, for the same advice", Presentation),
        _choice("loss_level", "Loss level of the advice", "losses used to plan the advice; those of the true train "
                "stay", Level),
        _number("update_interval_s", "Update interval", "update interval of the display", (0.0, LONGEST_S), "s"),
        _number("hold_s", "Hold time", "minimum display time, except for advice to brake", (0.0, LONGEST_S), "s"),
        _number("preview_s", "Preview", "length of the display's preview", (0.0, LONGEST_PREVIEW_S), "s", or_all=True),
        _shown("reason", "Reason shown", "whether the display shows the reason for the advice"),
        _shown("punctuality", "Punctuality shown", "whether the page of a person at the desk shows the delay"),
        _choice("friction", "Friction policy", "brake that a human driver uses if the motors could brake",
                FrictionPolicy),
        _number("buffer_percent", "Buffer", "buffer of a timetable without a journey, above the least time with "
                "service braking", (0.0, 1000.0), "%"),
        _number("receptivity_ratio", "Receptivity", "share of fed-back power that the line accepts", (0.0, 1.0)),
        KnownFactor(
            name="scenario", title="Scenario", unit="", read=_scenario,
            meaning="line, timetable and disturbances",
            expected="a bundled scenario, a line of the bundled studies, or a TOML file",
        ),
        KnownFactor(
            name="train", title="Train", unit="", read=_train,
            meaning="train used instead of the scenario's", expected="a bundled vehicle or a vehicle file",
        ),
        KnownFactor(
            name="driver", title="Driver", unit="", read=_driver,
            meaning="the driver: a simulated one, or desk (fixed): people, with das-sim experiment desk",
            expected=f"{', '.join([*DriverKind, DESK])}, or a class of your own",
        ),
        *map(_parameter, HumanParameters.__dataclass_fields__),
    )
}  # fmt: skip
"""Every factor by its name, which is also its column and, except for parameters, its field in a `Setting`."""

_OF_A_SETTING: Final = {**Setting().figures(), "preview_s": "all"}
DEFAULTS: Final = {name: value for name, value in _OF_A_SETTING.items() if name in FACTORS and value is not None}
"""Default levels of factors; any other factor follows the scenario or the participant by default."""
