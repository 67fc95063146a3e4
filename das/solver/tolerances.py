"""Every tolerance and grid parameter of the solver, in one place."""

from typing import Final

MAX_STEP_M: Final = 100.0
SHORTEST_MAX_STEP_M: Final = 25.0
STEPS_OF_A_SECTION: Final = 80
"""Longest step of the decision grid: so many of them to a section, between these bounds. On a metro section of 2 km,
steps of 100 m cost up to 1 % of its energy."""
STOP_OFFSETS_M: Final = (2.0, 5.0, 10.0, 20.0, 40.0, 70.0, 110.0, 160.0, 220.0, 300.0)
"""Decision nodes at these distances from both ends of a section."""
SPEED_STEPS: Final = 160
SHORT_SPEED_STEPS: Final = 320
FEW_NODES: Final = 200
"""Number of speed steps J of the fitted speed grid v = v_env·j/J; the second for sections of at most so many nodes."""
LANDINGS_EFFORT: Final = 17
"""Landing speeds between full electric brake and full traction."""
LANDINGS_BRAKE: Final = 6
"""Landing speeds between the hardest brake and full electric brake."""
LADDER_SIZE: Final = 64
"""Number of multipliers λ of a front."""
LADDER_LOWEST_RATIOS: Final = (0.0, 0.0005, 0.002)
"""The first multipliers of the ladder, as multiples of the traction power usable on the section: very slow runs."""
LADDER_LOW_RATIO: Final = 0.005
LADDER_HIGH_RATIO: Final = 10.0
"""The other multipliers run geometrically between these multiples of it."""
SUBSTEP_SPEED_RATIO: Final = 0.005
"""Within a step of integration the speed of the fastest run changes by at most about this ratio."""
SUBSTEP_DRIFT_MPS: Final = 0.01
"""Held at a constant force on the slope that changes under the train, a step's speed drifts by at most this."""
MAX_SUBSTEPS: Final = 80
"""Most steps of integration in one step of the decision grid."""
LADDER_IDLE_RATIOS: Final = (0.99, 0.95, 0.8, 0.5, 0.2)
"""Below 0 a journey's ladder has these multiples of the train's idle loss: for a window that asks for a run slower than
that of least energy. At -1 a standing train would cost nothing; the first is the slowest run that is thought of."""
JOURNEY_FRONTS_BYTES: Final = 400_000_000
"""Fronts of a journey's sections are kept up to this size; the others are solved once more when they are needed."""
JOURNEY_TIME_TOLERANCE_S: Final = 0.002
"""A journey's runs hit their times to within this, for they add up."""
PASSING_SPEED_STEP_MPS: Final = 1e-6
"""To within this the slowest speed is known at which a passing is not too late for what follows."""
PASSING_BAND_RATIO: Final = 1e-3
"""A passing at one given speed is kept to within this."""
MIN_STEP_M: Final = 1e-3
"""Breakpoints nearer than this are one."""
SPEED_TOLERANCE_MPS: Final = 1e-6
"""A speed this little above a bound is on it."""
TIME_TOLERANCE_S: Final = 0.02
"""A requested time is hit to within this."""
UNREACHABLE: Final = 1e16
"""Costs above this (J) are mixed with INFEASIBLE ones."""
SMALLEST_SHARE: Final = 1e-9
"""An interpolation weight below this is rounding and taken as 0."""
CREST_MPS: Final = 0.05
"""No crest is planned to be passed slower than this: at its very floor speed a train would stop there."""
CREEP_MPS: Final = 0.1
"""Slower than this at the start of the last decision step, the train first moves on as fast as it may."""
INFEASIBLE: Final = 1e30
"""Cost of a state from which the section cannot be finished (finite, so that interpolation stays defined)."""
