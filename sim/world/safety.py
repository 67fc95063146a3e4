"""What must not happen: signals passed at danger, and speeds above what is allowed."""

from __future__ import annotations

from collections.abc import Sequence

from das.domain.restriction import Restriction
from das.domain.units import KM, kmh
from sim.drive.limits import BEYOND_M, OVER_MPS, Violations
from sim.plant.plant import PlantState


class Watch:
    """Looks at every state of a run; its methods are to be called in the order of time."""

    def __init__(self, length_m: float) -> None:
        self._length_m = length_m
        self._passed: set[float] = set()
        self._beyond_m, self._over_s, self._over_mps = 0.0, 0.0, 0.0
        self._is_over = False

    @property
    def found(self) -> Violations:
        """What the run has violated so far."""
        return Violations(
            signals_passed=len(self._passed),
            beyond_signal_m=self._beyond_m,
            over_limit_s=self._over_s,
            over_limit_mps=self._over_mps,
        )

    def take(
        self,
        state: PlantState,
        span_s: float,
        *,
        signal_m: float,
        limit_mps: float,
        temporary: Sequence[Restriction],
    ) -> list[str]:
        """Note a state that lasted for a time, under a signal at danger, the line's limit and temporary limits.

        Returns a sentence about each new violation.
        """
        return [*self._signal(state, signal_m), *self._speed(state, span_s, limit_mps, temporary)]

    def _signal(self, state: PlantState, signal_m: float) -> list[str]:
        beyond_m = state.s_m - signal_m
        if beyond_m <= BEYOND_M:
            return []
        self._beyond_m = max(self._beyond_m, beyond_m)
        if signal_m in self._passed:
            return []
        self._passed.add(signal_m)
        return [f"signal at km {signal_m / KM:.1f} passed at danger"]

    def _speed(self, state: PlantState, span_s: float, limit_mps: float, temporary: Sequence[Restriction]) -> list[str]:
        here = [x.limit_mps for x in temporary if x.is_under(state.s_m, state.s_m, self._length_m)]
        allowed_mps = min([limit_mps, *here])
        was_over, over_mps = self._is_over, state.speed_mps - allowed_mps
        self._is_over = over_mps > OVER_MPS
        if not self._is_over:
            return []
        self._over_s += span_s
        self._over_mps = max(self._over_mps, over_mps)
        if was_over:
            return []
        return [f"{kmh(state.speed_mps):.0f} km/h where {kmh(allowed_mps):.0f} are allowed"]
