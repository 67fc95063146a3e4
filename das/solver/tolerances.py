"""Every tolerance and grid parameter of the solver, in one place."""

from __future__ import annotations

from typing import Final

# How long a decision step may be (see `das.solver.line_profile`).
STEP_S: Final = 3.2
"""The fastest run takes at most this time (s) for a decision step where the line changes every `USUAL_APART_M`."""
USUAL_APART_M: Final = 1000.0
"""Changes of limit or gradient this far apart (m) are usual. With a distance d between changes, the steps
are multiplied by the cube root of (d / this distance), because changes near each other ask for more switches."""
DENSE_FACTOR: Final = 0.3
"""Where changes are dense, the steps are multiplied by at least this factor."""
SPARSE_FACTOR: Final = 1.5
"""Where changes are sparse, the steps are multiplied by at most this factor."""
STEEP_CHANGE_RATIO: Final = 0.01
"""A change of gradient of at least this ratio counts as a change; it changes the acceleration by 0.1 m/s²."""
MAX_STEP_M: Final = 150.0
"""The decision nodes of a long section are at most this far apart (m)."""
SHORTEST_MAX_STEP_M: Final = 5.0
"""On a short section, or for a slow train, the longest step may shrink to this (m), but not further."""
STEPS_OF_A_SECTION: Final = 80
"""The longest step is the section's length over this number, but at least `SHORTEST_MAX_STEP_M` and at most
`MAX_STEP_M`. On a section of 200 m, steps of 25 m cost 0.6 % of its energy."""

# The decision grid of a section: nodes near stops, speeds, and the landings (speeds at the next node) tried.
STOP_OFFSETS_M: Final = (2.0, 5.0, 10.0, 20.0, 40.0, 70.0, 110.0, 160.0, 220.0, 300.0)
"""A section has decision nodes at these distances (m) from both of its ends, where the speed changes fastest."""
SPEED_STEPS: Final = 160
"""A decision node has this number J of speed steps: its grid is v = v_floor + (v_envelope − v_floor)·j/J."""
SHORT_SPEED_STEPS: Final = 320
"""A decision node of a short section has this number of speed steps. The front of a short section is small, so that
a finer grid is affordable."""
FEW_NODES: Final = 100
"""A section with at most this number of decision nodes is short in the sense of `SHORT_SPEED_STEPS`."""
LANDINGS_EFFORT: Final = 13
"""From each state this number of landing speeds between full electric brake and full traction is tried."""
LANDINGS_BRAKE: Final = 4
"""From each state this number of landing speeds between the hardest brake and full electric brake is tried."""
SUBSTEP_SPEED_RATIO: Final = 0.005
"""Within a step of integration the speed of the fastest run changes by at most about this ratio."""
SUBSTEP_DRIFT_MPS: Final = 0.01
"""At a constant force, a slope that changes under the train makes the speed drift by at most this (m/s) within a
step of integration."""
MAX_SUBSTEPS: Final = 80
"""One step of the decision grid has at most this number of steps of integration."""

# The ladder of multipliers λ (the price of time, W) for which a section is solved.
LADDER_SIZE: Final = 64
"""A front has this number of multipliers."""
LADDER_LOWEST_RATIOS: Final = (0.0, 0.0005, 0.002)
"""The first multipliers, as multiples of the traction power that can be used on the section: very slow runs."""
LADDER_LOW_RATIO: Final = 0.005
"""The geometric part of the ladder begins at this multiple of the traction power usable on the section."""
LADDER_HIGH_RATIO: Final = 10.0
"""The geometric part of the ladder ends at this multiple of the traction power usable on the section; there
runs are almost the fastest."""
LADDER_HIGHEST_RATIOS: Final = (20.0, 45.0, 100.0)
"""The last multipliers, as multiples of the traction power usable on the section. With a buffer of 0.1 % the price
of time is ten times that power and more: without these multipliers, such a run needs up to 1 % more energy."""
LADDER_IDLE_RATIOS: Final = (0.99, 0.95, 0.8, 0.5, 0.2)
"""The ladder of a journey also has negative multipliers: minus these multiples of the train's idle loss. They serve
a time window that asks for a run slower than that of least energy. At minus the whole idle loss a standing train
would cost nothing, so the first of them gives the slowest run."""

# The planning of a journey of several sections.
JOURNEY_FRONTS_BYTES: Final = 400_000_000
"""Fronts of a journey's sections are kept up to this size in all (bytes); others are solved again when needed."""
JOURNEY_TIME_TOLERANCE_S: Final = 0.002
"""The run of a section hits its time to within this (s), because the errors of the sections add up."""
PASSING_SPEED_STEP_MPS: Final = 1e-6
"""The lowest passing speed from which the points after it are reached in time is found to within this (m/s)."""
PASSING_BAND_RATIO: Final = 1e-3
"""A passing at one given speed may be slower by at most this ratio, so that the grid there has several speeds."""

# Limits below which values count as equal, a train as standing, and a state as impossible.
MIN_STEP_M: Final = 1e-3
"""Two breakpoints nearer to each other than this (m) count as one."""
SPEED_TOLERANCE_MPS: Final = 1e-6
"""A speed above a bound by less than this (m/s) is on the bound."""
TIME_TOLERANCE_S: Final = 0.02
"""A run hits the time that was asked for to within this (s): far less than the second from one advice to the next.
"""
UNREACHABLE: Final = 1e16
"""A cost above this (J) was interpolated with `INFEASIBLE`, so its state is infeasible too."""
INFEASIBLE: Final = 1e30
"""The cost (J) of a state from which the section cannot be finished; finite, so that it can be interpolated."""
SMALLEST_SHARE: Final = 1e-9
"""An interpolation weight below this is rounding, and it is taken as 0."""
CREST_MPS: Final = 0.05
"""A plan passes no crest slower than this (m/s), because a train at exactly the floor speed would stop there."""
SLOWEST_LIMIT_MPS: Final = 2.0
"""A margin below a limit leaves at least this speed (m/s), or the limit itself where that is lower."""
CREEP_MPS: Final = 0.1
"""A train slower than this (m/s) at the start of the last decision step first moves on as fast as it may."""
