"""Figs. 4, 6 and 8: the power and energy of holding a speed, and the energy of every level's runs over the buffer.

Fig. 4 belongs to section 4.2; figs. 6 and 8 show the savings of L3 (sections 4.3 and 4.4).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.lines import Line2D

from das.domain.losses import EfficiencyLoss
from das.domain.units import KM, KMH, KN, KW, PERCENT, kwh
from docs.studies.cases import (
    ACCELERATION,
    CRUISING_MINIMUM_KMH,
    DECELERATION,
    L0_NOREG,
    L1,
    L2,
    L3,
    LEVELS,
    SAVINGS,
    Floats,
    PrintedSaving,
    StudyCase,
    Variant,
    Workbench,
)
from docs.studies.drawing import DASHES, LEVEL_COLOURS, new_figure
from docs.studies.figures_runs import LARGEST_DRAWN_PERCENT, EnergyCurve, energy_curve
from docs.studies.output import Output

LOWEST_KMH, HIGHEST_KMH, STEP_KMH = 10.0, 200.0, 0.5
CROSS_STEP_KMH = 10.0
"""Speed difference (km/h) between the crosses of the L3 map."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Cruising:
    """Powers (W) when holding each speed on level track: resistance and the parts of the losses (eqs. 13, 14)."""

    speed_mps: Floats
    resistance_n: Floats
    resistance_w: Floats
    l1_loss_w: Floats
    l2_dependent_w: Floats
    l2_idle_w: Floats
    l3_loss_w: Floats

    @property
    def l2_loss_w(self) -> Floats:
        return self.l2_dependent_w + self.l2_idle_w

    def total_w(self, level: str) -> Floats:
        """Irreversible power at a level: resistance and losses."""
        losses = {"l0": 0.0 * self.speed_mps, "l1": self.l1_loss_w, "l2": self.l2_loss_w, "l3": self.l3_loss_w}
        return self.resistance_w + losses[level]

    def per_km_j(self, power_w: Floats) -> Floats:
        """Energy (J) for 1 km at a power."""
        return power_w * KM / self.speed_mps

    def cheapest_kmh(self, level: str) -> float | None:
        """Speed with the least energy per km; None if it is the lowest speed."""
        i = int(np.argmin(self.per_km_j(self.total_w(level))))
        return float(self.speed_mps[i] / KMH) if i > 0 else None


def cruising(bench: Workbench) -> Cruising:
    """The powers required to hold each speed with the GTO train."""
    vehicle = bench.vehicle(L3)
    speed = np.arange(LOWEST_KMH, HIGHEST_KMH + 0.5 * STEP_KMH, STEP_KMH) * KMH
    speed = speed[speed <= vehicle.max_speed_mps * (1 + 1e-9)]
    force = vehicle.resistance.force_n(speed)
    l2 = vehicle.loss_model(L2.level)
    if not isinstance(l2, EfficiencyLoss):
        raise TypeError("level L2 is not a constant efficiency with an idle part")
    return Cruising(
        speed_mps=speed,
        resistance_n=force,
        resistance_w=force * speed,
        l1_loss_w=vehicle.loss_model(L1.level).loss_w(force, speed),
        l2_dependent_w=l2.traction_ratio * force * speed,
        l2_idle_w=np.full_like(speed, l2.idle_w),
        l3_loss_w=vehicle.loss_model(L3.level).loss_w(force, speed),
    )


def fig4(bench: Workbench, output: Output) -> None:
    """Draw fig. 4."""
    output.picture("fig4", _draw_cruising(cruising(bench)))


def _draw_cruising(data: Cruising) -> Any:
    figure = new_figure(11, 8)
    (resistance, power), (time, energy) = figure.subplots(2, 2, sharex=True)
    speed = data.speed_mps / KMH
    coarse = slice(0, None, round(CROSS_STEP_KMH / STEP_KMH))
    resistance.plot(speed, data.resistance_n / KN, color="tab:blue")
    resistance.set(title="a  Driving resistance", ylabel="resistance, kN", ylim=(0, None))
    _draw_power(power, data, speed, coarse)
    time.plot(speed, KM / data.speed_mps, color="tab:blue")
    time.set(title="c  Travel time for 1 km", xlabel="speed, km/h", ylabel="time for 1 km, s", ylim=(0, None))
    _draw_energy(energy, data, speed, coarse)
    resistance.set_xlim(0, speed[-1])
    return figure


