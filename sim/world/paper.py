"""The driver's sheet of a simulated day: made of the timetable before the day, and read where the train is."""

from __future__ import annotations

import math
from functools import lru_cache

from das.advice.regimes import InstructionKind, Regime, departure_regime
from das.domain.braking import ServiceBraking
from das.domain.journey import Window
from das.domain.units import NS
from das.solver.front import Front
from das.solver.section import with_braking
from precompute.sheet import SectionSheet, SheetLine, section_sheet
from sim.drivers.cab import Efforts
from sim.drivers.presentations.sheet import SheetLook
from sim.plant.kernels import PlantState
from sim.world.service import Day, Service
from sim.world.surroundings import Calls

VALID_S = 3600.0
"""The driver's view of advice has an end of validity; a sheet, which does not expire, is re-read long before (s)."""
LATE_S = 60.0
"""Lateness (s) above which a driver who leaves a stop runs at line speed to the next stop, as the sheet says."""
SLOW_MPS = 5.0
"""Shortfall of the sheet's speed (m/s) above which a driver does not follow its coasting and braking instructions."""
SHEETS_KEPT = 256
_MODES = {
    InstructionKind.HOLD: Regime.CRUISE,
    InstructionKind.COAST: Regime.COAST,
    InstructionKind.BRAKE: Regime.REDUCED_BRAKE,
}


class PaperSheet:
    """The sheet of a day, read at the place of the train."""

    def __init__(self, day: Day) -> None:
        self._service = day.service

    def look(self, state: PlantState, calls: Calls, now_ns: int) -> SheetLook | None:
        """What the sheet says in a state; None where the driver drives by himself: late, held up, or arrived."""
        blank = SheetLook(time_ns=now_ns, valid_until_ns=now_ns + round(VALID_S / NS), mode=int(Regime.STOP))
        if calls.finished:
            return blank
        sheet = self._sheet(calls.section)
        lines = sheet.lines
        if calls.waits:
            return blank._replace(
                mode=int(Regime.DEPART), next_mode=_mode(lines[0]), next_speed_mps=lines[0].speed_mps,
                next_effort_ratio=lines[0].effort_ratio,
            )  # fmt: skip
        due_ns = self._service.timetables[calls.section].departure_ns
        late_s = calls.departures[-1].time_s - self._service.clock_s(due_ns)
        number = sum(line.posted_m <= state.s_m for line in lines[1:])
        if late_s > LATE_S or _held_up(sheet, lines[number], state):
            return None
        return self._said(blank, lines, number, state)

    def _said(self, blank: SheetLook, lines: tuple[SheetLine, ...], number: int, state: PlantState) -> SheetLook:
        line, efforts = lines[number], Efforts.at(state.speed_mps, self._service.line.train)
        braking = line.kind is InstructionKind.BRAKE
        following = lines[number + 1] if number + 1 < len(lines) else None
        end_m = self._service.stops[-1].position_m if following is None else following.posted_m
        way_m = max(end_m - state.s_m, 0.0)
        said = blank._replace(
            mode=_mode(line), speed_mps=line.speed_mps, effort_ratio=line.effort_ratio, way_m=way_m,
            force_n=-efforts.brakes_n if braking else line.effort_ratio * efforts.traction_n,
        )  # fmt: skip
        if following is None:
            return said
        return said._replace(
            next_mode=_mode(following), next_speed_mps=following.speed_mps, next_effort_ratio=following.effort_ratio,
            next_change_s=way_m / max(state.speed_mps, 1.0),
        )  # fmt: skip

    def _sheet(self, number: int) -> SectionSheet:
        service = self._service
        table, front = service.timetables[number], service.fronts[number]
        braking = service.scenario.braking.of(service.vehicle)
        point_m, window = _window(service, number)
        return _made(front, braking, (table.arrival_ns - table.departure_ns) * NS, point_m, window)


@lru_cache(maxsize=SHEETS_KEPT)
def _made(
    front: Front, braking: ServiceBraking, time_s: float, point_m: float | None, window: Window | None
) -> SectionSheet:
    return section_sheet(with_braking(front.section, braking), time_s, point_m, window)


def _window(service: Service, number: int) -> tuple[float | None, Window | None]:
    """The first passing of a section with a window that is enforced, and the window (s from the departure)."""
    departs_ns = service.timetables[number].departure_ns
    first_m, last_m = (service.stops[i].position_m for i in (number, number + 1))
    for due in service.passings:
        if first_m < due.s_m < last_m and not due.wish and (due.earliest_ns or due.latest_ns):
            earliest_s = (due.earliest_ns - departs_ns) * NS if due.earliest_ns else -math.inf
            latest_s = (due.latest_ns - departs_ns) * NS if due.latest_ns else math.inf
            return due.s_m, Window(earliest_s=earliest_s, latest_s=latest_s)
    return None, None


def _mode(line: SheetLine) -> int:
    return int(_MODES.get(line.kind, departure_regime(line.effort_ratio)))


def _held_up(sheet: SectionSheet, line: SheetLine, state: PlantState) -> bool:
    """Whether a train is so slow that coasting or braking as the sheet says would stop it before its place."""
    slows = line.kind in (InstructionKind.COAST, InstructionKind.BRAKE)
    return slows and state.speed_mps < sheet.speed_at(state.s_m) - SLOW_MPS
