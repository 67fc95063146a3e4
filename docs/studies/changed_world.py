"""Robustness of a plan: the cost of its speed profile under changed conditions, and the cost of a new plan there.

`python -m docs.studies.changed_world ROUTE VEHICLE --buffer 7` prints a table; docs/how-to/check-a-plan.md explains it.

The driver follows the planned speeds v(s) as closely as the changed train can: if its force is too small, it falls
below the planned speed and returns with full traction. Braking begins as early as the changed train requires: no speed
is above the envelope integrated backwards with the changed mass, resistance and adhesion.
"""

from __future__ import annotations

import math
from argparse import ArgumentParser
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from das.command_line.printing import new_table, print_table
from das.domain.conditions import Conditions
from das.domain.errors import DasError, InfeasibleError
from das.domain.files.load import load_vehicle
from das.domain.trajectory import EnergyBalance, Trajectory
from das.domain.units import KM, KMH, PERCENT, PERMILLE, kwh
from das.domain.vehicle import Vehicle
from das.solver import tolerances as tol
from das.solver.kernels.driving import FULL_BRAKES, braking_envelope
from das.solver.kernels.roll_out import blend_runs
from das.solver.line_profile import LineProfile
from das.solver.section import Section
from das.solver.solution import Solution, trajectory_on
from das.solver.solve import solve_front
from docs.studies.asked_section import add_section, section_of

Floats = NDArray[np.float64]


class Parameter(StrEnum):
    """The condition that differs from the plan."""

    MASS = "mass"
    RESISTANCE = "resistance"
    WIND = "wind"
    RECEPTIVITY = "receptivity"
    ADHESION = "adhesion"


RELATIVE = (Parameter.MASS, Parameter.RESISTANCE)
"""Parameters that are varied in % of the plan's value; the others are given as values that replace it."""
USUAL = {
    Parameter.MASS: (-10.0, -5.0, 5.0, 10.0),
    Parameter.RESISTANCE: (-20.0, -10.0, 10.0, 20.0),
    Parameter.WIND: (-20.0, -10.0, 10.0, 20.0),
    Parameter.RECEPTIVITY: (0.5, 0.0),
    Parameter.ADHESION: (0.6, 0.3),
}
"""The default values of each parameter; adhesion only for a train with adhesion data."""
_FIELDS = {
    Parameter.MASS: "mass_ratio",
    Parameter.RESISTANCE: "resistance_ratio",
    Parameter.WIND: "head_wind_mps",
    Parameter.RECEPTIVITY: "receptivity_ratio",
    Parameter.ADHESION: "adhesion_ratio",
}


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
        """The variation of a plan's parameter to (or by) a value; raises DasError for an impossible value."""
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


def variations(plan: Conditions, vehicle: Vehicle, texts: Sequence[str] = ()) -> list[Variation]:
    """The variations for texts such as `mass=-10,10`, or the default ones; DasError for an invalid name or value."""
    if not texts:
        known = [one for one in USUAL if one is not Parameter.ADHESION or math.isfinite(vehicle.adhesive_mass_kg)]
        return [Variation.of(plan, one, value) for one in known for value in USUAL[one]]
    found = []
    for text in texts:
        name, _, values = text.partition("=")
        if name not in list(Parameter):
            raise DasError(f"--vary {text}: expected PARAMETER=VALUE,… of {', '.join(Parameter)}")
        try:
            found += [Variation.of(plan, Parameter(name), float(value)) for value in values.split(",")]
        except ValueError:
            raise DasError(f"--vary {text}: expected numbers separated by commas, like mass=-10,10") from None
    return found


OFF_PLAN_MPS = 1.0 * KMH
"""Largest difference (m/s) from the planned speed at which the train counts as on the plan."""
REPLANNED_TOLERANCE_S = 2e-3
"""Tolerance (s) of a new plan's trip time; a second changes the energy more than some variations do."""
LEAST_ENERGY_J = 1.0
"""Energy (J) below which a plan is too small as the base of ratios."""

World = Callable[[Conditions], Section]
"""A function that returns the section under given conditions; raises DasError if there is none."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Followed:
    """A plan as driven under other conditions. `off_plan_ratio`: share of the distance driven off the planned speed."""

    trajectory: Trajectory
    balance: EnergyBalance
    off_plan_ratio: float

    @property
    def time_s(self) -> float:
        return self.trajectory.time_s


@dataclass(frozen=True, kw_only=True, eq=False)
class VariationOutcome:
    """The effect of a variation on a plan.

    `followed`: the plan as driven. `on_time` and `same_time` are optima under the changed conditions: `on_time` for the
    planned time (or the fastest run, which is late), `same_time` for the time that following the plan took. None: there
    is no such run. `trouble` is the reason for that, or the problem of `followed`. Ratios are relative to the plan's
    energy at the collector.
    """

    plan: Solution
    variation: Variation
    followed: Followed | None = None
    on_time: Solution | None = None
    same_time: Solution | None = None
    trouble: str | None = None

    @property
    def late_s(self) -> float | None:
        """The delay of the followed plan at the end (s; early < 0)."""
        return self.followed.time_s - self.plan.time_s if self.followed else None

    @property
    def extra_ratio(self) -> float | None:
        """Additional energy of the followed plan relative to the plan's own."""
        return self._ratio(self.followed, self.plan)

    @property
    def on_time_late_s(self) -> float | None:
        """The delay of a new plan for the planned time (s).

        It is early (< 0) only if the run of least energy takes less than the planned time.
        """
        return self.on_time.time_s - self.plan.time_s if self.on_time else None

    @property
    def on_time_extra_ratio(self) -> float | None:
        """Additional energy of a new plan for the planned time relative to the plan's own."""
        return self._ratio(self.on_time, self.plan)

    @property
    def saved_ratio(self) -> float | None:
        """The saving of a new plan over following the old one, in the same time."""
        return self._ratio(self.followed, self.same_time)

    @property
    def off_plan_ratio(self) -> float | None:
        """Share of the distance on which the train could not follow the plan."""
        return self.followed.off_plan_ratio if self.followed else None

    @property
    def late_s_per_step(self) -> float | None:
        """Delay per unit of the variation (s)."""
        return self._per_step(self.late_s)

    @property
    def extra_ratio_per_step(self) -> float | None:
        """Additional energy per unit of the variation."""
        return self._per_step(self.extra_ratio)

    def _per_step(self, effect: float | None) -> float | None:
        return effect / self.variation.step if effect is not None and self.variation.step else None

    def _ratio(self, run: Followed | Solution | None, base: Solution | None) -> float | None:
        planned_j = abs(self.plan.balance.input)
        if run is None or base is None or planned_j < LEAST_ENERGY_J:
            return None
        return (run.balance.input - base.balance.input) / planned_j


