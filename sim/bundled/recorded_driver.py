"""The driver of the bundled recording, who can be shown the guide when the trip is driven anew."""

from __future__ import annotations

import math
from typing import Final

from sim.bundled.hurried import DriverStyle, HurriedDriver
from sim.drivers.asked import Asked, asked
from sim.drivers.cab import AdviceView, CabView, Efforts
from sim.drivers.handling import HEEDING
from sim.drivers.knowledge import LineKnowledge
from sim.plant.kernels import Command
from sim.plant.plant import COAST, lever

LOOK_S: Final = 0.2
"""The time (s) between two looks out of the window and at the speedometer."""
GLANCE_S: Final = 5.0
"""The time (s) between two glances at the display; an assumption, that of the default human driver in the mean."""


class RecordedDriver:
    """Drives as in the bundled recording: without advice as fast as the limits allow, regardless of the time. With the
    guide he follows the instruction read at the last glance (`sim.drivers.asked`), with no more than its effort, and
    with the same manner and speed errors as before. Limits of the line and stops are kept in any case; temporary
    restrictions are not known, because the trip has none. He brakes with the motors first, as the train of the
    recording did.
    """

    def __init__(self, line: LineKnowledge, seed: int = 0) -> None:
        self.line, self.seed = line, seed
        self.own: HurriedDriver | None = None
        self.read: AdviceView | None = None
        self.glances_s = -math.inf

    def command(self, cab: CabView) -> Command:
        """The controller's setting until the next look."""
        if cab.shall_stand:
            return COAST
        if self.own is None or self.own.end_m != cab.halt_m:
            self.own = HurriedDriver(self.line.route, self.line.vehicle, cab.halt_m, self.seed, DriverStyle())
        if cab.time_s >= self.glances_s or cab.speed_mps <= 0:
            self.read, self.glances_s = cab.shown and cab.shown.departure, cab.time_s + GLANCE_S
        efforts = Efforts.at(cab.speed_mps, self.line.train)
        top_mps, most_n = _told(self.read, cab.speed_mps, efforts)
        force_n = min(self.own.wanted_force_n(cab.s_m, cab.speed_mps, LOOK_S, top_mps), most_n)
        return lever(efforts.lever_ratio(force_n))


def _told(view: AdviceView | None, speed_mps: float, efforts: Efforts) -> tuple[float, float]:
    """The top speed (m/s) and the largest force (N) that the guide asks for at a speed; infinite without advice."""
    if view is None:
        return math.inf, math.inf
    to_mps, effort = view.shown_speed_mps, view.lever_ratio
    return {
        None: (math.inf, math.inf),
        Asked.ACCELERATE: (to_mps, effort * efforts.traction_n),
        Asked.HOLD: (to_mps, math.inf),
        Asked.COAST: (math.inf, 0.0),
        Asked.BRAKE: (math.inf, effort * efforts.brakes_n),
        Asked.BRAKE_BY_EYE: (max(speed_mps, HEEDING.creeps_mps), math.inf),  # No speeding up before braking.
        Asked.KEEP_BELOW: (to_mps, 0.0),
    }[asked(view.mode, to_mps, effort, speed_mps)]
