"""Every tolerance and grid parameter of the solver, in one place.

The frozen dataclasses say what each setting means, its unit, and why it has its value. The constants below them are
the same values under names that the kernels can read, for numba compiles constants and not objects.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, kw_only=True)
class StepSettings:
    """How long a decision step may be (see `das.solver.line_profile`)."""

    step_s: float = 3.2
    """The fastest run takes at most this time (s) for a decision step where the line changes every `usual_apart_m`."""
    usual_apart_m: float = 1000.0
    """Changes of limit or gradient this far apart (m) are usual. With a distance d between changes, the steps
    are multiplied by the cube root of (d / this distance), because changes near each other ask for more switches."""
    dense_factor: float = 0.3
    """Where changes are dense, the steps are multiplied by at least this factor."""
    sparse_factor: float = 1.5
    """Where changes are sparse, the steps are multiplied by at most this factor."""
    steep_change_ratio: float = 0.01
    """A change of gradient of at least this ratio counts as a change; it changes the acceleration by 0.1 m/s²."""
    max_step_m: float = 150.0
    """The decision nodes of a long section are at most this far apart (m)."""
    shortest_max_step_m: float = 5.0
    """On a short section, or for a slow train, the longest step may shrink to this (m), but not further."""
    steps_of_a_section: int = 80
    """The longest step is the section's length over this number, but at least `shortest_max_step_m` and at most
    `max_step_m`. On a section of 200 m, steps of 25 m cost 0.6 % of its energy."""


@dataclass(frozen=True, kw_only=True)
class GridSettings:
    """The decision grid of a section: nodes near stops, speeds, and the landings (speeds at the next node) tried."""

    stop_offsets_m: tuple[float, ...] = (2.0, 5.0, 10.0, 20.0, 40.0, 70.0, 110.0, 160.0, 220.0, 300.0)
    """A section has decision nodes at these distances (m) from both of its ends, where the speed changes fastest."""
    speed_steps: int = 160
    """A decision node has this number J of speed steps: its grid is v = v_floor + (v_envelope − v_floor)·j/J."""
    short_speed_steps: int = 320
    """A decision node of a short section has this number of speed steps. The front of a short section is small, so that
    a finer grid is affordable."""
    few_nodes: int = 100
    """A section with at most this number of decision nodes is short in the sense of `short_speed_steps`."""
    landings_effort: int = 13
    """From each state this number of landing speeds between full electric brake and full traction is tried."""
    landings_brake: int = 4
    """From each state this number of landing speeds between the hardest brake and full electric brake is tried."""
    substep_speed_ratio: float = 0.005
    """Within a step of integration the speed of the fastest run changes by at most about this ratio."""
    substep_drift_mps: float = 0.01
    """At a constant force, a slope that changes under the train makes the speed drift by at most this (m/s) within a
    step of integration."""
    max_substeps: int = 80
    """One step of the decision grid has at most this number of steps of integration."""


@dataclass(frozen=True, kw_only=True)
class LadderSettings:
    """The ladder of multipliers λ (the price of time, W) for which a section is solved."""

    size: int = 64
    """A front has this number of multipliers."""
    lowest_ratios: tuple[float, ...] = (0.0, 0.0005, 0.002)
    """The first multipliers, as multiples of the traction power that can be used on the section: very slow runs."""
    low_ratio: float = 0.005
    """The geometric part of the ladder begins at this multiple of the traction power usable on the section."""
    high_ratio: float = 10.0
    """The geometric part of the ladder ends at this multiple of the traction power usable on the section; there
    runs are almost the fastest."""
    highest_ratios: tuple[float, ...] = (20.0, 45.0, 100.0)
    """The last multipliers, as multiples of the traction power usable on the section. With a buffer of 0.1 % the price
    of time is ten times that power and more: without these multipliers, such a run needs up to 1 % more energy."""
    idle_ratios: tuple[float, ...] = (0.99, 0.95, 0.8, 0.5, 0.2)
    """The ladder of a journey also has negative multipliers: minus these multiples of the train's idle loss. They serve
    a time window that asks for a run slower than that of least energy. At minus the whole idle loss a standing train
    would cost nothing, so the first of them gives the slowest run."""


@dataclass(frozen=True, kw_only=True)
class JourneySettings:
    """The planning of a journey of several sections."""

    fronts_bytes: int = 400_000_000
    """Fronts of a journey's sections are kept up to this size in all (bytes); others are solved again when needed."""
    time_tolerance_s: float = 0.002
    """The run of a section hits its time to within this (s), because the errors of the sections add up."""
    passing_speed_step_mps: float = 1e-6
    """The lowest passing speed from which the points after it are reached in time is found to within this (m/s)."""
    passing_band_ratio: float = 1e-3
    """A passing at one given speed may be slower by at most this ratio, so that the grid there has several speeds."""


