"""Fig. 4: what holding a speed costs, over the speed (section 4.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from das.domain.losses import EfficiencyLoss
from das.domain.units import KM, KMH, KN, KW, kwh
from precompute.study.cases import L1, L2, L3
from precompute.study.drawing import LEVEL_COLOURS, new_figure
from precompute.study.output import Output
from precompute.study.printed import CRUISING_DEVIATION_RATIO, CRUISING_MINIMUM_KMH
from precompute.study.runs import Workbench

Floats = NDArray[np.float64]

LOWEST_KMH, HIGHEST_KMH, STEP_KMH = 10.0, 200.0, 0.5
COMPARED_KMH = (40.0, 160.0)
"""Speeds over which the mean deviation of the L3 losses from their L2 fit is taken."""
CROSS_STEP_KMH = 10.0
"""Crosses of the L3 map are this far apart."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Cruising:
    """Powers (W) when holding each speed on the level: resistance and the parts of the losses (eqs. 13, 14)."""

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
        """All of the irreversible power at a level."""
        losses = {"l0": 0.0 * self.speed_mps, "l1": self.l1_loss_w, "l2": self.l2_loss_w, "l3": self.l3_loss_w}
        return self.resistance_w + losses[level]

    def per_km_j(self, power_w: Floats) -> Floats:
        """Energy (J) for 1 km at a power."""
        return power_w * KM / self.speed_mps

    def cheapest_kmh(self, level: str) -> float | None:
        """Speed of the least energy per km; None where slower is always cheaper (the lowest speed looked at)."""
        i = int(np.argmin(self.per_km_j(self.total_w(level))))
        return float(self.speed_mps[i] / KMH) if i > 0 else None


def cruising(bench: Workbench) -> Cruising:
    """The powers of holding a speed with the GTO train."""
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


def fig4(bench: Workbench, output: Output) -> dict[str, Any]:
    """Draw fig. 4, write its curves, and say where energy per km is least."""
    data = cruising(bench)
    output.csv("fig4.csv", *_rows(data))
    output.picture("fig4", _draw(data))
    difference = data.l3_loss_w / data.l2_loss_w - 1
    here = (data.speed_mps >= COMPARED_KMH[0] * KMH - 1e-9) & (data.speed_mps <= COMPARED_KMH[1] * KMH + 1e-9)
    return {
        "cheapest_speed_kmh": {level: data.cheapest_kmh(level) for level in ("l0", "l1", "l2", "l3")},
        "printed_cheapest_speed_l2_kmh": CRUISING_MINIMUM_KMH,
        "l3_from_l2_mean_ratio": float(difference[here].mean()),
        "l3_from_l2_mean_absolute_ratio": float(np.abs(difference[here]).mean()),
        "l3_from_l2_power_mean_absolute_ratio": float(np.abs(data.total_w("l3") / data.total_w("l2") - 1)[here].mean()),
        "printed_l3_from_l2_mean_ratio": CRUISING_DEVIATION_RATIO,
    }


def _rows(data: Cruising) -> tuple[list[str], Any]:
    columns = {
        "speed_kmh": data.speed_mps / KMH,
        "resistance_kn": data.resistance_n / KN,
        "resistance_kw": data.resistance_w / KW,
        "l1_loss_kw": data.l1_loss_w / KW,
        "l2_dependent_loss_kw": data.l2_dependent_w / KW,
        "l2_idle_loss_kw": data.l2_idle_w / KW,
        "l3_loss_kw": data.l3_loss_w / KW,
        "time_s_per_km": KM / data.speed_mps,
    }
    for level in ("l0", "l1", "l2", "l3"):
        columns[f"{level}_kwh_per_km"] = kwh(data.per_km_j(data.total_w(level)))
    return list(columns), zip(*columns.values(), strict=True)


def _draw(data: Cruising) -> Any:
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
