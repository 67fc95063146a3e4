"""An independent verifier of trajectories: shares no code with the solver, reads raw data (raw_data.py).

A trajectory is the rows of `das-precompute solve --out`: s, t, v, F_el, F_fr, gradient, limit. A row's forces are means
over the distance to the next row, with constant acceleration: the *stated* motion. It must respect every bound
everywhere, to the last digits. The forces are also held constant from row to row and integrated in time, by Runge–Kutta
steps: the *driven* motion. Where the slope changes under the train, the two differ slightly.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.support.raw_data import Floats, G, Line, Loss, Train

SUBSTEPS = 8
"""Runge–Kutta steps in each interval."""
NODES, WEIGHTS = np.polynomial.legendre.leggauss(6)
"""Quadrature over the time of each interval."""
ROUNDING = 1e-6
"""Tolerance of bounds for the stated motion, relative (forces) or in their unit (m/s, s)."""
ROUNDING_N = 1.0
ROUNDING_MPS2 = 1e-5
END_M = 1e-3
"""Tolerance (m) of the ends of a section and of a limit."""
DRIVEN_MPS = 0.1
DRIVEN_MPS2 = 0.02
DRIVEN_POWER_RATIO = 0.01
"""Tolerances of limits, accelerations and powers for the driven motion."""
ARRIVAL_MPS = 0.005
ARRIVAL_M = 0.5
"""Tolerances with which the forces lead to the next row's speed, and at its time to its position."""
BALANCE_RATIO = 1e-3
"""Tolerance of the balance of forces in an interval, as a share of the largest traction force (the plan uses the means
of a tunnel's term and of v² over an interval, not the mean of their product; elsewhere the error is 1e-8)."""
ENERGY_RATIO = 2e-4
"""Tolerance of the energy balance and its claimed terms, as a share of the largest term."""
KWH = 3.6e6


@dataclass(frozen=True)
class Finding:
    """A defect of a trajectory: its kind, number of places, worst place and amount there (SI)."""

    what: str
    count: int
    at_m: float
    excess: float

    def __str__(self) -> str:
        return f"{self.what}: by {self.excess:.6g} at {self.at_m:.2f} m ({self.count} places)"


