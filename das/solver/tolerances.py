"""Every tolerance and grid parameter of the solver, in one place."""

from __future__ import annotations

from typing import Final

# Length of the decision steps (see `das.solver.line_profile`).
STEP_S: Final = 3.2
"""Longest time (s) of the fastest run over a decision step if the line changes every `USUAL_APART_M`."""
USUAL_APART_M: Final = 1000.0
"""Usual distance (m) between changes of limit or gradient. With a distance d between changes, the steps are multiplied
by the cube root of (d / `USUAL_APART_M`), because closely spaced changes require more switches."""
DENSE_FACTOR: Final = 0.3
"""Least factor on the length of decision steps: where the line changes often."""
SPARSE_FACTOR: Final = 1.5
"""Largest factor on the length of decision steps: where the line changes rarely."""
STEEP_CHANGE_RATIO: Final = 0.01
"""Least difference of gradients that counts as a change; it changes the acceleration by 0.1 m/s²."""
MAX_STEP_M: Final = 150.0
"""Largest distance (m) between decision nodes of a long section."""
SHORTEST_MAX_STEP_M: Final = 5.0
"""Least value (m) of the longest step, for a short section or a slow train."""
STEPS_OF_A_SECTION: Final = 80
"""Divisor of the section's length that gives the longest step, at least `SHORTEST_MAX_STEP_M` and at most `MAX_STEP_M`.
On a section of 200 m, steps of 25 m cost 0.6 % of its energy."""

# The decision grid of a section: nodes near stops, speeds, and candidate landings (speeds at the next node).
STOP_OFFSETS_M: Final = (2.0, 5.0, 10.0, 20.0, 40.0, 70.0, 110.0, 160.0, 220.0, 300.0)
"""Distances (m) of extra decision nodes from both ends of a section, where the speed changes fastest."""
SPEED_STEPS: Final = 160
"""Speed steps J of a decision node: its grid is v = v_floor + (v_envelope − v_floor)·j/J."""
SHORT_SPEED_STEPS: Final = 320
"""Speed steps of a decision node of a short section, whose small front allows a finer grid."""
FEW_NODES: Final = 100
"""Largest number of decision nodes of a section with `SHORT_SPEED_STEPS`."""
LANDINGS_EFFORT: Final = 13
"""Number of landing speeds tried from each state between full electric brake and full traction."""
LANDINGS_BRAKE: Final = 4
"""Number of landing speeds tried from each state between the hardest brake and full electric brake."""
SUBSTEP_SPEED_RATIO: Final = 0.005
"""Largest relative change of the fastest run's speed within an integration step."""
SUBSTEP_DRIFT_MPS: Final = 0.01
"""Largest drift of the speed (m/s) within an integration step, at constant force on a changing slope."""
MAX_SUBSTEPS: Final = 80
"""Largest number of integration steps in a decision step."""

# The ladder of multipliers λ (the price of time, W) for which a section is solved.
LADDER_SIZE: Final = 64
"""Number of multipliers of a front."""
LADDER_LOWEST_RATIOS: Final = (0.0, 0.0005, 0.002)
"""The first multipliers, as multiples of the traction power usable on the section; they give very slow runs."""
LADDER_LOW_RATIO: Final = 0.005
"""Multiple of the traction power usable on the section at which the geometric part of the ladder begins."""
LADDER_HIGH_RATIO: Final = 10.0
"""Multiple of the traction power usable on the section at which the geometric part of the ladder ends; its runs are
almost the fastest."""
LADDER_HIGHEST_RATIOS: Final = (20.0, 45.0, 100.0)
"""The last multipliers, as multiples of the traction power usable on the section. With a buffer of 0.1 % the price of
time is at least ten times that power; without the last multipliers, such a run needs up to 1 % more energy."""
LADDER_IDLE_RATIOS: Final = (0.99, 0.95, 0.8, 0.5, 0.2)
"""Multiples of the train's idle loss that, negated, are the negative multipliers of a journey's ladder. They serve time
windows that require a run slower than the run of least energy. At minus the whole idle loss standing would cost
nothing, so the first multiplier, close to it, gives the slowest run."""

# The planning of a journey of several sections.
JOURNEY_FRONTS_BYTES: Final = 400_000_000
"""Largest total size (bytes) of the stored fronts of a journey's sections; others are solved again when needed."""
JOURNEY_TIME_TOLERANCE_S: Final = 0.002
"""Tolerance (s) of the time of a section's run; the errors of the sections add up."""
PASSING_SPEED_STEP_MPS: Final = 1e-6
"""Tolerance (m/s) in the search for the lowest passing speed with which later points are reached in time."""
PASSING_BAND_RATIO: Final = 1e-3
"""Largest relative reduction of a prescribed passing speed, which gives the grid several speeds there."""

# Limits for equal values, standing trains and infeasible states.
MIN_STEP_M: Final = 1e-3
"""Distance (m) below which two breakpoints count as one."""
SPEED_TOLERANCE_MPS: Final = 1e-6
"""Largest excess (m/s) over a bound at which a speed is on the bound."""
TIME_TOLERANCE_S: Final = 0.02
"""Tolerance (s) of the requested time: far less than the second between two advice messages."""
UNREACHABLE: Final = 1e16
"""Cost (J) above which a value was interpolated with `INFEASIBLE` and its state is infeasible as well."""
INFEASIBLE: Final = 1e30
"""The cost (J) of a state from which the section cannot be finished; finite, to allow interpolation."""
SMALLEST_SHARE: Final = 1e-9
"""Interpolation weight up to which the weight is treated as a rounding error, that is, as 0."""
CREST_MPS: Final = 0.05
"""Lowest planned speed (m/s) at a crest; a train at exactly the floor speed would stop there."""
SLOWEST_LIMIT_MPS: Final = 2.0
"""Lowest speed (m/s) to which the margin below a limit may reduce it; a lower limit remains unchanged."""
CREEP_MPS: Final = 0.1
"""Least speed (m/s) at the start of the last decision step; a slower train first accelerates as fast as allowed."""
