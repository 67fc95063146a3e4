"""Robustness of a plan: what its speed profile costs in a changed world, and what a new plan would cost there.

The driver follows the planned speeds v(s) as well as the changed train can: where its force is too small, it falls
below the planned speed, and full traction brings it back. Braking begins as early as the changed train needs: no speed
is above the envelope integrated backwards with the changed mass, resistance and adhesion.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from das.domain.conditions import Conditions
from das.domain.errors import DasError, InfeasibleError
from das.domain.trajectory import EnergyBalance, Trajectory
from das.domain.units import KM, KMH, PERCENT, PERMILLE
from das.solver import tolerances as tol
from das.solver.kernels.driving import FULL_BRAKES, braking_envelope
from das.solver.kernels.roll_out import blend_runs
from das.solver.line_profile import LineProfile
from das.solver.section import Section
from das.solver.solution import Solution, trajectory_on
from das.solver.solve import solve_front

Floats = NDArray[np.float64]


class Parameter(StrEnum):
    """What differs from the plan."""

    MASS = "mass"
    RESISTANCE = "resistance"
    WIND = "wind"
    RECEPTIVITY = "receptivity"
    ADHESION = "adhesion"


RELATIVE = (Parameter.MASS, Parameter.RESISTANCE)
"""Parameters that are varied in % of the plan's value; the others are given as values that replace it."""
RANGE_VALUES = 5
"""The number of values of a range a..b, evenly spaced from one end to the other."""
_FIELDS = {
    Parameter.MASS: "mass_ratio",
    Parameter.RESISTANCE: "resistance_ratio",
    Parameter.WIND: "head_wind_mps",
    Parameter.RECEPTIVITY: "receptivity_ratio",
    Parameter.ADHESION: "adhesion_ratio",
}
_NUMBER = r"[+\-−]?\d*\.?\d+"
_RANGE = re.compile(rf"({_NUMBER})\.\.({_NUMBER})")
_BOTH_WAYS = re.compile(r"(?:±|\+/?-)(\d*\.?\d+)")


@dataclass(frozen=True, kw_only=True)
class Variation:
    """One parameter that differs from the plan.

    `value`: change in % of the plan's value (mass, resistance), head wind in km/h, or ratio (receptivity, adhesion).
    `step`: difference from the plan in % (receptivity and adhesion: percentage points) or km/h. `conditions`: all
    conditions of the changed world.
    """

    parameter: Parameter
    value: float
    step: float
    conditions: Conditions

    @classmethod
    def of(cls, plan: Conditions, parameter: Parameter, value: float) -> Variation:
        """A parameter of a plan changed to (or by) a value; raises DasError if that is impossible."""
        planned = getattr(plan, _FIELDS[parameter])
        if parameter in RELATIVE:
            changed, step = planned * (1 + value * PERCENT), value
        elif parameter is Parameter.WIND:
            changed, step = value * KMH, value - planned / KMH
        else:
            changed, step = value, (value - planned) / PERCENT
        conditions = replace(plan, **{_FIELDS[parameter]: changed})
        return cls(parameter=parameter, value=value, step=0.0 if conditions == plan else step, conditions=conditions)

    @property
    def unit(self) -> str:
        """The unit of `step`."""
        return "km/h" if self.parameter is Parameter.WIND else "%"

    @property
    def label(self) -> str:
        if self.parameter is Parameter.WIND:
            return f"{'tail' if self.value < 0 else 'head'} wind {abs(self.value):g} km/h"
        return (
            f"{self.parameter} {self.value:+g} %" if self.parameter in RELATIVE else f"{self.parameter} {self.value:g}"
        )


def parse_variations(text: str, plan: Conditions) -> list[Variation]:
    """The variations of `mass=±5%,±10%,wind=-20..20,…`: values, ± both ways, ranges a..b; each once.

    A range leaves out the plan's own value. Raises DasError for a value that cannot be read or is impossible.
    """
    found: dict[tuple[Parameter, float], Variation] = {}
    parameter = None
    for part in text.replace(" ", "").split(","):
        name, given, values = part.rpartition("=")
        if given:
            parameter = _parameter(text, name)
        if parameter is None:
            raise _unreadable(text, part)
        for value in _values(text, parameter, values):
            variation = _variation(text, plan, parameter, value)
            if ".." not in values or variation.conditions != plan:
                found.setdefault((parameter, value), variation)
    if not found:
        raise DasError(f"--vary {text}: nothing that differs from the plan")
    return list(found.values())