class Drive:
    """A trajectory on a line with a train: n rows, n − 1 intervals; further axes come before that of the intervals."""

    def __init__(self, rows: Floats, line: Line, train: Train, loss: Loss) -> None:
        self.rows, self.line, self.train, self.loss = rows, line, train, loss
        self.s, self.v = rows[:, 0], rows[:, 2]
        self.step_m, self.step_s = np.diff(self.s), np.diff(rows[:, 1])
        self.electric_n, self.friction_n = rows[:-1, 3], rows[:-1, 4]
        self.faster = np.maximum(self.v[:-1], self.v[1:])
        """The higher stated speed of each interval."""
        self.tunnels = train.tunnel_profile(line)

    def motors_n(self, v: Floats) -> tuple[Floats, Floats]:
        """Largest traction and electric brake at speeds v (…, intervals), as allowed by the power supply."""
        traction, brake = self.train.motors_n(v)
        neutral = self._within(self.line.neutral)
        fixed = neutral | self._within(self.line.no_regeneration)
        return np.where(neutral, 0.0, traction), np.where(fixed, 0.0, brake)

    def _within(self, zones: tuple[tuple[float, float], ...]) -> NDArray[np.bool_]:
        """The intervals in which the head is in one of the zones, at least partly."""
        inside = np.zeros(len(self.step_m), dtype=bool)
        for start, end in zones:
            inside |= np.minimum(self.s[1:], end) - np.maximum(self.s[:-1], start) > END_M
        return inside

    @cached_property
    def bounds_mps2(self) -> tuple[Floats, Floats]:
        """Largest acceleration and deceleration; none where the train applies its full opposing effort."""
        total = self.electric_n + self.friction_n
        traction, brake = self.motors_n(self.faster)
        if self.train.brakes != "electric":
            brake = np.minimum(brake + self.train.friction_n, self.train.both_brakes_n(self.faster))
        braking = total <= -brake * (1 - ROUNDING) + ROUNDING_N
        pulling = total >= traction * (1 - ROUNDING) - ROUNDING_N
        acceleration = np.where(braking, np.inf, self.train.max_acceleration_mps2)
        return acceleration, np.where(pulling, np.inf, self.train.max_deceleration_mps2)

    def _inside(self, s: Floats) -> Floats:
        """Places kept off the ends of their intervals, where a profile under a point mass jumps."""
        margin = 1e-3 * self.step_m
        return np.clip(s, self.s[:-1] + margin, self.s[1:] - margin)

    def resistance_n(self, s: Floats, v: Floats) -> Floats:
        """Running, curve and tunnel resistance at places and speeds (…, intervals)."""
        train, inside = self.train, self._inside(s)
        curves = self.line.curves.under(inside, train.length_m)
        air = train.r2_n_per_mps2 * (v + train.head_wind_mps) ** 2
        return train.r0_n + train.r1_n_per_mps * v + air + self._tunnel(inside) * v * v + train.mass_kg * curves

    def _tunnel(self, s: Floats) -> Any:
        return self.tunnels.under(s, self.train.length_m) if len(self.tunnels.value) > 1 else 0.0

    def acceleration(self, s: Floats, v: Floats) -> Floats:
        """Acceleration due to the forces at places and speeds (…, intervals)."""
        slope = self.train.mass_kg * G * self.line.gradients.under(self._inside(s), self.train.length_m)
        force = self.electric_n + self.friction_n - self.resistance_n(s, v) - slope
        return force / self.train.inertia_kg

    @cached_property
    def driven(self) -> tuple[Floats, Floats]:
        """Places and speeds (SUBSTEPS + 1, intervals) under constant forces, from each row's state, at even times."""
        h = self.step_s / SUBSTEPS
        places, speeds = [self.s[:-1]], [self.v[:-1]]
        for _ in range(SUBSTEPS):
            s, v = places[-1], speeds[-1]
            a1 = self.acceleration(s, v)
            v2 = v + 0.5 * h * a1
            a2 = self.acceleration(s + 0.5 * h * v, v2)
            v3 = v + 0.5 * h * a2
            a3 = self.acceleration(s + 0.5 * h * v2, v3)
            v4 = v + h * a3
            a4 = self.acceleration(s + h * v3, v4)
            places.append(s + h / 6 * (v + 2 * v2 + 2 * v3 + v4))
            speeds.append(v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4))
        return np.array(places), np.array(speeds)

    @cached_property
    def heights_m(self) -> Floats:
        """Height of the train's middle at each row."""
        return self.line.gradients.driven(self.s, self.train.length_m)

    @cached_property
    def stated(self) -> tuple[Floats, Floats]:
        """Places and speeds (NODES, intervals) of the motion at constant acceleration."""
        share = 0.5 * (NODES[:, None] + 1)
        v0, change = self.v[:-1], np.diff(self.v)
        return self.s[:-1] + (v0 * share + 0.5 * change * share**2) * self.step_s, v0 + change * share

    def over_time(self, value: Floats) -> Floats:
        """∫ value dt over each interval of the stated motion."""
        integral: Floats = 0.5 * WEIGHTS @ value * self.step_s
        return integral

    @cached_property
    def resistance_j(self) -> Floats:
        """Work against resistance in each interval."""
        s, v = self.stated
        return self.over_time(self.resistance_n(s, v) * v)

    @cached_property
    def balance_n(self) -> Floats:
        """Mean force required by each interval's motion, minus the stated one."""
        kinetic_j = 0.5 * self.train.inertia_kg * np.diff(self.v**2)
        potential_j = self.train.mass_kg * G * np.diff(self.heights_m)
        return (kinetic_j + potential_j + self.resistance_j) / self.step_m - self.electric_n - self.friction_n

    @cached_property
    def balance_j(self) -> dict[str, float]:
        """Every term of the energy balance, computed separately by quadrature."""
        _, v = self.stated
        way = self.over_time(v)
        loss_w = self.loss(np.broadcast_to(self.electric_n, v.shape), v) + self.train.auxiliary_w
        collector_w = self.electric_n * v + loss_w
        drawn, fed = self.over_time(np.maximum(collector_w, 0.0)), self.over_time(np.maximum(-collector_w, 0.0))
        taken = self.line.receptivity.at(0.5 * (self.s[:-1] + self.s[1:]))
        return {
            "resistance": float(self.resistance_j.sum()),
            "component_loss": float(self.over_time(loss_w).sum()),
            "friction_brake": -float(self.friction_n @ way),
            "unreturned": float((1 - taken) @ fed),
            "kinetic": 0.5 * self.train.inertia_kg * float(self.v[-1] ** 2 - self.v[0] ** 2),
            "potential": self.train.mass_kg * G * float(self.heights_m[-1] - self.heights_m[0]),
            "input": float(drawn.sum() - taken @ fed),
        }


