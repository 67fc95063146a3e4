"""Driving a simulated train from stop to stop without advice, for the recorded trip of the example."""

from __future__ import annotations

from typing import Final

from das.domain.errors import DasError
from sim.drivers.cab import AT_STOP_M, CabView, Driver
from sim.drivers.knowledge import LineKnowledge
from sim.plant.plant import Plant, PlantState

LOOK_S: Final = 0.2
"""A driver looks and acts this often (s)."""
LOOKS_A_STATE: Final = 5
"""One state is kept for this many looks: one a second."""
LONGEST_S: Final = 7200.0
"""No trip of the example takes longer than this (s)."""


def drive(plant: Plant, driver: Driver, line: LineKnowledge, arrival_s: float) -> list[PlantState]:
    """Drive from standstill at the first stop to standstill at the last, without stopping between.

    `arrival_s` is when the timetable wants the train there, counted from the departure. Returns one state a second and
    the one in which the train has arrived; raises DasError if it does not get there.
    """
    stop_m = line.route.stops[-1].position_m
    state = plant.at(line.route.stops[0].position_m)
    states = [state]
    for look in range(1, round(LONGEST_S / LOOK_S)):
        cab = CabView(
            time_s=state.time_s,
            s_m=state.s_m,
            speed_mps=state.speed_mps,
            limit_mps=float(line.limits_mps.at(state.s_m)),
            stop_m=stop_m,
            departure_s=0.0,
            arrival_s=arrival_s,
        )
        state = plant.advance(state, driver.command(cab), LOOK_S)
        arrived = state.speed_mps <= 0 and stop_m - state.s_m <= AT_STOP_M
        if arrived or look % LOOKS_A_STATE == 0:
            states.append(state)
        if arrived:
            return states
    raise DasError(f"the simulated train did not arrive within {LONGEST_S:.0f} s (it is at {state.s_m:.0f} m)")
