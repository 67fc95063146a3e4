"""Looking up what the optimum does next from any state, without a roll-out, in well under 0.2 ms.

The cab does not use it: on board the whole run is rolled out. It serves analyses of tables and the bench.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from das.domain.errors import DasError, InfeasibleError
from das.domain.units import KMH
from das.solver.front import Front
from das.solver.solution import Fit
from das.solver.state import check_state
from precompute.tables import look_up_kernels

_FITS = {
    look_up_kernels.ON_TIME: Fit.ON_TIME,
    look_up_kernels.LATE: Fit.LATE,
    look_up_kernels.EARLY: Fit.EARLY,
}


class Continuation(NamedTuple):
    """What the optimum does from a state.

    `speed_mps` is the advised speed at `next_m`, the next decision node, and `force_n` the mean wheel force up to there
    (traction > 0, all brakes < 0) within what the train can do now. `time_to_go_s` and `energy_to_go_j` (at the
    current collector) count to the end of the section on the decision grid: they differ from those of a rolled-out
    trajectory by its finer integration.
    """

    fit: Fit
    lambda_w: float
    next_m: float
    speed_mps: float
    force_n: float
    energy_to_go_j: float
    time_to_go_s: float


class LookUp:
    """Answers from the policies of a front, which was solved or read from a table."""

    def __init__(self, front: Front) -> None:
        section = front.section
        self._section, self._node_m = section, section.node_m[section.decision]
        self._arrays = (
            section.node_m, section.decision, *section.for_kernels, *section.bounds, *front.policies,
            section.train, section.loss_params,
        )  # fmt: skip

    def __call__(self, s_m: float, v_mps: float, time_left_s: float) -> Continuation:
        """The continuation from position `s_m` (m) and speed `v_mps` with `time_left_s` to the end of the section.

        Raises DasError for a state outside the section or a time that is not a number, InfeasibleError where the
        policies know no way on.
        """
        section = self._section
        check_state(section, s_m, v_mps)
        if math.isnan(time_left_s):
            raise DasError(f"time left {time_left_s} s: expected a number")
        code, price_w, k, speed_mps, force_n, energy_j, time_s = look_up_kernels.look_up(
            float(s_m), float(v_mps), float(time_left_s), *self._arrays
        )
        if code == look_up_kernels.STUCK:
            raise InfeasibleError(
                f"{section.route.source}: no way on is known from {s_m:.1f} m at {v_mps / KMH:.1f} km/h"
            )
        return Continuation(
            fit=_FITS[code],
            lambda_w=price_w,
            next_m=float(self._node_m[k]),
            speed_mps=speed_mps,
            force_n=force_n,
            energy_to_go_j=energy_j,
            time_to_go_s=time_s,
        )