def assess(plan: Solution, variation: Variation, world: World) -> VariationOutcome:
    """Drive a plan under other conditions, and replan there."""
    outcome = VariationOutcome(plan=plan, variation=variation)
    try:
        section = world(variation.conditions)
        front = solve_front(section)
        on_time = front.trajectory(plan.time_s, tolerance_s=REPLANNED_TOLERANCE_S)
    except DasError as error:
        # The changed train cannot climb or brake here, or its losses are unknown.
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
    """Drive the speeds of a plan on a section that has the same ends as the plan's but may otherwise differ.

    Raises InfeasibleError if the train stalls or cannot brake.
    """
    line = _on_both_grids(plan.s_m, section)
    envelope = _envelope(line, section)
    planned = np.sqrt(np.interp(line.node_m, plan.s_m, plan.v_mps**2))
    speeds = np.full(len(planned), np.nan)
    # A blend of the plan with itself is the plan, limited to the train's efforts.
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
    """The line at the nodes of the plan and of the changed section; the latter suit the changed train."""
    after = np.clip(np.searchsorted(planned_m, section.node_m), 1, len(planned_m) - 1)
    apart = np.minimum(np.abs(section.node_m - planned_m[after - 1]), np.abs(section.node_m - planned_m[after]))
    node_m = np.union1d(planned_m, section.node_m[apart > tol.MIN_STEP_M])
    return LineProfile.on(section.route, section.vehicle, node_m, section.train_length_m)


def _envelope(line: LineProfile, section: Section) -> Floats:
    """Highest speed at each node of a line with which the changed train keeps all limits ahead."""
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
    """Pairs of variations at equal distances on both sides of the plan, by decreasing effect on the energy.

    Pairs with an impossible variation come first.
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


COLUMNS: Final = {
    "time\n+s": ("late_s", 1.0, "+z.1f"),
    "energy\n+%": ("extra_ratio", 100.0, "+z.2f"),
    "s per\nstep": ("late_s_per_step", 1.0, "+z.3f"),
    "% per\nstep": ("extra_ratio_per_step", 100.0, "+z.3f"),
    "off\nplan\n%": ("off_plan_ratio", 100.0, ".0f"),
    "on time\n+s": ("on_time_late_s", 1.0, "+z.1f"),
    "on time\n+%": ("on_time_extra_ratio", 100.0, "+z.2f"),
    "saved\n%": ("saved_ratio", 100.0, "z.2f"),
}
"""Columns: heading, property of an outcome, factor and format."""
LEGEND: Final = {
    "time, energy": "for a driver who follows the plan, relative to the plan",
    "per step": "the same for 1 % of mass, resistance, receptivity or adhesion, or for 1 km/h of wind",
    "off plan": "share of the distance on which the train could not follow the plan",
    "on time": "a new plan for the planned time: its lateness and its energy, relative to the plan",
    "saved": "by a new plan for the time taken by following the old one",
}


def _cell(outcome: VariationOutcome, name: str, scale: float, form: str) -> str:
    value = getattr(outcome, name)
    return "–" if value is None else f"{scale * value:{form}}"


def main(args: Sequence[str] | None = None) -> None:
    """Plan the section, drive the plan under each changed condition, and print the table."""
    parser = ArgumentParser(prog="python -m docs.studies.changed_world", description=__doc__)
    add_section(parser)
    parser.add_argument("--buffer", type=float, default=7.0, metavar="PERCENT")
    parser.add_argument("--vary", nargs="+", default=(), metavar="PARAMETER=VALUE,…")
    given = parser.parse_args(args)
    section = section_of(given)
    front = solve_front(section)
    plan = front.trajectory(front.fastest().time_s * (1.0 + given.buffer / 100.0))
    asked = variations(Conditions(), load_vehicle(given.vehicle), given.vary)
    outcomes = [assess(plan, one, lambda conditions: section_of(given, conditions)) for one in asked]
    table = new_table(f"{section.name}, the plan in a changed world", ("changed",), COLUMNS)
    table.columns[0].no_wrap = True
    for outcome in (one for pair in by_effect(outcomes) for one in pair):
        table.add_row(outcome.variation.label, *(_cell(outcome, *what) for what in COLUMNS.values()))
    print_table(table, LEGEND)
    print(f"plan: {plan.time_s:.1f} s, {kwh(plan.balance.input):.2f} kWh; % of energy refer to this plan")
    for outcome in outcomes:
        if outcome.trouble is not None:
            print(f"{outcome.variation.label}: {outcome.trouble}")


if __name__ == "__main__":
    main()