def _variation(text: str, plan: Conditions, parameter: Parameter, value: float) -> Variation:
    try:
        return Variation.of(plan, parameter, value)
    except DasError as error:
        raise DasError(f"--vary {text}: {error}") from None


def _parameter(text: str, name: str) -> Parameter:
    if name not in list(Parameter):
        raise DasError(f"--vary {text}: no parameter {name!r}; expected one of {', '.join(Parameter)}")
    return Parameter(name)


def _values(text: str, parameter: Parameter, values: str) -> list[float]:
    relative = parameter in RELATIVE
    plain = values.removesuffix("%")
    if relative is not values.endswith("%"):
        unit = "a change in %, like ±10%" if relative else "a value without %, like 0.5"
        raise DasError(f"--vary {text}: {parameter}={values}: expected {unit}")
    if both := _BOTH_WAYS.fullmatch(plain):
        size = float(both[1])
        return [-size, size]
    if ends := _RANGE.fullmatch(plain):
        first, last = (_number(end) for end in ends.groups())
        return [float(value) for value in np.linspace(first, last, RANGE_VALUES)]
    if not re.fullmatch(_NUMBER, plain):
        raise _unreadable(text, f"{parameter}={values}")
    return [_number(plain)]


def _number(text: str) -> float:
    return float(text.replace("−", "-"))


def _unreadable(text: str, part: str) -> DasError:
    return DasError(
        f"--vary {text}: cannot read {part!r}; expected something like mass=±10%,wind=-20..20,receptivity=0.5"
    )


OFF_PLAN_MPS = 1.0 * KMH
"""Distance (m/s) from the planned speed beyond which a speed is off the plan."""
REPLANNED_TOLERANCE_S = 2e-3
"""Tolerance (s) of a new plan's trip time: a second changes the energy by more than some variations do."""
LEAST_ENERGY_J = 1.0
"""Energy (J) below which a plan is too small to be the base of ratios."""

World = Callable[[Conditions], Section]
"""The section under given conditions; raises DasError if there is none."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Followed:
    """A plan as driven in another world. `off_plan_ratio`: share of the distance driven off the planned speed."""

    trajectory: Trajectory
    balance: EnergyBalance
    off_plan_ratio: float

    @property
    def time_s(self) -> float:
        return self.trajectory.time_s


@dataclass(frozen=True, kw_only=True, eq=False)
class VariationOutcome:
    """What a variation does to a plan.

    `followed`: the plan as driven. Beside it are optima of the changed world: `on_time` for the planned time (or the
    fastest run, which is late) and `same_time` for the time that following the plan took. None: there is no such run.
    `trouble` says why there is none, or what is wrong with `followed`. Ratios are relative to the plan's energy at the
    collector.
    """

    plan: Solution
    variation: Variation
    followed: Followed | None = None
    on_time: Solution | None = None
    same_time: Solution | None = None
    trouble: str | None = None

    @property
    def late_s(self) -> float | None:
        """How much later than planned the followed plan arrives (s; early < 0)."""
        return self.followed.time_s - self.plan.time_s if self.followed else None

    @property
    def extra_ratio(self) -> float | None:
        """Energy of the followed plan above the plan's own."""
        return self._ratio(self.followed, self.plan)

    @property
    def on_time_late_s(self) -> float | None:
        """How much later than planned a new plan for the planned time arrives (s).

        It is early (< 0) only if the run of least energy takes less than the planned time.
        """
        return self.on_time.time_s - self.plan.time_s if self.on_time else None

    @property
    def on_time_extra_ratio(self) -> float | None:
        """Energy of a new plan for the planned time above the plan's own."""
        return self._ratio(self.on_time, self.plan)

    @property
    def saved_ratio(self) -> float | None:
        """The energy that a new plan saves compared with following the old one, both in the same time."""
        return self._ratio(self.followed, self.same_time)

    def per_step(self, effect: float | None) -> float | None:
        """An effect per unit of the variation."""
        return effect / self.variation.step if effect is not None and self.variation.step else None

    def _ratio(self, run: Followed | Solution | None, base: Solution | None) -> float | None:
        planned_j = abs(self.plan.balance.input)
        if run is None or base is None or planned_j < LEAST_ENERGY_J:
            return None
        return (run.balance.input - base.balance.input) / planned_j


