"""The driver's sheet of a section: what to do from which place on, fixed before departure and never changed.

Its instructions are the guide's timeline for the planned running time, with a higher price of a change: what is read
on paper must be little.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from das.advice.guide.planning import Wanted, planned
from das.advice.guide.timeline import timeline
from das.advice.regimes import InstructionKind
from das.domain.journey import Window
from das.solver.guide.policies import GuideFront, PolicySettings
from das.solver.guide.schedule import Prospect, Schedule
from das.solver.section import Section

Floats = NDArray[np.float64]

CHANGE_S = 4.0 * PolicySettings().change_s
"""Time (s) of full power whose energy a change of regime must save: four times the price that the guide has. On a
sheet, every line has to be found, read and remembered."""
PLACE_M = 100.0
"""Step (m) of places on a sheet: a driver can tell them no more closely by posts and boards."""
SETTINGS = PolicySettings(change_s=CHANGE_S, young_s=2.0 * CHANGE_S)


@dataclass(frozen=True, kw_only=True)
class SheetLine:
    """An instruction: what to do from a place (m) on, the speed (m/s) to reach or to hold, and the planned time.

    `after_s` counts from the departure. A coast has the speed at which it ends. `effort_ratio` is the share of the
    largest effort of traction; 0 for what is no traction.
    """

    kind: InstructionKind
    s_m: float
    speed_mps: float
    after_s: float
    effort_ratio: float = 0.0

    @property
    def posted_m(self) -> float:
        """The place (m) as the sheet says it, in tenths of a kilometre: brakes rather early, traction rather late.

        A brake that begins later would be too hard, traction that begins earlier too fast for the limit left behind.
        """
        place = self.s_m / PLACE_M
        if self.kind is InstructionKind.BRAKE:
            return math.floor(place + 0.1) * PLACE_M
        return (math.ceil(place - 0.1) if self.kind is InstructionKind.TRACTION else round(place)) * PLACE_M


@dataclass(frozen=True, kw_only=True, eq=False)
class SectionSheet:
    """The instructions of a section in the order of the line, and the run of a train that follows them.

    `s_m`, `t_s` (from the departure) and `v_mps` are that run; `energy_j` is its energy at the current collector.
    """

    section: Section
    lines: tuple[SheetLine, ...]
    s_m: Floats
    t_s: Floats
    v_mps: Floats
    energy_j: float

    def speed_at(self, s_m: float) -> float:
        """The speed (m/s) of that run at a place (m); v² is linear between the nodes."""
        return float(np.sqrt(np.interp(s_m, self.s_m, self.v_mps**2)))


def section_sheet(
    section: Section, time_s: float, point_m: float | None = None, window: Window | None = None
) -> SectionSheet:
    """The sheet of a section that is driven in a time (s); a window (s from the departure) at a point is kept.

    `section` is planned with the braking of its drivers (`das.solver.section.with_braking`). Raises DasError where the
    train cannot drive the section.
    """
    start_m = float(section.node_m[0])
    wanted = Wanted(s_m=start_m, v_mps=section.start_speed_mps, left_s=time_s)
    if point_m is not None and window is not None:
        wanted = replace(wanted, point_m=point_m, window=window)
    found = planned(GuideFront(section, SETTINGS), wanted)
    return SectionSheet(
        section=section,
        lines=_lines(found.schedule, found.forecast),
        s_m=found.forecast.at_m,
        t_s=found.forecast.times_s,
        v_mps=found.forecast.speeds_mps,
        energy_j=found.forecast.energy_j,
    )


def _lines(schedule: Schedule, forecast: Prospect) -> tuple[SheetLine, ...]:
    """The steps of a schedule as lines. What only coasts or brakes further has no line of its own."""
    found: list[SheetLine] = []
    for step in timeline(schedule):
        slows = step.kind in (InstructionKind.COAST, InstructionKind.BRAKE)
        line = SheetLine(
            kind=step.kind,
            s_m=step.from_m,
            speed_mps=forecast.passes_mps(step.by_m) if slows else step.speed_mps,
            after_s=forecast.passes_s(step.from_m),
            effort_ratio=step.effort if step.kind is InstructionKind.TRACTION else 0.0,
        )
        if slows and found and line.kind is found[-1].kind:
            found[-1] = replace(found[-1], speed_mps=line.speed_mps)
        else:
            found.append(line)
        if slows and step.by_m < step.to_m:
            after_s = forecast.passes_s(step.by_m)
            found.append(SheetLine(kind=InstructionKind.HOLD, s_m=step.by_m, speed_mps=step.speed_mps, after_s=after_s))
    return tuple(found)