def _draw_power(axes: Any, data: Cruising, speed: Floats, coarse: slice) -> None:
    axes.plot(speed, data.total_w("l2") / KW, color="tab:red", label="all irreversible, L2")
    axes.plot(speed, data.resistance_w / KW, color="tab:blue", label="resistance")
    axes.plot(speed, data.l2_loss_w / KW, color="black", label="losses, L2")
    axes.plot(speed[coarse], data.l3_loss_w[coarse] / KW, "x", color=LEVEL_COLOURS["l3-gto"], label="losses, L3 map")
    axes.plot(speed, data.l2_dependent_w / KW, color="tab:purple", ls="--", label="power-dependent part, L2")
    axes.plot(speed, data.l2_idle_w / KW, color="tab:brown", ls=":", label="power-independent part, L2")
    axes.set(title="b  Power when holding a speed", ylabel="power, kW", ylim=(0, None))
    axes.legend(loc="upper left")


def _draw_energy(axes: Any, data: Cruising, speed: Floats, coarse: slice) -> None:
    def draw(power_w: Floats, **how: Any) -> None:
        axes.plot(speed, kwh(data.per_km_j(power_w)), **how)

    draw(data.total_w("l2"), color="black", linewidth=2, label="all irreversible, L2")
    axes.plot(
        speed[coarse], kwh(data.per_km_j(data.total_w("l3")))[coarse], "x", color=LEVEL_COLOURS["l3-gto"], label="L3"
    )
    draw(data.total_w("l1"), color=LEVEL_COLOURS["l1"], label="all irreversible, L1")
    draw(data.resistance_w, color="tab:blue", label="resistance (= L0 REG)")
    draw(data.l2_dependent_w, color="tab:purple", ls="--", label="power-dependent losses, L2")
    draw(data.l2_idle_w, color="tab:brown", ls=":", label="power-independent losses, L2")
    draw(data.l3_loss_w - data.l2_loss_w, color=LEVEL_COLOURS["l3-gto"], ls="-.", label="nonlinear part, L3 − L2")
    cheapest = data.cheapest_kmh("l2")
    top = float(kwh(data.per_km_j(data.total_w("l2"))).max())
    if cheapest is not None:
        at = int(np.argmin(data.per_km_j(data.total_w("l2"))))
        least = float(kwh(data.per_km_j(data.total_w("l2")))[at])
        axes.plot([cheapest], [least], "o", color="black", markersize=6)
        axes.annotate(
            f"{cheapest:.1f} km/h\n(paper: about {CRUISING_MINIMUM_KMH:.0f})",
            (cheapest, least),
            xytext=(cheapest, least + 0.22 * top),
            ha="center",
            va="bottom",
            arrowprops={"arrowstyle": "-", "color": "0.4", "shrinkB": 4},
        )
    axes.axhline(0, color="0.6", linewidth=0.8)
    axes.set(title="d  Energy for 1 km", xlabel="speed, km/h", ylabel="energy for 1 km, kWh", ylim=(None, 1.65 * top))
    axes.legend(loc="upper center", ncols=2)


SAVING_TOLERANCE_PERCENT = 1.0
"""Largest deviation (percentage points) from a printed saving that counts as reached; the bars of figs. 6 and 8."""


OTHER_LEVELS = (L0_NOREG, L1, L2)
"""The levels with which L3 is compared. L0 REG is treated separately, as in the paper for braking (section 4.4):
without losses, braking and driving again cost nothing, and its optimum is hardly determined."""


