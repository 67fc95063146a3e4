"""A matched trip as a smooth run: time, position, speed and acceleration that are consistent with each other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from das.domain.errors import DasError
from das.domain.route import Floats
from das.domain.units import NS
from sim.recording.course import DrivenCourse

if TYPE_CHECKING:
    from sim.trips.matching import MatchedTrip
    from sim.trips.record import Bools

STEP_S: Final = 1.0
"""Time (s) between the samples of a run."""
SMOOTHING_JERK_PSD_M2PS5: Final = 0.03
"""Spectral density of the white-noise jerk (m²/s⁵). With `SMOOTHING_SPEED_SIGMA_MPS`, it makes the smoothing act like a
local fit over about 8 s, with the time constant (σ²/psd)^¼ ≈ 1.7 s."""
SMOOTHING_MAX_POSITION_GAP_S: Final = 6.0
"""Longest gap (s) over which positions are joined; longer gaps are bridged by the motion model alone."""
SMOOTHING_POSITION_SIGMA_M: Final = 25.0
"""Weight of a position per second, as a standard deviation (m): errors of about 6 m last about 15 s, hence 6·√15."""
SMOOTHING_SPEED_SIGMA_MPS: Final = 0.5
"""Weight of a reported speed per second, as a standard deviation (m/s)."""
SMOOTHING_EXACT: Final = 1e-3
"""Standard deviation of exact values: the position of a stop (m), and the speed 0 there (m/s)."""
SMOOTHING_MAX_SPEED_GAP_S: Final = 3.0
"""Longest gap (s) over which reported speeds are joined; longer gaps are bridged by the motion model alone."""
SMOOTHING_USUAL_STEPS_JOINED: Final = 2.0
"""Multiple of the median step up to which points of a sparse record are still joined."""
SMOOTHING_MIN_LAG_GAIN_RATIO: Final = 0.2
"""Share of the spread between integrated speed and position that a lag of the speed must explain; else the lag is 0."""
SMOOTHING_MIN_LAG_GAIN_M: Final = 1.0
"""Spread (m) that a lag must explain; else the lag is 0."""

LAGS_S = np.arange(-2.0, 5.01, 0.25)
"""Lags (s) of the reported speed that are tried."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivenRun:
    """A run on an even grid from departure to arrival, arrays of shape (steps + 1,).

    s is the trapezoidal integral of the speed, and the acceleration is the slope of the speed. `dropout` marks times
    whose reported speed dropped out, `inferred` those in a gap, bridged by inertia alone. `position_rms_m` is the RMS
    distance of s from the matched positions, `speed_lag_s` the lag of reported speeds.
    """

    time_s: Floats
    s_m: Floats
    speed_mps: Floats
    acceleration_mps2: Floats
    start_time_ns: int
    dropout: Bools
    inferred: Bools
    speed_lag_s: float
    position_rms_m: float

    @property
    def course(self) -> DrivenCourse:
        """The train's positions and speeds over time."""
        time_ns = self.start_time_ns + np.rint(self.time_s / NS).astype(np.int64)
        return DrivenCourse(time_ns=time_ns, s_m=self.s_m, speed_mps=self.speed_mps)

    @property
    def top_mps(self) -> float:
        """The highest speed (m/s) outside of gaps."""
        return float(self.speed_mps[~self.inferred].max())


def to_profile(matched: MatchedTrip, jerk_ratio: float = 1.0) -> DrivenRun:
    """Resample a trip from departure to arrival in steps of 1 s, smooth and consistent.

    GPS receivers filter the speed, which delays it by seconds. The lag is estimated by sliding the integrated speed
    against the positions; departure and arrival were found from the speed and are corrected by the lag. The run is then
    the likeliest motion under white jerk of the usual density times `jerk_ratio` (Kalman filter and Rauch–Tung–Striebel
    smoother for s, v, a). A single position has little weight, but positions dominate over long distances; speeds have
    more weight and determine the detail over about 8 s. Positions and the motion model bridge dropouts, the motion
    model alone bridges gaps. An end at which the train stands is exact in position and speed; such an arrival is moved
    to the next step. Negative speeds become 0, and s is integrated from the speed. Raises DasError for a run shorter
    than 3 steps.
    """
    valid = ~matched.invalid
    time_s, place_m, dropout = matched.elapsed_s()[valid], matched.s_m[valid], matched.dropout[valid]
    lag = speed_lag_s(time_s, place_m, matched.speed_mps[valid])
    begin, end = _run_times(matched, lag)
    count = (end - begin) / STEP_S
    steps = int(np.ceil(count - 1e-6) if matched.ends.ends_standing else np.floor(count + 1e-6))
    if steps < 3:
        raise DasError(f"{matched.source}: a run of {end - begin:g} s is too short, expected at least {3 * STEP_S:g} s")
    grid = np.arange(steps + 1, dtype=np.float64) * STEP_S
    position, nowhere = _joined(begin + grid, time_s, place_m, SMOOTHING_MAX_POSITION_GAP_S)
    seen = ~dropout
    speed, unseen = _joined(begin + grid, time_s[seen] - lag, matched.speed_mps[valid][seen], SMOOTHING_MAX_SPEED_GAP_S)
    variance = np.full((2, steps + 1), [[SMOOTHING_POSITION_SIGMA_M**2], [SMOOTHING_SPEED_SIGMA_MPS**2]]) / STEP_S
    variance[0, nowhere], variance[1, unseen] = np.inf, np.inf
    ends = (
        (0, matched.ends.departure, matched.ends.starts_standing),
        (-1, matched.ends.arrival, matched.ends.ends_standing),
    )
    for k, point, standing in ends:
        if standing:
            position[k], speed[k], variance[:, k] = matched.s_m[point], 0.0, SMOOTHING_EXACT**2
    inferred = np.isinf(variance[0]) & np.isinf(variance[1])
    smooth = _smoothed(position, speed, variance, SMOOTHING_JERK_PSD_M2PS5 * jerk_ratio)
    s, v = _integrated(matched, position, np.maximum(smooth, 0.0))
    return DrivenRun(
        time_s=grid,
        s_m=s,
        speed_mps=v,
        acceleration_mps2=np.gradient(v, STEP_S),
        start_time_ns=int(matched.time_ns[0]) + round(begin / NS),
        dropout=np.interp(begin + grid, time_s - lag, dropout.astype(float)) > 0,
        inferred=inferred,
        speed_lag_s=lag,
        position_rms_m=float(np.sqrt(np.mean((s - position)[~nowhere] ** 2))),
    )


