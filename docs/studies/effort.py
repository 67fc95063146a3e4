"""How a run uses its forces: reduced effort, and, beyond the paper, peak power at the current collector and jerk.

Reduced acceleration and reduced braking are as in Nold & Corman (2024), sections 4.3 and 4.4. The paper gives no
figures of peak power and comfort (its outlook).

Each interval has one mode, by the wheel force F as a share of the force available at its speed, and by the
acceleration a:

    cruising              |a| <= CRUISE_MPS2
    full effort           |F| >= FULL_RATIO · available
    coasting              |F| <= COAST_RATIO · available
    reduced acceleration  F > 0 between the two, and a > 0
    reduced braking       F < 0 between the two, and a < 0
    other                 force against the change of speed: F > 0 on a climb with a < 0, F < 0 on a descent with a > 0

Only an unbroken stretch of reduced effort counts that is at least LEAST_STRETCH_M long and changes the kinetic energy
by at least LEAST_KINETIC_RATIO of the run's highest: where a run of four modes switches, or where the solver blends two
runs to hit a time, the force is in between for some decision steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from das.domain.losses import LossModel
from das.domain.trajectory import Trajectory
from das.domain.units import KMH, KW
from das.domain.vehicle import Vehicle
from das.solver.tolerances import MAX_STEP_M
from docs.studies.cases import (
    ACCELERATION,
    COMPLETE,
    DECELERATION,
    L0_REG,
    L3,
    LEVELS,
    Floats,
    StudyCase,
    Variant,
    Workbench,
    label,
)
from docs.studies.drawing import DASHES, LEVEL_COLOURS, new_figure
from docs.studies.output import Output, markdown_table
from precompute.baselines import strategies as baselines

FULL_RATIO = 0.97
"""From this share of the available force on, the effort is full."""
COAST_RATIO = 0.03
"""Up to this share of the available force, the train coasts."""
CRUISE_MPS2 = 0.01
"""Up to this acceleration (36 km/h in 1000 s) the train holds its speed."""
LEAST_STRETCH_M = 2.5 * MAX_STEP_M
"""Shorter stretches of reduced effort are the solver's blending between two modes."""
LEAST_KINETIC_RATIO = 0.05
"""Stretches that change the kinetic energy by a smaller share of the run's highest are blending as well."""


class EffortRegime(IntEnum):
    """How the train is driven on an interval."""

    OTHER = 0
    FULL = 1
    COASTING = 2
    CRUISING = 3
    REDUCED_ACCELERATION = 4
    REDUCED_BRAKING = 5


@dataclass(frozen=True, kw_only=True)
class Reduced:
    """Use of reduced effort in a run; zeros (and empty `stretches_m`) if there is none.

    `way_ratio`, `time_ratio`: shares of the whole distance and time. `mean_force_ratio`: mean over this time of the
    force as a share of the available force. `lowest_mps`, `highest_mps`: range of speed. `stretches_m`: begin and end
    of each.
    """

    way_ratio: float = 0.0
    time_ratio: float = 0.0
    mean_force_ratio: float = 0.0
    lowest_mps: float = 0.0
    highest_mps: float = 0.0
    stretches_m: tuple[tuple[float, float], ...] = ()

    @property
    def used(self) -> bool:
        """Whether there is any reduced effort."""
        return bool(self.stretches_m)

    def as_json(self) -> dict[str, Any] | None:
        """What summary.json states about this; None if there is no reduced effort."""
        if not self.used:
            return None
        return {
            "way_ratio": self.way_ratio,
            "time_ratio": self.time_ratio,
            "mean_force_ratio": self.mean_force_ratio,
            "lowest_kmh": self.lowest_mps / KMH,
            "highest_kmh": self.highest_mps / KMH,
            "stretches_m": self.stretches_m,
        }


@dataclass(frozen=True, kw_only=True)
class ReducedEffort:
    """Reduced effort of a run, in acceleration and in braking."""

    acceleration: Reduced
    braking: Reduced

    def as_json(self) -> dict[str, Any]:
        """What summary.json states about this."""
        return {"acceleration": self.acceleration.as_json(), "braking": self.braking.as_json()}


