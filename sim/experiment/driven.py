"""A trial that was driven, with everything that its measures are found from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from sim.experiment.trace import DriverLook
from sim.plant.plant import PlantState
from sim.world.day import Day
from sim.world.hindsight import true_fronts
from sim.world.loop import LOOK_S, TICK_S, Run
from sim.world.outcome import DayOutcome

LOOKS_A_TICK = round(TICK_S / LOOK_S)


@dataclass(frozen=True, kw_only=True, eq=False)
class Driven:
    """A driven trial: the day, the run, its outcome, and all looks of the driver."""

    day: Day
    run: Run
    outcome: DayOutcome
    looks: Sequence[DriverLook]

    @cached_property
    def seconds(self) -> tuple[tuple[PlantState, DriverLook], ...]:
        """The state and the driver's first look of every second."""
        return tuple(zip(self.run.states, self.looks[::LOOKS_A_TICK], strict=False))

    @cached_property
    def moving(self) -> tuple[tuple[PlantState, DriverLook], ...]:
        """The seconds that begin with a moving train."""
        return tuple((state, look) for state, look in self.seconds if state.speed_mps > 0)

    @property
    def moving_min(self) -> float:
        """How long the train moved (min)."""
        return len(self.moving) * TICK_S / 60.0

    @property
    def equal_arrival_j(self) -> float:
        """The energy (J) at equal arrival: driven − optimum for the times as driven + optimum for the timetable's."""
        energies, service = self.outcome.energies, self.day.service
        planned_s = [service.clock_s(one.arrival_ns) - service.clock_s(one.departure_ns) for one in service.timetables]
        fronts = zip(true_fronts(self.day), planned_s, strict=True)
        on_time_j = sum(front.trajectory(time_s).ledger.input for front, time_s in fronts)
        return energies.driven_j - energies.hindsight_j + on_time_j
