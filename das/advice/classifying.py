"""How the intervals of a run become modes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from das.advice import plan_kernels as kernels
from das.advice.regimes import FOUR_MODES, ROLLING, Regime
from das.advice.settings import DEFAULT, ModeSettings
from das.solver.section import Section
from das.solver.solution import Solution

Floats = NDArray[np.float64]
Modes = NDArray[np.int64]


def classify_modes(solution: Solution, section: Section, settings: ModeSettings = DEFAULT.modes) -> Modes:
    """The mode of each interval of a run, from its forces compared with those available, and from its acceleration.

    Between two stretches of cruising, a train that keeps its speed within a ripple is cruising as well: advising coast
    and traction in turn would ask for what a driver who holds the speed does anyway.
    """
    run, train, vehicle = solution.trajectory, section.train, section.vehicle
    mean = np.maximum(run.mean_speed_mps(), 1e-3)
    rate = np.diff(run.v_mps) / np.maximum(run.interval_s(), 1e-9)
    full = settings.full_effort_ratio
    fastest_rate, hardest_rate = full * train.max_acceleration_mps2, -full * train.max_deceleration_mps2
    accelerating = np.abs(rate) > settings.cruise_acceleration_mps2
    traction, electric = vehicle.traction_effort_n(mean), vehicle.electric_brake_effort_n(mean)
    idle = settings.idle_effort_ratio * train.traction_force_n
    force, friction = run.force_el_n, run.force_friction_n
    modes = np.select(
        [
            friction < -idle,
            ~accelerating & (np.abs(force) > idle),
            (force >= full * traction) | ((force > idle) & (rate >= fastest_rate)),
            force > idle,
            ((force <= -full * electric) & (electric > 0)) | ((force < -idle) & (rate <= hardest_rate)),
            force < -idle,
        ],
        [
            Regime.FRICTION_BRAKE,
            Regime.CRUISE,
            Regime.FULL_TRACTION,
            Regime.REDUCED_TRACTION,
            Regime.FULL_BRAKE,
            Regime.REDUCED_BRAKE,
        ],
        Regime.COAST,
    )
    cruise = int(Regime.CRUISE)
    return np.asarray(kernels.without_ripples(modes.astype(np.int64), run.v_mps, cruise, ROLLING, settings.ripple_mps))


def without_short(modes: Modes, t_s: Floats, settings: ModeSettings = DEFAULT.modes) -> Modes:
    """The modes without those too short for a driver to follow; these become the mode before them.

    Successive modes that are left out last less than `settings.hold_s` together. Brakes are never left out.
    """
    return np.asarray(kernels.without_short(modes, t_s, int(Regime.REDUCED_BRAKE), settings.hold_s))


def four_modes(modes: Modes, solution: Solution, section: Section, settings: ModeSettings = DEFAULT.modes) -> Modes:
    """The modes of a run's intervals as the four that the simplest display knows."""
    run = solution.trajectory
    return _as_four(modes, run.force_el_n, run.mean_speed_mps(), section, settings)


def four_mode(
    mode: Regime, force_n: float, v_mps: float, section: Section, settings: ModeSettings = DEFAULT.modes
) -> Regime:
    """A mode with a wheel force (N) as one of the four that the simplest display knows."""
    return Regime(int(_as_four(np.array(mode), np.array(force_n), np.array(v_mps), section, settings)))


def _as_four(modes: Modes, force_n: Floats, v_mps: Floats, section: Section, settings: ModeSettings) -> Modes:
    """The modes as four: an electric brake far below the full one counts as coasting."""
    electric_n = section.vehicle.electric_brake_effort_n(np.maximum(v_mps, 1e-3))
    weak = (modes == Regime.REDUCED_BRAKE) & (-force_n < settings.weak_brake_ratio * electric_n)
    return np.where(weak, int(Regime.COAST), FOUR_MODES[modes])


def next_changes(modes: Modes) -> Modes:
    """For each interval, the next one in which another mode begins (the number of intervals if there is none)."""
    changes = np.append(np.flatnonzero(np.diff(modes)) + 1, len(modes))
    return np.asarray(changes[np.searchsorted(changes, np.arange(len(modes)), side="right")])