def effort(trajectory: Trajectory, vehicle: Vehicle) -> ReducedEffort:
    """Reduced acceleration and braking of a run of this vehicle (definition: see the module)."""
    ratio = force_ratio(trajectory, vehicle)
    modes = driving_modes(trajectory, vehicle)
    return ReducedEffort(
        acceleration=_reduced(trajectory, ratio, modes == EffortRegime.REDUCED_ACCELERATION),
        braking=_reduced(trajectory, ratio, modes == EffortRegime.REDUCED_BRAKING),
    )


def force_ratio(trajectory: Trajectory, vehicle: Vehicle) -> Floats:
    """Wheel force of each interval as a share of the available one: 1 = full traction, −1 = full brake.

    The available force is the traction envelope or, for braking, the electric brake's envelope (the friction brake's if
    there is no electric one), at the interval's higher speed, cut to the vehicle's largest acceleration and
    deceleration.
    """
    faster = np.maximum(trajectory.v_mps[:-1], trajectory.v_mps[1:])
    resistance = vehicle.resistance.force_n(faster) + trajectory.grade_and_curve_n
    traction = np.minimum(
        vehicle.traction.force_n(faster), vehicle.inertial_mass_kg * vehicle.max_acceleration_mps2 + resistance
    )
    brake = vehicle.electric_brake.force_n(faster)
    brake = np.where(brake > 0, brake, vehicle.friction_brake_force_n)
    brake = np.minimum(brake, vehicle.inertial_mass_kg * vehicle.max_deceleration_mps2 - resistance)
    force = trajectory.force_el_n + trajectory.force_friction_n
    available = np.where(force >= 0, traction, brake)
    return np.asarray(force / np.maximum(available, 1.0), dtype=float)


def driving_modes(trajectory: Trajectory, vehicle: Vehicle) -> NDArray[np.int64]:
    """The `EffortRegime` of each interval."""
    ratio = force_ratio(trajectory, vehicle)
    change = np.diff(trajectory.v_mps) / trajectory.interval_s()
    modes = np.full(len(ratio), int(EffortRegime.OTHER))
    modes[(ratio > 0) & (change > 0)] = EffortRegime.REDUCED_ACCELERATION
    modes[(ratio < 0) & (change < 0)] = EffortRegime.REDUCED_BRAKING
    modes[np.abs(ratio) >= FULL_RATIO] = EffortRegime.FULL
    modes[np.abs(ratio) <= COAST_RATIO] = EffortRegime.COASTING
    modes[(np.abs(change) <= CRUISE_MPS2) & (np.abs(ratio) < FULL_RATIO)] = EffortRegime.CRUISING
    return modes


def _reduced(trajectory: Trajectory, ratio: Floats, reduced: NDArray[np.bool_]) -> Reduced:
    stretches = [(a, b) for a, b in _stretches(reduced) if _counts(trajectory, a, b)]
    if not stretches:
        return Reduced()
    kept = np.concatenate([np.arange(a, b) for a, b in stretches])
    interval_s = trajectory.interval_s()[kept]
    way_m = float(np.diff(trajectory.s_m)[kept].sum())
    speeds = np.concatenate((trajectory.v_mps[kept], trajectory.v_mps[kept + 1]))
    return Reduced(
        way_ratio=way_m / float(trajectory.s_m[-1] - trajectory.s_m[0]),
        time_ratio=float(interval_s.sum()) / trajectory.time_s,
        mean_force_ratio=float(np.abs(ratio[kept]) @ interval_s / interval_s.sum()),
        lowest_mps=float(speeds.min()),
        highest_mps=float(speeds.max()),
        stretches_m=tuple((float(trajectory.s_m[a]), float(trajectory.s_m[b])) for a, b in stretches),
    )


def _counts(trajectory: Trajectory, a: int, b: int) -> bool:
    """Whether the stretch from node a to node b is long enough and changes the speed enough to count."""
    v2 = trajectory.v_mps**2
    long_enough = trajectory.s_m[b] - trajectory.s_m[a] >= LEAST_STRETCH_M
    return bool(long_enough and abs(v2[b] - v2[a]) >= LEAST_KINETIC_RATIO * v2.max())