@dataclass(frozen=True, kw_only=True)
class Tolerances:
    """Limits below which values count as equal, a train as standing, and a state as impossible."""

    min_step_m: float = 1e-3
    """Two breakpoints nearer to each other than this (m) count as one."""
    speed_mps: float = 1e-6
    """A speed above a bound by less than this (m/s) is on the bound."""
    time_s: float = 0.02
    """A run hits the time that was asked for to within this (s): far less than the second from one advice to the next.
    """
    unreachable_j: float = 1e16
    """A cost above this (J) was interpolated with `infeasible_j`, so its state is infeasible too."""
    infeasible_j: float = 1e30
    """The cost (J) of a state from which the section cannot be finished; finite, so that it can be interpolated."""
    smallest_share: float = 1e-9
    """An interpolation weight below this is rounding, and it is taken as 0."""
    crest_mps: float = 0.05
    """A plan passes no crest slower than this (m/s), because a train at exactly the floor speed would stop there."""
    slowest_limit_mps: float = 2.0
    """A margin below a limit leaves at least this speed (m/s), or the limit itself where that is lower."""
    creep_mps: float = 0.1
    """A train slower than this (m/s) at the start of the last decision step first moves on as fast as it may."""


@dataclass(frozen=True, kw_only=True)
class SolverSettings:
    """All settings of the solver."""

    steps: StepSettings = StepSettings()
    """How long a decision step may be."""
    grid: GridSettings = GridSettings()
    """The decision grid and the steps of integration."""
    ladder: LadderSettings = LadderSettings()
    """The multipliers of a front."""
    journey: JourneySettings = JourneySettings()
    """The planning of a journey."""
    tolerances: Tolerances = Tolerances()
    """Limits below which values count as equal, a train as standing, and a state as impossible."""


settings: Final = SolverSettings()
"""The settings that the solver runs with."""

STEP_S: Final = settings.steps.step_s
USUAL_APART_M: Final = settings.steps.usual_apart_m
DENSE_FACTOR: Final = settings.steps.dense_factor
SPARSE_FACTOR: Final = settings.steps.sparse_factor
STEEP_CHANGE_RATIO: Final = settings.steps.steep_change_ratio
MAX_STEP_M: Final = settings.steps.max_step_m
SHORTEST_MAX_STEP_M: Final = settings.steps.shortest_max_step_m
STEPS_OF_A_SECTION: Final = settings.steps.steps_of_a_section
STOP_OFFSETS_M: Final = settings.grid.stop_offsets_m
SPEED_STEPS: Final = settings.grid.speed_steps
SHORT_SPEED_STEPS: Final = settings.grid.short_speed_steps
FEW_NODES: Final = settings.grid.few_nodes
LANDINGS_EFFORT: Final = settings.grid.landings_effort
LANDINGS_BRAKE: Final = settings.grid.landings_brake
SUBSTEP_SPEED_RATIO: Final = settings.grid.substep_speed_ratio
SUBSTEP_DRIFT_MPS: Final = settings.grid.substep_drift_mps
MAX_SUBSTEPS: Final = settings.grid.max_substeps
LADDER_SIZE: Final = settings.ladder.size
LADDER_LOWEST_RATIOS: Final = settings.ladder.lowest_ratios
LADDER_LOW_RATIO: Final = settings.ladder.low_ratio
LADDER_HIGH_RATIO: Final = settings.ladder.high_ratio
LADDER_HIGHEST_RATIOS: Final = settings.ladder.highest_ratios
LADDER_IDLE_RATIOS: Final = settings.ladder.idle_ratios
JOURNEY_FRONTS_BYTES: Final = settings.journey.fronts_bytes
JOURNEY_TIME_TOLERANCE_S: Final = settings.journey.time_tolerance_s
PASSING_SPEED_STEP_MPS: Final = settings.journey.passing_speed_step_mps
PASSING_BAND_RATIO: Final = settings.journey.passing_band_ratio
MIN_STEP_M: Final = settings.tolerances.min_step_m
SPEED_TOLERANCE_MPS: Final = settings.tolerances.speed_mps
TIME_TOLERANCE_S: Final = settings.tolerances.time_s
UNREACHABLE: Final = settings.tolerances.unreachable_j
INFEASIBLE: Final = settings.tolerances.infeasible_j
SMALLEST_SHARE: Final = settings.tolerances.smallest_share
CREST_MPS: Final = settings.tolerances.crest_mps
SLOWEST_LIMIT_MPS: Final = settings.tolerances.slowest_limit_mps
CREEP_MPS: Final = settings.tolerances.creep_mps