def saving_percent(bench: Workbench, case: StudyCase, variant: Variant, buffer_percent: float) -> float | None:
    """The saving of L3's run over a level's run at a buffer, at L3, in % of the fastest run; None without both runs."""
    ours, other = bench.run(case, L3, buffer_percent), bench.run(case, variant, buffer_percent)
    if ours is None or other is None:
        return None
    return (bench.energy_j(other, L3) - bench.energy_j(ours, L3)) / bench.reference_j(case) / PERCENT


def saving(bench: Workbench, printed: PrintedSaving) -> float:
    """The computed saving (%, mean over the other levels) at the buffer of a printed one, or the largest up to 40 %."""
    case = ACCELERATION if printed.case == ACCELERATION.name else DECELERATION
    largest = LARGEST_DRAWN_PERCENT if printed.up_to else printed.buffer_percent
    means = []
    for buffer in np.arange(printed.buffer_percent, largest + 0.5):
        found = (saving_percent(bench, case, variant, float(buffer)) for variant in OTHER_LEVELS)
        if others := [value for value in found if value is not None]:
            means.append(float(np.mean(others)))
    if not means:
        raise ValueError(f"{case.name}: no level has a run with a buffer of {printed.buffer_percent:g} %")
    return max(means)


LEGEND_ROOM_RATIO = 1.25
"""End of the axis of savings as a multiple of the largest one; it leaves room for the legend above the curves."""


def savings_figure(name: str, case: StudyCase, bench: Workbench, output: Output) -> None:
    """Draw the energy of a case's runs at every level, and the savings of L3 next to the printed ones."""
    curves = {variant: energy_curve(bench, case, variant) for variant in LEVELS}
    output.picture(name, _draw_savings(case, curves))


def _saved_percent(curve: EnergyCurve, l3: EnergyCurve) -> Floats:
    """The saving of L3 over a level for its buffers; NaN beyond L3's largest buffer."""
    return curve.l3_percent - np.interp(curve.buffer_percent, l3.buffer_percent, l3.l3_percent, right=np.nan)


def _draw_savings(case: StudyCase, curves: dict[Variant, EnergyCurve]) -> Any:
    figure = new_figure(9.5, 7.5)
    energy, gain = figure.subplots(2, 1, sharex=True, height_ratios=(1.5, 1))
    for variant, curve in sorted(curves.items(), key=lambda item: item[0].name in DASHES):
        energy.plot(curve.buffer_percent, curve.l3_percent, **_line(variant))
        if variant is not L3:
            gain.plot(curve.buffer_percent, _saved_percent(curve, curves[L3]), **_line(variant))
    energy.set(ylabel="energy at L3, % of the fastest run", title=case.title)
    handles = [Line2D([], [], label=f"optimal for {variant.label}", **_line(variant)) for variant in LEVELS]
    energy.legend(handles=handles, loc="upper right")
    _draw_printed(gain, case)
    gain.set(xlabel="buffer $t_+$, %", ylabel="saved by L3, % of the fastest run", xlim=(0, LARGEST_DRAWN_PERCENT))
    gain.set_ylim(top=LEGEND_ROOM_RATIO * gain.get_ylim()[1])
    for axes in (energy, gain):
        axes.grid(color="0.9")
    return figure


def _line(variant: Variant) -> dict[str, Any]:
    return {
        "color": LEVEL_COLOURS[variant.name],
        "linestyle": DASHES.get(variant.name, "-"),
        "linewidth": 2.6 if variant is L3 else 1.8,
    }


def _draw_printed(axes: Any, case: StudyCase) -> None:
    handles = []
    for up_to, mark, text in (
        (False, "o", "printed, ±1 point"),
        (True, "^", "printed “up to”, from here on, ±1 point"),
    ):
        printed = [one for one in SAVINGS if one.case == case.name and one.up_to is up_to]
        x, y = [item.buffer_percent for item in printed], [item.saving_percent for item in printed]
        how: dict[str, Any] = {"color": "black", "linewidth": 1.2, "capsize": 3, "yerr": SAVING_TOLERANCE_PERCENT}
        handles.append(axes.errorbar(x, y, fmt=mark, label=text, **how))
    axes.legend(handles=handles, loc="upper right")