def _run_times(matched: MatchedTrip, lag_s: float) -> tuple[float, float]:
    """Departure and arrival (s), never outside the record; its first or last time if the train does not stand."""
    time_s = matched.elapsed_s()
    begin = time_s[matched.ends.departure] - lag_s if matched.ends.starts_standing else time_s[0]
    end = time_s[matched.ends.arrival] - lag_s if matched.ends.ends_standing else time_s[-1]
    return float(max(begin, time_s[0])), float(min(end, time_s[-1]))


def speed_lag_s(time_s: Floats, position_m: Floats, speed_mps: Floats) -> float:
    """The lag (s) of the reported speed behind the positions; 0 if no lag is significant.

    The lag minimises the spread of s(t) − c − k·∫v(t + lag)dt. Because of the free factor k, a speed that is always too
    low does not look delayed.
    """
    spread = []
    for lag in LAGS_S:
        shifted = np.interp(time_s + lag, time_s, speed_mps)
        driven = np.append(0.0, np.cumsum((shifted[1:] + shifted[:-1]) / 2 * np.diff(time_s)))
        around = driven - driven.mean()
        k = np.dot(around, position_m) / max(np.dot(around, around), 1e-9)
        spread.append(float(np.std(position_m - k * driven)))
    best = int(np.argmin(spread))
    none = spread[int(np.argmin(np.abs(LAGS_S)))]
    gain = none - spread[best]
    return float(LAGS_S[best]) if gain > max(SMOOTHING_MIN_LAG_GAIN_RATIO * none, SMOOTHING_MIN_LAG_GAIN_M) else 0.0


def _joined(grid: Floats, time_s: Floats, values: Floats, longest_gap_s: float) -> tuple[Floats, Bools]:
    """Values interpolated on the grid, and a mask of its times without a value: outside the points, or in a gap."""
    if not len(time_s):
        return np.zeros_like(grid), np.ones(len(grid), dtype=bool)
    after = np.searchsorted(time_s, grid)
    inside = ((after > 0) & (after < len(time_s))) | (grid == time_s[0])
    steps = np.append(0.0, np.diff(time_s))
    wide = (
        steps > max(longest_gap_s, SMOOTHING_USUAL_STEPS_JOINED * float(np.median(steps[1:])))
        if len(steps) > 1
        else steps > 0
    )
    return np.interp(grid, time_s, values), ~inside | wide[np.clip(after, 0, len(time_s) - 1)]


def _smoothed(position_m: Floats, speed_mps: Floats, variance: Floats, jerk_psd_m2ps5: float) -> Floats:
    """Speed of the likeliest motion under white jerk; `variance` (2 × n) of positions and speeds, inf: unmeasured."""
    h = STEP_S
    move = np.array([[1, h, h**2 / 2], [0, 1, h], [0, 0, 1]])
    noise = jerk_psd_m2ps5 * np.array(
        [[h**5 / 20, h**4 / 8, h**3 / 6], [h**4 / 8, h**3 / 3, h**2 / 2], [h**3 / 6, h**2 / 2, h]]
    )
    n = len(position_m)
    states, covariances = np.empty((n, 3)), np.empty((n, 3, 3))
    x, p = np.array([position_m[0], speed_mps[0], 0.0]), np.diag([1e4, 1e3, 1.0])
    for k in range(n):
        if k:
            x, p = move @ x, move @ p @ move.T + noise
        for j, value in enumerate((position_m[k], speed_mps[k])):
            gain = p[:, j] / (p[j, j] + variance[j, k])
            x, p = x + gain * (value - x[j]), p - np.outer(gain, p[j])
        states[k], covariances[k] = x, p
    for k in range(n - 2, -1, -1):
        p = covariances[k]
        gain = np.linalg.solve(move @ p @ move.T + noise, move @ p).T
        states[k] += gain @ (states[k + 1] - move @ states[k])
    return states[:, 1].copy()


def _integrated(matched: MatchedTrip, position_m: Floats, v: Floats) -> tuple[Floats, Floats]:
    """Position (m) integrated from the speed, beginning at an end where the train stands, and the speed (m/s).

    If the train stands at both ends, position and speed are scaled to agree to a fraction of a metre.
    """
    if matched.ends.starts_standing:
        v[0] = 0.0
    if matched.ends.ends_standing:
        v[-1] = 0.0
    s = np.append(0.0, np.cumsum((v[1:] + v[:-1]) / 2 * STEP_S))
    if matched.ends.starts_standing and matched.ends.ends_standing:
        factor = (position_m[-1] - position_m[0]) / s[-1]
        return position_m[0] + factor * s, factor * v
    if matched.ends.starts_standing:
        return position_m[0] + s, v
    if matched.ends.ends_standing:
        return position_m[-1] - s[-1] + s, v
    return s + np.mean(position_m - s), v
