"""The fastest run of a section (interim: hsolver's replaces it)."""

from __future__ import annotations

from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from das.solver.front import Front, Solution
from das.solver.section import Section

_FRONTS: WeakKeyDictionary[Section, Front] = WeakKeyDictionary()


def _bare(section: Section) -> Front:
    front = _FRONTS.get(section)
    if front is None:
        shape = (len(section.decision), section.speed_steps + 1, 0)
        front = Front(
            section=section, lambda_w=np.empty(0), value_j=np.empty(shape), time_to_go_s=np.empty(shape, np.float32)
        )
    return front


def fastest(section: Section, s_m: float | None = None, v_mps: float | None = None) -> Solution:
    return _bare(section).fastest(s_m, v_mps)


def least_time_s(section: Section, s_m: float, v_mps: float) -> float:
    front = _FRONTS[section] = _bare(section)
    return front.least_time_s(s_m, v_mps)


def capped(section: Section, cap_mps: NDArray[np.float64]) -> Section:
    cap = np.maximum(np.minimum(section.envelope_mps, cap_mps), section.floor_mps)
    return replace(section, envelope_mps=cap)