def verify(
    rows: Floats,
    line: Line,
    train: Train,
    loss: Loss,
    *,
    ends_m: tuple[float, float],
    end_speeds_mps: tuple[float, float] = (0.0, 0.0),
    claim: Mapping[str, Any] | None = None,
    driven: bool = True,
) -> list[Finding]:
    """All defects of a trajectory; `claim` is the command's output with --json.

    Without `driven` only the stated motion is checked: below walking speed a constant force cannot follow the slope
    that changes under the train.
    """
    findings = _shape(rows)
    if findings:
        return findings
    drive = Drive(rows, line, train, loss)
    checks = (_speeds, _forces, _brakes, _accelerations, _motion, _balance) + ((_driven,) if driven else ())
    for check in checks:
        findings += check(drive)
    findings += _ends(drive, ends_m, end_speeds_mps)
    return findings + (_claims(drive, claim) if claim is not None else [])


def _over(what: str, at_m: Any, value: Any, most: Any = 0.0) -> list[Finding]:
    """A finding if the value exceeds its bound or is not a number."""
    at_m, value, most = np.broadcast_arrays(at_m, value, most)
    bad = ~(value <= most)
    if not bad.any():
        return []
    excess = np.where(bad, np.nan_to_num(value - most, nan=np.inf), -np.inf)
    worst = int(np.argmax(excess))
    return [Finding(what, int(bad.sum()), float(at_m.flat[worst]), float(excess.flat[worst]))]


def _shape(rows: Floats) -> list[Finding]:
    if rows.ndim != 2 or rows.shape[1] != 7 or len(rows) < 2:
        return [Finding(f"rows of shape {rows.shape}, expected (2 or more, 7)", 1, 0.0, 0.0)]
    s, t, v = rows[:, 0], rows[:, 1], rows[:, 2]
    findings = _over("a value is not finite", s, np.abs(rows).sum(axis=1), 1e300)
    findings += _over("position does not rise", s[:-1], -np.diff(s), -1e-9)
    findings += _over("time does not rise", s[:-1], -np.diff(t), -1e-9)
    return findings + _over("speed below 0", s, -v)


def _ends(drive: Drive, ends_m: tuple[float, float], speeds: tuple[float, float]) -> list[Finding]:
    s, v = drive.s[[0, -1]], drive.v[[0, -1]]
    findings = _over("the section does not begin or end there", s, np.abs(s - ends_m), END_M)
    findings += _over("not the speed at the section's end", s, np.abs(v - speeds), ROUNDING)
    return findings + _over("time does not begin at 0", s[0], abs(drive.rows[0, 1]), ROUNDING)


def _limits(line: Line, train: Train) -> Iterator[tuple[float, float, float]]:
    """Limits by the position of the head: start, end and speed; a limit applies until the tail has left."""
    yield -np.inf, np.inf, train.max_speed_mps
    starts = line.limits.start_m
    for a, b, limit in zip((-np.inf, *starts[1:]), (*starts[1:], np.inf), line.limits.value, strict=True):
        yield a, b + train.length_m, limit


def _speeds(drive: Drive) -> list[Finding]:
    """Limits and the train's own speed, everywhere; v² is linear in s."""
    s0, s1, square = drive.s[:-1], drive.s[1:], drive.v**2
    slope = np.diff(square) / drive.step_m
    above, lowest = np.full(len(s0), -np.inf), np.full(len(s0), np.inf)
    for a, b, limit in _limits(drive.line, drive.train):
        first, last = np.maximum(s0, a), np.minimum(s1, b)
        bound = last - first > END_M
        highest = square[:-1] + np.maximum(slope * (first - s0), slope * (last - s0))
        fastest = np.sqrt(np.maximum(highest, 0.0))
        above = np.where(bound, np.maximum(above, fastest - limit), above)
        lowest = np.where(bound, np.minimum(lowest, limit), lowest)
    findings = _over("speed above the limit over the train", s0, above, ROUNDING)
    return findings + _over("the limit stated is not the line's", s0, np.abs(drive.rows[:-1, 6] - lowest), ROUNDING)


def _forces(drive: Drive) -> list[Finding]:
    """Motors within their force and power at the highest speed of each interval."""
    traction, brake = drive.motors_n(drive.faster)
    findings = _over("traction above force or power", drive.s[:-1], drive.electric_n, _rounded(traction))
    return findings + _over("electric brake above force or power", drive.s[:-1], -drive.electric_n, _rounded(brake))


def _rounded(force_n: Any) -> Any:
    return force_n * (1 + ROUNDING) + ROUNDING_N


