"""Beyond the paper: peak power at the current collector and jerk, per level; it only argues them (its outlook)."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from das.domain.losses import LossModel
from das.domain.trajectory import Trajectory
from das.domain.units import KW
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
)
from docs.studies.drawing import DASHES, LEVEL_COLOURS, new_figure
from docs.studies.output import Output, markdown_table
from docs.studies.table2 import label
from precompute.baselines import strategies as baselines

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

Powers: the highest from, and into, the line, and the highest means over 10 s, 0 where there is none. Acceleration and
jerk: over the trip's time, forces building up over 1 s, the train starting and ending at its first and last
acceleration.
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
    output.text("beyond.md", _markdown(stated))
    output.picture("beyond", _draw(rows))
    return {
        "buffer_percent": STATED_BUFFER_PERCENT,
        "force_build_up_s": BUILD_UP_S,
        "figures": stated,
        "l3_reduces_ratio": {case: _reductions(by_name) for case, by_name in stated.items()},
    }


def _runs(bench: Workbench, case: StudyCase, buffer_percent: float) -> dict[str, Trajectory]:
    """Each level's run and the reduced maximum speed, where there is one with this buffer."""
    found = {variant.name: bench.run(case, variant, buffer_percent) for variant in LEVELS}
    if case is COMPLETE and buffer_percent > 0:
        section = bench.section(case, L3)
        found["rms"] = baselines.reduced_maximum_speed(section, bench.time_s(case, buffer_percent)).trajectory
    return {name: run for name, run in found.items() if run is not None}


def _reductions(by_name: dict[str, Figures]) -> dict[str, dict[str, float]]:
    """By how much L3 is below each other trajectory, figure by figure (negative: above)."""
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
    """Lines such that each shows where several lie on each other: L0 REG's broad and below, dashes on top."""
    name = variant.name
    return {
        "color": LEVEL_COLOURS[name],
        "linestyle": DASHES.get(name, "-"),
        "linewidth": 4.0 if variant is L0_REG else 1.8,
        "marker": "o",
        "markersize": 6 if variant is L0_REG else 4,
        "zorder": 3 if name in DASHES else 2,
    }