def _stretches(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and one-past-last index of each unbroken run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


BUFFERS_PERCENT = (0.0, 2.0, 5.0, 7.0, 10.0, 15.0, 25.0)
STATED_BUFFER_PERCENT = 7.0
"""The buffer of the table and of the stated reductions."""
BUILD_UP_S = 1.0
"""A change of force is taken to build up linearly over this time; planned forces change at once (assumption)."""
SAMPLE_S = 0.05
"""Step of the time grid on which power and acceleration are sampled."""
SUSTAINED_S = 10.0
"""Besides the peak, the highest mean power over this time is reported."""


HEADINGS: Final = {
    "peak_kw": "drawn: peak kW",
    "peak_10s_kw": "over 10 s",
    "peak_returned_kw": "returned: peak kW",
    "peak_10s_returned_kw": "over 10 s",
    "rms_acceleration_mps2": "acceleration RMS m/s²",
    "rms_jerk_mps3": "jerk RMS m/s³",
    "peak_jerk_mps3": "largest jerk m/s³",
}
"""The figures of a run, and their headings in the table."""
Figures = dict[str, float]
"""Peak power and comfort of a run, by the keys of `HEADINGS`.

Powers: the highest drawn from and returned to the line, and the highest means over 10 s; 0 if there are none.
Acceleration and jerk: over the time of the trip, with forces that build up over 1 s; the train starts and ends at its
first and last acceleration.
"""


def figures(run: Trajectory, loss: LossModel) -> Figures:
    """Peak power with the losses of a model, and comfort, of a run."""
    power = collector_power_w(run, loss)
    time_s, jerk = jerk_mps3(run)
    change = np.diff(run.v_mps) / run.interval_s()
    values = (
        float(power.max()) / KW,
        max(_sustained_w(run, power), 0.0) / KW,
        float(max(-power.min(), 0.0)) / KW,
        max(_sustained_w(run, -power), 0.0) / KW,
        float(np.sqrt(change**2 @ run.interval_s() / run.time_s)),
        float(np.sqrt((jerk**2).sum() * SAMPLE_S / time_s)),
        float(np.abs(jerk).max()),
    )
    return dict(zip(HEADINGS, values, strict=True))


def collector_power_w(run: Trajectory, loss: LossModel) -> Floats:
    """Mean power at the current collector in each interval: F·v + P_L(F, v), without comfort systems."""
    speed = run.mean_speed_mps()
    return np.asarray(run.force_el_n * speed + loss.loss_w(run.force_el_n, speed), dtype=float)


def jerk_mps3(run: Trajectory) -> tuple[float, Floats]:
    """Duration (s) and jerk sampled every SAMPLE_S: the planned acceleration averaged over BUILD_UP_S, differentiated.

    An acceleration step Δa becomes a jerk of Δa / BUILD_UP_S for that time. Before the start and after the end the
    acceleration is taken as that of the first and last interval; the jolts of starting and of stopping, which every
    run has alike, are left out.
    """
    half = 0.5 * BUILD_UP_S
    time = np.arange(0.0, run.time_s + 0.5 * SAMPLE_S, SAMPLE_S)
    first = (run.v_mps[1] - run.v_mps[0]) / (run.t_s[1] - run.t_s[0])
    last = (run.v_mps[-1] - run.v_mps[-2]) / (run.t_s[-1] - run.t_s[-2])
    t = np.concatenate(([-BUILD_UP_S], run.t_s, [run.time_s + BUILD_UP_S]))
    v = np.concatenate(([run.v_mps[0] - first * BUILD_UP_S], run.v_mps, [run.v_mps[-1] + last * BUILD_UP_S]))
    edges = np.append(time - 0.5 * SAMPLE_S, time[-1] + 0.5 * SAMPLE_S)
    smooth = (np.interp(edges + half, t, v) - np.interp(edges - half, t, v)) / BUILD_UP_S
    return run.time_s, np.asarray(np.diff(smooth) / SAMPLE_S, dtype=float)


def _sustained_w(run: Trajectory, power_w: Floats) -> float:
    """Highest mean power over SUSTAINED_S."""
    energy = np.concatenate(([0.0], np.cumsum(power_w * run.interval_s())))
    starts = np.arange(0.0, max(run.time_s - SUSTAINED_S, 0.0) + SAMPLE_S, SAMPLE_S)
    length_s = min(SUSTAINED_S, run.time_s)
    return float(
        ((np.interp(starts + length_s, run.t_s, energy) - np.interp(starts, run.t_s, energy)) / length_s).max()
    )


def beyond(bench: Workbench, output: Output) -> dict[str, Any]:
    """Write peak power and comfort per level, case and buffer, all with the brakes and losses of L3."""
    rows: list[tuple[object, ...]] = []
    stated: dict[str, dict[str, Figures]] = {}
    for case in (ACCELERATION, DECELERATION, COMPLETE):
        for buffer in BUFFERS_PERCENT:
            for name, run in _runs(bench, case, buffer).items():
                found = figures(run.braked_as(bench.vehicle(L3), L3.level), bench.loss_map(L3))
                rows.append((case.name, name, buffer, *found.values()))
                if buffer == STATED_BUFFER_PERCENT:
                    stated.setdefault(case.name, {})[name] = found
    output.csv("beyond.csv", ["case", "trajectory", "buffer_percent", *HEADINGS], rows)
    output.page("beyond.md", _markdown(stated))
    output.picture("beyond", _draw(rows))
    return {
        "buffer_percent": STATED_BUFFER_PERCENT,
        "force_build_up_s": BUILD_UP_S,
        "figures": stated,
        "l3_reduces_ratio": {case: _reductions(by_name) for case, by_name in stated.items()},
    }


def _runs(bench: Workbench, case: StudyCase, buffer_percent: float) -> dict[str, Trajectory]:
    """The runs of each level and of reduced maximum speed, if there is one with this buffer."""
    found = {variant.name: bench.run(case, variant, buffer_percent) for variant in LEVELS}
    if case is COMPLETE and buffer_percent > 0:
        section = bench.section(case, L3)
        found["rms"] = baselines.reduced_maximum_speed(section, bench.time_s(case, buffer_percent)).trajectory
    return {name: run for name, run in found.items() if run is not None}


def _reductions(by_name: dict[str, Figures]) -> dict[str, dict[str, float]]:
    """By how much L3 is below each of the other trajectories, figure by figure (negative: above)."""
    ours = by_name[L3.name]
    return {
        name: {key: 1 - ours[key] / value if value > 0 else 0.0 for key, value in found.items()}
        for name, found in by_name.items()
        if name != L3.name
    }


def _markdown(stated: dict[str, dict[str, Figures]]) -> str:
    parts = []
    for case, by_name in stated.items():
        rows = []
        for name, found in by_name.items():
            cells = [f"{value:.0f}" if key.endswith("_kw") else f"{value:.3f}" for key, value in found.items()]
            rows.append([label(name), *cells])
        parts.append(
            f"{case}, t+ = {STATED_BUFFER_PERCENT:g} %\n\n" + markdown_table(("trajectory", *HEADINGS.values()), rows)
        )
    return "\n".join(parts)


def _draw(rows: list[tuple[object, ...]]) -> Any:
    figure = new_figure(12, 7.5)
    panels = figure.subplots(2, 3, sharex=True)
    power = {
        ACCELERATION: ("peak_10s_kw", "highest power drawn over 10 s, kW"),
        DECELERATION: ("peak_10s_returned_kw", "highest power returned over 10 s, kW"),
        COMPLETE: ("peak_10s_kw", "highest power drawn over 10 s, kW"),
    }
    for column, (case, (key, text)) in enumerate(power.items()):
        above, below = panels[:, column]
        _draw_lines(above, [row for row in rows if row[0] == case.name], key)
        _draw_lines(below, [row for row in rows if row[0] == case.name], "rms_jerk_mps3")
        above.set(title=case.title, ylabel=text)
        below.set(xlabel="buffer $t_+$, %", ylabel="jerk RMS, m/s³")
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=len(LEVELS))
    return figure


def _draw_lines(axes: Any, rows: list[tuple[object, ...]], key: str) -> None:
    for variant in LEVELS:
        points = [(row[2], row[3 + list(HEADINGS).index(key)]) for row in rows if row[1] == variant.name]
        x, y = np.array(points, dtype=float).T
        axes.plot(x, y, label=variant.label, **_line(variant))
    axes.set_ylim(0, 1.05 * axes.get_ylim()[1])
    axes.grid(color="0.9")


def _line(variant: Variant) -> dict[str, Any]:
    """The style of a level's line: L0 REG's is broad and below, dashes are on top, so that all can be seen."""
    name = variant.name
    return {
        "color": LEVEL_COLOURS[name],
        "linestyle": DASHES.get(name, "-"),
        "linewidth": 4.0 if variant is L0_REG else 1.8,
        "marker": "o",
        "markersize": 6 if variant is L0_REG else 4,
        "zorder": 3 if name in DASHES else 2,
    }
