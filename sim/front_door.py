"""What `import sim` offers: one simulated day in this process, as arrays and figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import InputError
from das.domain.levels import Level
from das.domain.trajectory import EnergyBalance
from das.front_door import chosen
from sim.drivers.kinds import DriverKind, OwnClass, Presentation, named_driver
from sim.drivers.parameters import Participant, participant_of
from sim.drivers.presentations.presenter import presenter_of
from sim.plant.kernels import PlantState
from sim.world.loop import InProcess, World
from sim.world.outcome import outcome
from sim.world.scenario import load_scenario
from sim.world.service import make_day, prepare_service


@dataclass(frozen=True, kw_only=True, eq=False)
class SimulatedDay:
    """A day that was driven.

    `states` holds the true state of the train once a second (see `columns`), `outcome` the figures that
    `das-sim run --json` prints: punctuality, energies (kWh), where they went, and how the advice fared.
    `balance` is where the energy went from the first departure to the last arrival (J).
    """

    states: Mapping[str, NDArray[np.float64]]
    outcome: Mapping[str, Any]
    balance: EnergyBalance

    def columns(self) -> dict[str, NDArray[np.float64]]:
        """The true state of the train once a second, as arrays of shape (seconds + 1,) by names with units.

        `time_s` is 0 at the timetable's departure; `s_m` and `speed_mps` are the train's, `force_el_n` and
        `force_friction_n` its wheel forces. Energies ending in `_j` count from the start of the run.
        """
        return dict(self.states)


def run_day(
    scenario: str | Path,
    seed: int = 0,
    *,
    driver: DriverKind | str = DriverKind.HUMAN,
    advice: Presentation | str = Presentation.COACH,
    level: Level | str | None = None,
    participant: int | None = None,
) -> SimulatedDay:
    """Drive a day of a scenario in closed loop: simulated train and driver, advised once a second, without a bus.

    `scenario` is the name of a bundled scenario or a TOML file. `seed` draws what happens on the day, and the driver;
    the same seed gives the same day. `driver` is who drives ("perfect", "fast", "rms", "timetable", "human", or a class
    of your own as "package.module:Class"), `advice` what the display shows ("none", "deviation", "rms", "four-mode",
    "vector" or "coach"), `level` how losses are modelled (the default is the vehicle's own). `participant` is the
    number of a human driver of the default population, who is the same on every day; the seed then draws the day alone.
    Nothing is recorded: `das-sim run` does that.

    Raises InputError for an unknown word, DasError for an unusable scenario or a train that does not arrive.

        >>> import sim
        >>> day = sim.run_day("clear-day", driver="perfect", advice="vector")
        >>> abs(day.outcome["late_s"]) < 30, day.outcome["signals_passed"]
        (True, 0)
        >>> sim.run_day("clear-day", driver="nobody")
        Traceback (most recent call last):
        ...
        das.domain.errors.InputError: run_day: driver = 'nobody': expected one of perfect, fast, rms, timetable, human
    """
    kind, shown = _who(driver), chosen(Presentation, "run_day", "advice", advice)
    losses = None if level is None else chosen(Level, "run_day", "level", level)
    if not isinstance(seed, int) or isinstance(seed, bool) or seed < 0:
        raise InputError("run_day", "seed", seed, "a whole number >= 0")
    if not isinstance(scenario, str | Path):
        raise InputError("run_day", "scenario", scenario, "the name of a bundled scenario, or a path")
    person = _person(kind, participant)
    day = make_day(prepare_service(load_scenario(str(scenario)), level=losses), seed, person)
    run = World(day, day.driver(kind), shown, InProcess(day.service, coach=presenter_of(shown).needs_coach)).run()
    states = {
        name: np.array(column) for name, column in zip(PlantState._fields, zip(*run.states, strict=True), strict=True)
    }
    balance = day.plant.balance(run.legs[0][0], run.legs[-1][1])
    return SimulatedDay(states=states, outcome=outcome(day, run, kind).as_dict(), balance=balance)


def _person(driver: DriverKind | OwnClass, number: int | None) -> Participant | None:
    """The participant with a number; InputError for an invalid number, DasError where the driver is not human."""
    if number is not None and (not isinstance(number, int) or isinstance(number, bool) or number < 0):
        raise InputError("run_day", "participant", number, "a whole number >= 0")
    return participant_of(driver, number, None)


def _who(driver: DriverKind | str) -> DriverKind | OwnClass:
    """The driver that a word or the name of a class names; InputError for anything else."""
    named = named_driver("run_day: driver", driver) if isinstance(driver, str) and ":" in driver else None
    return named if isinstance(named, OwnClass) else chosen(DriverKind, "run_day", "driver", driver)
