"""The closed loop: train, driver, localisation and disturbances, second by second, with advice at every tick."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from das.cab.heard import Heard
from das.domain.errors import DasError
from sim.drive.calls import KeptCall
from sim.drive.figures import AdviceStability, ShownWatch
from sim.drive.instructions import InstructionFigures, InstructionWatch
from sim.drive.limits import Violations
from sim.drivers.cab import AdviceView, CabView, Driver, DriverEvent, kept_by
from sim.drivers.kinds import Presentation
from sim.drivers.presentations.presenter import Shown, present, presenter_of
from sim.drivers.screen import Screen, ScreenSettings
from sim.plant.kernels import Command, PlantState
from sim.plant.plant import COAST
from sim.world.lockstep import Counts
from sim.world.scenario import EarlyDeparture
from sim.world.service import Day
from sim.world.surroundings import Surroundings

if TYPE_CHECKING:
    from sim.world.simpler import PaperSheet, SimplerDisplays


class Tick(NamedTuple):
    """A tick of the simulation: its number, its time (ns since 1970), and the messages to the on-board system.

    At the first tick that reaches the node, and whenever the restrictions change, the messages contain the list of all
    restrictions in force, even if it is empty. Whenever the targets change, the messages contain all targets in force.
    """

    number: int
    now_ns: int
    told: tuple[Heard, ...]


class Told(NamedTuple):
    """The records of a tick that the on-board system does not receive.

    These are the true state, the cab with its display, the driver's last command, sentences about events, and the
    driver's actions and decisions since the last tick.
    """

    state: PlantState
    cab: CabView
    command: Command
    events: tuple[str, ...]
    decisions: tuple[DriverEvent, ...] = ()


class Link(Protocol):
    """The connection to the on-board system and to the recording."""

    def exchange(self, tick: Tick) -> Any | None:
        """The advice for a tick (`das.advice.advice.Advice` or the bus's message).

        None if the link does not wait for the advice, because the run keeps a pace: `newest` returns the advice later.
        """

    def newest(self) -> Any | None:
        """The newest advice received since the last call; None without any, or if `exchange` has returned it."""

    def tell(self, now_ns: int, told: Told) -> None:
        """Record messages that the on-board system does not receive."""

    def restart(self) -> None:
        """Kill the on-board system and restart it."""


TICK_S = 1.0
LOOK_S = 0.2
"""Interval (s) at which a driver looks and acts."""
BEFORE_S, AFTER_S = 10.0, 10.0
"""Times (s) before the timetable's departure and after the arrival at which a run begins and ends."""
LONGEST_RATIO, LONGEST_S = 3.0, 1800.0
"""Longest run: a multiple of the time of its timetable, plus a time (s)."""

Progress = Callable[[float, float], None]
"""A function called at every tick with the distance covered so far and the whole distance (m)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """A finished run: the state at each tick, the calls at stops, violations, and counts, stability and instructions of
    the advice.

    `legs`: the states at departure and arrival of every section.
    """

    states: tuple[PlantState, ...]
    calls: tuple[KeptCall, ...]
    legs: tuple[tuple[PlantState, PlantState], ...]
    counts: Counts
    violations: Violations
    stability: AdviceStability
    instructions: InstructionFigures
    decisions: tuple[DriverEvent, ...] = ()


class World:
    """One run, simulated to its end by `run`. `screen` filters the display (None: all advice immediately)."""

    def __init__(
        self,
        day: Day,
        driver: Driver,
        presentation: Presentation,
        link: Link,
        screen: ScreenSettings | None = None,
    ) -> None:
        self.day, self.driver, self.presentation, self.link = day, driver, presentation, link
        self._around = Surroundings(day)
        self._events: list[str] = []
        self._shown: tuple[AdviceView | None, int] = (None, 0)
        """The advice on the display; if None, also the number on the bus of the reason why no advice is shown."""
        self._command: Command = COAST
        self._counts, self._shown_watch, self._instruction_watch = Counts(), ShownWatch(), InstructionWatch()
        self._told = 0
        self._screen = Screen(screen)
        self._paper, self._simpler = _in_part(day, presentation)

    def run(self, progress: Progress | None = None) -> Run:
        """Simulate from before the departure to after the last arrival; DasError if the train does not arrive."""
        service, calls = self.day.service, self._around.calls
        first_m, last_m = service.stops[0].position_m, service.stops[-1].position_m
        state = self.day.plant.at(first_m, time_s=-BEFORE_S)
        states = [state]
        latest_s = LONGEST_S + LONGEST_RATIO * service.clock_s(service.timetables[-1].arrival_ns)
        while not calls.finished or state.time_s < calls.arrivals[-1].time_s + AFTER_S:
            tick = len(states)
            # The time is set exactly, because a sum of steps is not exact.
            state = self._second(tick, state)._replace(time_s=tick * TICK_S - BEFORE_S)
            states.append(state)
            past = state.s_m > calls.missed_m
            if past or state.time_s > latest_s:
                failed = "drove past its stop" if past else f"did not arrive within {latest_s:.0f} s"
                at = f"it is at {state.s_m:.0f} m, the next stop at {calls.stop_m:.0f} m"
                raise DasError(f"the simulated train {failed} ({at})")
            if progress is not None:
                progress(state.s_m - first_m, last_m - first_m)
        legs = zip(calls.departures, calls.arrivals, strict=True)
        return Run(
            states=tuple(states),
            calls=tuple(calls.kept()),
            legs=tuple(legs),
            counts=self._counts,
            violations=self._around.watch.found,
            stability=self._shown_watch.found,
            instructions=self._instruction_watch.found,
            decisions=tuple(kept_by(self.driver)),
        )

    def _second(self, tick: int, state: PlantState) -> PlantState:
        around, now_ns = self._around, self.day.service.moment_ns(state.time_s)
        self._events += around.news.update(state)
        answered = self._advise(tick, now_ns, state)
        events, self._events = tuple(self._events), []
        cab = around.cab(state, *self._shown)
        view = cab.shown
        self._shown_watch.look(state.time_s, state.speed_mps, None if view is None else Shown.of(view))
        self.link.tell(now_ns, Told(state, cab, self._command, events, self._decided()))
        for _ in range(round(TICK_S / LOOK_S)):
            if (later := self.link.newest()) is not None:
                answered = self._take(later, state, now_ns)
            cab = around.cab(state, *self._shown)
            self._command = self._let_through(cab, self.driver.command(cab))
            after = self.day.plant.advance(state, self._command, LOOK_S)
            self._events += around.follow(state, after, LOOK_S)
            state = after
        if not answered:
            self._counts = self._counts.plus(None)
        return state

    def _let_through(self, cab: CabView, command: Command) -> Command:
        """The driver's command, or no effort if the train stands, may not leave, and traction is withheld."""
        if cab.may_depart or cab.speed_mps > 0:
            return command
        return COAST if self.day.service.scenario.early_departure is EarlyDeparture.WITHHELD else command

    def _decided(self) -> tuple[DriverEvent, ...]:
        told, kept = self._told, kept_by(self.driver)
        self._told = len(kept)
        return tuple(kept[told:])

    def _advise(self, tick: int, now_ns: int, state: PlantState) -> bool:
        """Ask for advice and show it, unless the node is down or cut off; returns whether advice came immediately."""
        around = self._around
        measured = around.measure(state)
        if around.news.restart_due(state.time_s):
            self._events.append("the node is killed and restarted")
            self.link.restart()
        if around.news.cut_off(state.time_s):
            self._show(state, now_ns, None)
            return False
        told = [*measured, *around.operators(tick, now_ns, state)]
        return self._take(self.link.exchange(Tick(tick, now_ns, tuple(told))), state, now_ns)

    def _take(self, advice: Any | None, state: PlantState, now_ns: int) -> bool:
        """Count and show received advice, and return True; False if there is none."""
        if advice is None:
            self._show(state, now_ns, None)
            return False
        self._counts = self._counts.plus(advice)
        self._instruction_watch.look(advice, state.force_el_n + state.force_friction_n)
        self._show(state, now_ns, advice)
        return True

    def _show(self, state: PlantState, now_ns: int, advice: Any | None) -> None:
        """Show the advice or, on paper, the line of the sheet; without new advice the display stays unchanged."""
        around, paper = self._around, self._paper
        if paper is None and advice is None:
            return
        shown, view = advice, None if paper is None else paper.look(state, around.calls, now_ns)
        if shown is not None and self._simpler is not None:
            shown = self._simpler.look(shown, around.calls.section, around.news.told)
        if shown is not None and paper is None:
            view = present(
                shown,
                self.presentation,
                clock_zero_ns=self.day.service.timetables[0].departure_ns,
                deviation_s=around.compared_s(state),
            )
        on_screen = self._screen.show(view, state.time_s, stands=state.speed_mps <= 0)
        self._shown = on_screen, int(advice.cause) if view is None and advice is not None else 0


def _in_part(day: Day, presentation: Presentation) -> tuple[PaperSheet | None, SimplerDisplays | None]:
    """The sheet, and the display of a part of the advice; None for a presentation that is another one."""
    on_paper, in_part = presentation is Presentation.SHEET, presenter_of(presentation).is_simpler
    if not (on_paper or in_part):
        return None, None
    from sim.world.simpler import PaperSheet, SimplerDisplays  # and with them the offline planner of sheets

    return PaperSheet(day) if on_paper else None, SimplerDisplays(day.service) if in_part else None