def _brakes(drive: Drive) -> list[Finding]:
    """Friction only where the train's brakes and its brake policy allow it."""
    train, s, electric, friction = drive.train, drive.s[:-1], drive.electric_n, -drive.friction_n
    _, motors = drive.motors_n(drive.faster)
    both = train.both_brakes_n(drive.faster)
    most = {"electric": 0.0, "blended": train.friction_n, "friction": both}[train.brakes]
    findings = _over("friction brake pushes", s, -friction, ROUNDING_N)
    findings += _over("friction brake above its force", s, friction, _rounded(most))
    findings += _over("both brakes together above what they can", s, -electric + friction, _rounded(both))
    beside = np.where(friction > ROUNDING_N, electric, -np.inf)
    if train.brakes == "friction":
        findings += _over("electric brake where all is dissipated", s, -electric, ROUNDING_N)
        return findings + _over("friction brake against traction", s, beside, ROUNDING_N)
    fully = -motors * (1 - ROUNDING) + ROUNDING_N
    return findings + _over("friction brake before the motors brake fully", s, beside, fully)


def _accelerations(drive: Drive) -> list[Finding]:
    a, s = np.diff(drive.v**2) / (2 * drive.step_m), drive.s[:-1]
    faster, slower = drive.bounds_mps2
    findings = _over("acceleration above the train's", s, a, faster + ROUNDING_MPS2)
    return findings + _over("deceleration above the train's", s, -a, slower + ROUNDING_MPS2)


def _motion(drive: Drive) -> list[Finding]:
    """Times, stated gradients, balance of forces."""
    s, v = drive.s[:-1], drive.v
    step_s = 2 * drive.step_m / (v[:-1] + v[1:])
    grade = np.diff(drive.heights_m) / drive.step_m
    balance_n = BALANCE_RATIO * drive.train.traction.force_n
    return [
        *_over("not the time of an interval", s, np.abs(drive.step_s - step_s), ROUNDING * (1 + step_s)),
        *_over("the gradient stated is not the line's", s, np.abs(drive.rows[:-1, 5] - grade), ROUNDING),
        *_over("forces do not balance", s, np.abs(drive.balance_n), balance_n),
    ]


def _driven(drive: Drive) -> list[Finding]:
    """The motion under constant forces from row to row, and the bounds that it exceeds."""
    train, s, v = drive.train, drive.s, drive.v
    places, speeds = drive.driven
    above = np.full(speeds.shape, -np.inf)
    for a, b, limit in _limits(drive.line, train):
        bound = (places > a + END_M) & (places < b - END_M)
        above = np.where(bound, np.maximum(above, speeds - limit), above)
    traction, brake = drive.motors_n(speeds.max(axis=0))
    force, more = drive.electric_n, 1 + DRIVEN_POWER_RATIO
    a = drive.acceleration(places, speeds)
    return [
        *_over("driven speed above the limit over the train", places, above, DRIVEN_MPS),
        *_over("traction above the power of the driven speed", s[:-1], force, _rounded(traction * more)),
        *_over("electric brake above the power of the driven speed", s[:-1], -force, _rounded(brake * more)),
        *_over("driven acceleration above the train's", places, a, drive.bounds_mps2[0] + DRIVEN_MPS2),
        *_over("driven deceleration above the train's", places, -a, drive.bounds_mps2[1] + DRIVEN_MPS2),
        *_over("the forces do not lead to the next speed", s[1:], np.abs(speeds[-1] - v[1:]), ARRIVAL_MPS),
        *_over("the forces do not lead to the next place", s[1:], np.abs(places[-1] - s[1:]), ARRIVAL_M),
        *_over("the forces drive it backwards", s[:-1], -speeds.min(axis=0), ARRIVAL_MPS),
    ]


def _balance(drive: Drive) -> list[Finding]:
    balance = drive.balance_j
    used = sum(value for name, value in balance.items() if name != "input")
    open_ratio = abs(balance["input"] - used) / _scale(balance)
    return _over("the energy balance does not close", drive.s[-1], open_ratio, ENERGY_RATIO)


def _claims(drive: Drive, claim: Mapping[str, Any]) -> list[Finding]:
    """Time and energies claimed by the command."""
    end, balance = drive.s[-1], drive.balance_j
    off_s = abs(claim["time_s"] - drive.rows[-1, 1])
    findings = _over("the time said is not the trajectory's", end, off_s, ROUNDING * claim["time_s"])
    for name, value in balance.items():
        off_ratio = abs(claim["ledger_kwh"].get(name, 0.0) * KWH - value) / _scale(balance)
        findings += _over(f"{name} is not what is said", end, off_ratio, ENERGY_RATIO)
    return findings


def _scale(balance: Mapping[str, float]) -> float:
    return max(1.0, *(abs(value) for value in balance.values()))
