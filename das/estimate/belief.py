"""An estimate of several unknowns and its covariance, and what one more observation makes of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Belief(NamedTuple):
    """The estimate θ (n,) of n unknowns and its covariance P (n, n)."""

    theta: Floats
    covariance: Floats

    def updated(self, row: Floats, residual: float, variance: float, forgetting: float = 1.0) -> Belief:
        """Return the belief after one observation y = φ·θ + noise.

        `row` is φ (n,), `residual` is y − φ·θ at the present estimate, and `variance` is that of the noise, r.

            K = Pφ/(r + φᵀPφ),  θ ← θ + K·(y − φ·θ),  P ← P − KφᵀP

        Before that comes directional forgetting (Kulhavý 1987), P ← P + (1/λ − 1)·PφφᵀP/(φᵀPφ), which forgets only
        what this observation tells anew; λ is `forgetting`, and 1 forgets nothing.
        """
        toward = self.covariance @ row
        spread = float(row @ toward)
        if not spread > 0:
            return self
        widened = spread / forgetting
        theta = self.theta + toward * (residual * widened / (spread * (variance + widened)))
        # Along Pφ the variance of φᵀθ goes from spread to widened, and from there to widened·r/(widened + r).
        kept = widened * variance / ((widened + variance) * spread)
        return Belief(theta, self.covariance - np.outer(toward, toward) * ((1.0 - kept) / spread))
