"""The pictures of a report: dark on white, with units, for people with any colour vision."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from das.advice.regimes import Regime, mode_name
from das.bus import topics
from das.domain.units import KM, KMH, KN, kmh, kwh
from sim.drive.attribution.causes import OVER_MPS
from sim.drive.drive import Drive
from sim.drive.events.event import bookmarks
from sim.review.colors import EFFICIENCY_GREYS, LIGHT, MODES, Meaning
from sim.review.light import INK, legend, light_figure, named, stops
from sim.review.report.sentences import told_causes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DRIVEN, ADVISED, OPTIMUM, LIMIT, LOST = (
    LIGHT.of[meaning] for meaning in (Meaning.DRIVEN, Meaning.ADVISED, Meaning.OPTIMUM, Meaning.LIMIT, Meaning.LOST)
)
EFFICIENCIES: Final = (0.5, 0.6, 0.7, 0.75, 0.8, 0.85, 0.9)
"""Levels of the efficiency map."""
GRID_POINTS: Final = 90
LEAST_LATE_S: Final = 5.0
"""The axis of punctuality reaches at least this far (s), so that fractions of a second do not look large."""
BAR_IN: Final = 0.28
MODES_IN: Final = 0.22
MOST_APART_KMH: Final = 15.0
"""Driven less shown is drawn up to this much (km/h): more lies at the edge of its axis."""
FAINT: Final = 0.45
"""Share of its colour that a departure has beside an arrival."""


def drive_figure(drive: Drive) -> Figure:
    """The drive over distance, on one axis: speed, what the display advised to do, lateness, and driven less shown."""
    with_modes = bool(drive.shown.mode[drive.shown.shown].any())
    late, apart = _lateness(drive), drive.shown.comparable.any()
    heights = [3.2, *([MODES_IN] if with_modes else []), *([1.0] if len(late[0]) else []), *([1.1] if apart else [])]
    figure, axes = light_figure(heights)
    _speeds(axes[0], drive)
    rest = iter(axes[1:])
    if with_modes:
        _modes(next(rest), drive)
    if len(late[0]):
        axis = next(rest)
        axis.step(*late, where="post", color=LIGHT.of[Meaning.OPERATOR], linewidth=1.2)
        axis.axhline(0.0, color=INK, linewidth=0.7)
        named(axis, y="Late (s)")
    if apart:
        _compliance(next(rest), drive)
    for axis in axes:
        stops(axis, _stops(drive), written=axis is axes[0])
    named(axes[-1], x="Position (km)")
    return figure


def _speeds(axis: Any, drive: Drive) -> None:
    """Limit in force, what was advised, the optimum for the same times, what was driven, and the bookmarks."""
    trip = drive.course
    at, limit_mps = trip.time_ns, drive.limit_mps
    shown = drive.shown
    if len(shown.time_ns):
        given = (shown.shown if shown.any_shown else True) & (shown.speed_mps > 0)
        advised = np.where(given, kmh(shown.speed_mps), np.nan)
        said = "speed advised" if shown.any_shown else "speed advised, but not shown to the driver"
        axis.plot(trip.at(shown.time_ns, trip.s_m) / KM, advised, color=ADVISED, linewidth=2.4, alpha=0.7, label=said)
    known = np.isfinite(limit_mps)
    if known.any():
        axis.step(
            trip.at(at, trip.s_m) / KM,
            kmh(limit_mps),
            where="post",
            color=LIMIT,
            linewidth=1.0,
            label="limit",
            zorder=2.5,
        )
    for number, leg in enumerate(drive.attribution.legs if drive.attribution else ()):
        run = leg.optimum.trajectory
        label = "optimum for the same times" if number == 0 else None
        axis.plot(run.s_m / KM, kmh(run.v_mps), color=OPTIMUM, linewidth=1.1, linestyle="--", label=label)
    axis.plot(trip.s_m / KM, kmh(trip.speed_mps), color=DRIVEN, linewidth=1.2, label="driven")
    top = kmh(max(float(limit_mps[known].max(initial=0.0)), float(trip.speed_mps.max())))
    axis.set_ylim(0.0, 1.18 * top)
    marked = bookmarks(drive.events)
    for number, one in enumerate(marked, start=1):
        axis.text(
            one.s_m / KM, (1.13, 1.07)[number % 2] * top, str(number), ha="center", va="center", fontsize=6.5,
            color=LIGHT.background, bbox={"boxstyle": "round,pad=0.15", "facecolor": INK, "edgecolor": "none"},
        )  # fmt: skip
    named(axis, y="Speed (km/h)")
    legend(axis)


def _modes(axis: Any, drive: Drive) -> None:
    """What the display advised to do, as coloured stretches."""
    shown, trip = drive.shown, drive.course
    at_km = trip.at(shown.time_ns, trip.s_m) / KM
    names = [mode_name(Regime(number)) if number in set(Regime) else "" for number in shown.mode.tolist()]
    used: dict[str, str] = {}
    begins = [0, *(np.flatnonzero(np.diff(shown.mode * shown.shown)) + 1).tolist()]
    for first, after in pairwise([*begins, len(names) - 1]):
        color = MODES.get(names[first]) if shown.shown[first] else None
        if color is not None and at_km[after] > at_km[first]:
            axis.broken_barh([(at_km[first], at_km[after] - at_km[first])], (0.0, 1.0), facecolor=color, lw=0.0)
            used.setdefault(names[first], color)
    axis.set_ylim(0.0, 1.0)
    axis.set_yticks([0.5], ["advised\nto do"])
    axis.grid(visible=False)
    legend(axis, used)


def _lateness(drive: Drive) -> tuple[Any, Any]:
    """Places (km) and how late the operator said that the train was (s)."""
    told, trip = drive.recording.columns(topics.DELAY, "time_ns", "delay_s"), drive.course
    within = (told["time_ns"] >= trip.time_ns[0]) & (told["time_ns"] <= trip.time_ns[-1])
    return trip.at(told["time_ns"][within], trip.s_m) / KM, told["delay_s"][within]


def _compliance(axis: Any, drive: Drive) -> None:
    """Driven speed less the speed to keep that was shown, over distance."""
    shown, trip = drive.shown, drive.course
    apart = kmh(trip.at(shown.time_ns, trip.speed_mps) - shown.speed_mps)
    apart = np.where(shown.comparable, np.clip(apart, -MOST_APART_KMH, MOST_APART_KMH), np.nan)
    over = OVER_MPS / KMH
    axis.axhspan(-over, over, color=LIGHT.grid, alpha=0.6, linewidth=0.0)
    axis.plot(trip.at(shown.time_ns, trip.s_m) / KM, apart, color=DRIVEN, linewidth=1.0)
    reach = 1.1 * max(float(np.nanmax(np.abs(apart))), 2.0 * over)
    axis.set_ylim(-reach, reach)
    named(axis, y="Driven less\nshown (km/h)")


def cause_figure(drive: Drive) -> Figure:
    """The energy above the optimum by cause, as bars."""
    assert drive.attribution is not None
    parts = told_causes(drive.attribution)[::-1]
    figure, (axis,) = light_figure((max(BAR_IN * len(parts), 0.8),))
    values = np.array([kwh(energy_j) for _, energy_j in parts])
    axis.barh([cause.label for cause, _ in parts], values, color=LOST, height=0.7)
    reach = max(float(np.abs(values).max(initial=0.0)), 0.1)
    for row, value in enumerate(values):
        axis.text(max(value, 0.0) + 0.01 * reach, row, f"{value:+.1f}", va="center", color=INK, fontsize=8.0)
    axis.set_xlim(min(1.15 * float(values.min(initial=0.0)), 0.0), 1.12 * reach)
    axis.grid(visible=False, axis="y")
    named(axis, x="Energy above the optimum for the same times (kWh)")
    return figure


def place_figure(drive: Drive) -> Figure:
    """The energy above the optimum by place: per 100 m, and summed from the start."""
    assert drive.attribution is not None
    figure, (bars, total) = light_figure((1.5, 1.4))
    before_j = 0.0
    for leg in drive.attribution.legs:
        places = leg.even
        per_km = kwh(places.lost_more_j) / ((places.end_m - places.start_m) / KM)
        middle = 0.5 * (places.start_m + places.end_m) / KM
        wide = (places.end_m - places.start_m) / KM
        bars.bar(middle, per_km, width=wide, color=LOST, linewidth=0.0)
        upto = before_j + np.concatenate(([0.0], np.cumsum(places.lost_more_j)))
        total.plot(np.concatenate((places.start_m, places.end_m[-1:])) / KM, kwh(upto), color=INK, linewidth=1.2)
        before_j = float(upto[-1])
    bars.axhline(0.0, color=INK, linewidth=0.7)
    for axis in (bars, total):
        stops(axis, _stops(drive), written=axis is bars)
    named(bars, y="Lost above the\noptimum (kWh/km)")
    named(total, x="Position (km)", y="Sum from the\nstart (kWh)")
    return figure


def efficiency_figure(drive: Drive) -> Figure:
    """Wheel force of the motors over speed, on the efficiency of the train's traction chain."""
    assert drive.attribution is not None
    leg = drive.attribution.legs[0]
    section, vehicle = leg.optimum.section, drive.attribution.inputs.vehicle
    figure, (axis,) = light_figure((3.4,))
    top_mps = min(
        vehicle.max_speed_mps, 1.1 * max(float(one.leg.motion.speed_mps.max()) for one in drive.attribution.legs)
    )
    speeds = np.linspace(0.5, top_mps, GRID_POINTS)
    pulls, brakes = vehicle.traction_effort_n(speeds), -vehicle.electric_brake_effort_n(speeds)
    shares = np.linspace(0.02, 1.0, GRID_POINTS // 2)
    for envelope in (pulls, brakes):
        force_n, speed_mps = shares[:, None] * envelope[None, :], np.broadcast_to(speeds, (len(shares), len(speeds)))
        if np.abs(envelope).max() > 0:
            _shade(axis, section, force_n, speed_mps)
        axis.plot(kmh(speeds), envelope / KN, color=INK, linewidth=1.0)
    for number, one in enumerate(drive.attribution.legs):
        for run, color, label in (
            (one.optimum.trajectory, OPTIMUM, "optimum for the same times"),
            (one.energies.trajectory, DRIVEN, "driven"),
        ):
            axis.plot(
                kmh(run.mean_speed_mps()), run.force_el_n / KN, ".", color=color, markersize=3.0, alpha=0.7,
                label=label if number == 0 else None, rasterized=True,
            )  # fmt: skip
    axis.axhline(0.0, color=INK, linewidth=0.7)
    axis.set_ylim(1.08 * float(brakes.min()) / KN, 1.08 * float(pulls.max()) / KN)
    named(axis, x="Speed (km/h)", y="Force of the motors at the wheels (kN)")
    legend(axis)
    for handle in axis.get_legend().legend_handles:
        handle.set_markersize(8.0)
    return figure


def _shade(axis: Any, section: Any, force_n: Any, speed_mps: Any) -> None:
    """Shade the efficiency of the chain: what reaches the wheels when pulling, or the collector when braking."""
    mechanical_w = np.abs(force_n) * speed_mps
    loss_w = section.loss.loss_w(force_n, np.ascontiguousarray(speed_mps))
    pulling = force_n[0, 0] > 0
    efficiency = mechanical_w / (mechanical_w + loss_w) if pulling else (mechanical_w - loss_w) / mechanical_w
    filled = axis.contourf(
        kmh(speed_mps),
        force_n / KN,
        np.clip(efficiency, 0.0, 1.0),
        levels=(0.0, *EFFICIENCIES, 1.0),
        colors=EFFICIENCY_GREYS,
    )
    if pulling:
        bar = axis.figure.colorbar(filled, ax=axis, pad=0.01, fraction=0.04)
        bar.set_label("Efficiency", color=INK, fontsize=8.5)
        bar.ax.tick_params(labelsize=8.0)


def punctuality_figure(drive: Drive) -> Figure:
    """How late the train arrived at and left each stop."""
    made = [call for call in drive.calls if call.reached]
    figure, (axis,) = light_figure((1.6,))
    rows = np.arange(len(made))
    arrived, left = (
        np.array([getattr(call, name) for call in made], dtype=float) for name in ("arrived_late_s", "departed_late_s")
    )
    both = np.isfinite(arrived) & np.isfinite(left)
    for side, name, late, share in ((-1, "arrival", arrived, 1.0), (1, "departure", left, FAINT)):
        shifts = np.where(both, 0.18 * side, 0.0)
        axis.bar(rows + shifts, late, width=0.34, color=DRIVEN, alpha=share, label=name)
        for row, (shift, value) in enumerate(zip(shifts, late, strict=True)):
            if np.isfinite(value):
                axis.text(
                    row + shift, value, f"{value:+.0f}", ha="center", va="bottom" if value >= 0 else "top",
                    color=INK, fontsize=8.0,
                )  # fmt: skip
    axis.axhline(0.0, color=INK, linewidth=0.8)
    axis.set_xticks(rows, [call.name for call in made])
    axis.grid(visible=False, axis="x")
    low, high = axis.get_ylim()
    axis.set_ylim(min(1.25 * low, -LEAST_LATE_S), max(1.25 * high, LEAST_LATE_S))
    named(axis, y="Late (s)")
    legend(axis)
    return figure


def _stops(drive: Drive) -> list[tuple[str, float]]:
    return [(call.name, call.s_m) for call in drive.calls if call.reached]
