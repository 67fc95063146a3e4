"""The fastest run of a section, which needs no front: from the start, or from any state."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from das.solver.kernels.fastest import least_time
from das.solver.section import Section
from das.solver.solution import Fit, Solution
from das.solver.state import State, check_state, following_node


def fastest(section: Section, s_m: float | None = None, v_mps: float | None = None) -> Solution:
    """The fastest run from a position (m) and speed (m/s), by default from the start of the section.

    Raises DasError for a state outside the section, InfeasibleError where the section cannot be finished from it.
    """
    state = State.at(section, s_m, v_mps)
    run = state.fastest()
    return state.solution(run, least_time_s=run.time_s, requested_s=run.time_s, fit=Fit.ON_TIME)


def least_time_s(section: Section, s_m: float, v_mps: float) -> float:
    """Time (s) of the fastest run from a position (m) and speed (m/s); raises as `fastest` does.

    The run is followed only until it meets the section's own fastest run, which the section keeps.
    """
    check_state(section, s_m, v_mps)
    following = following_node(section, s_m)
    time_s = least_time(
        following - 1, float(section.node_m[following]) - s_m, v_mps, section.for_kernels, section.envelope_mps,
        section.train, section.fastest_run,
    )  # fmt: skip
    return section.finished_s(time_s, s_m, v_mps)


def capped(section: Section, cap_mps: ArrayLike) -> Section:
    """The section with a lower speed envelope: at each node the smaller of envelope and cap (m/s).

    `cap_mps` is one speed, or one for each integration node. The envelope is nowhere taken below the floor, so that
    a train on it can still climb every hill ahead.
    """
    cap = np.maximum(np.minimum(section.envelope_mps, cap_mps), section.floor_mps)
    return replace(section, envelope_mps=cap)