def assess(plan: Solution, variation: Variation, world: World) -> VariationOutcome:
    """Drive a plan in another world, and replan there."""
    outcome = VariationOutcome(plan=plan, variation=variation)
    try:
        section = world(variation.conditions)
        front = solve_front(section)
        on_time = front.trajectory(plan.time_s, tolerance_s=REPLANNED_TOLERANCE_S)
    except DasError as error:
        # The changed train cannot climb or brake here, or its losses are not known.
        return replace(outcome, trouble=f"no run at all: {error}")
    try:
        followed = follow(plan.trajectory, section)
    except DasError as error:
        return replace(outcome, on_time=on_time, trouble=f"following the plan {error}")
    return replace(
        outcome,
        followed=followed,
        on_time=on_time,
        same_time=front.trajectory(followed.time_s, tolerance_s=REPLANNED_TOLERANCE_S),
        trouble=_wrong_end(followed, section),
    )


def follow(plan: Trajectory, section: Section) -> Followed:
    """Drive the speeds of a plan on a section that may differ from the plan's in all but its ends.

    Raises InfeasibleError if the train stalls or cannot brake.
    """
    line = _on_both_grids(plan.s_m, section)
    envelope = _envelope(line, section)
    planned = np.sqrt(np.interp(line.node_m, plan.s_m, plan.v_mps**2))
    speeds = np.full(len(planned), np.nan)
    # A blend of the plan with itself is the plan, cut to what the train can do.
    time_s = blend_runs(1.0, planned, planned, line.for_kernels, envelope, section.train, speeds)
    if time_s < 0:
        stalled = int(np.isnan(speeds).argmax()) - 1
        raise InfeasibleError(f"the train stalls at {_place(line, stalled)}")
    trajectory = trajectory_on(section, line, speeds)
    off = np.abs(speeds - planned) > OFF_PLAN_MPS
    return Followed(
        trajectory=trajectory,
        balance=trajectory.balance(section.vehicle, section.loss),
        off_plan_ratio=float((off[:-1] | off[1:]) @ line.step_m / line.step_m.sum()),
    )


def _on_both_grids(planned_m: Floats, section: Section) -> LineProfile:
    """The line at the nodes of the plan and at the nodes of the changed section, which suit the changed train."""
    after = np.clip(np.searchsorted(planned_m, section.node_m), 1, len(planned_m) - 1)
    apart = np.minimum(np.abs(section.node_m - planned_m[after - 1]), np.abs(section.node_m - planned_m[after]))
    node_m = np.union1d(planned_m, section.node_m[apart > tol.MIN_STEP_M])
    return LineProfile.on(section.route, section.vehicle, node_m, section.train_length_m)


def _envelope(line: LineProfile, section: Section) -> Floats:
    """Fastest speed at each node of a line from which the changed train keeps all limits ahead."""
    end_mps = section.end_speed_mps
    envelope, stuck = braking_envelope(line.for_kernels, line.limit_mps, end_mps, section.train, FULL_BRAKES)
    if stuck >= 0:
        raise InfeasibleError(f"the train cannot brake on the descent at {_place(line, stuck)}")
    return np.asarray(envelope)


def _place(line: LineProfile, i: int) -> str:
    return f"km {line.node_m[i] / KM:.3f} ({line.grade_ratio[i] / PERMILLE:.1f} ‰)"


def _wrong_end(followed: Followed, section: Section) -> str | None:
    end_mps = followed.trajectory.v_mps[-1]
    if abs(end_mps - section.end_speed_mps) <= tol.SPEED_TOLERANCE_MPS:
        return None
    return f"following the plan the train ends at {end_mps / KMH:.1f} km/h, not {section.end_speed_mps / KMH:.1f} km/h"


def by_effect(outcomes: list[VariationOutcome]) -> list[list[VariationOutcome]]:
    """Pairs of variations equally far from the plan on either side, in falling order of their effect on the energy.

    Pairs with a variation that cannot be driven come before all others.
    """
    pairs: dict[tuple[str, float], list[VariationOutcome]] = {}
    for outcome in sorted(outcomes, key=lambda x: x.variation.value):
        variation = outcome.variation
        pairs.setdefault((variation.parameter, round(abs(variation.step), 9)), []).append(outcome)
    return sorted(pairs.values(), key=_effect_ratio, reverse=True)


def _effect_ratio(pair: list[VariationOutcome]) -> float:
    if any(outcome.followed is None for outcome in pair):
        return math.inf
    return max(abs(outcome.extra_ratio or 0.0) for outcome in pair)
