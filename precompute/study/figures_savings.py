"""Figs. 6 and 8: energy at L3 of every level's runs over the buffer, and what L3 saves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from das.domain.units import PERCENT
from precompute.study.cases import ACCELERATION, DECELERATION, L0_NOREG, L1, L2, L3, LEVELS, StudyCase, Variant
from precompute.study.drawing import DASHES, LEVEL_COLOURS, new_figure
from precompute.study.figures_levels import LARGEST_DRAWN_PERCENT, EnergyCurve, energy_curve
from precompute.study.output import Output
from precompute.study.printed import SAVINGS, PrintedSaving
from precompute.study.runs import Workbench

Floats = NDArray[np.float64]

SAVING_TOLERANCE_PERCENT = 1.0
"""How near to the printed savings ours are asked to come (percentage points)."""


@dataclass(frozen=True, kw_only=True)
class Saving:
    """A printed saving and ours: the mean over the levels in `others`, found at the buffer `at_percent`."""

    printed: PrintedSaving
    ours_percent: float
    at_percent: float
    others: dict[str, float]

    @property
    def reached(self) -> bool:
        return abs(self.ours_percent - self.printed.saving_percent) <= SAVING_TOLERANCE_PERCENT


OTHER_LEVELS = (L0_NOREG, L1, L2)
"""The levels L3 is compared with. L0 REG is set apart, as the paper does when braking (section 4.4): without losses,
braking and driving again cost nothing, so that its optimum is hardly determined."""


def saving_percent(bench: Workbench, case: StudyCase, variant: Variant, buffer_percent: float) -> float | None:
    """What L3's run saves against a level's at a buffer, at L3, in % of the fastest run; None without such runs."""
    ours, other = bench.run(case, L3, buffer_percent), bench.run(case, variant, buffer_percent)
    if ours is None or other is None:
        return None
    return (bench.energy_j(other, L3) - bench.energy_j(ours, L3)) / bench.reference_j(case) / PERCENT


def saving(bench: Workbench, printed: PrintedSaving) -> Saving:
    """Our saving where the paper prints one: at its buffer, or the largest from there to 40 %."""
    case = ACCELERATION if printed.case == ACCELERATION.name else DECELERATION
    largest = LARGEST_DRAWN_PERCENT if printed.up_to else printed.buffer_percent
    buffers = np.arange(printed.buffer_percent, largest + 0.5)
    best: Saving | None = None
    for buffer in buffers:
        found = {v.name: saving_percent(bench, case, v, float(buffer)) for v in OTHER_LEVELS}
        others = {name: value for name, value in found.items() if value is not None}
        if not others:
            continue
        mean = float(np.mean(list(others.values())))
        if best is None or mean > best.ours_percent:
            best = Saving(printed=printed, ours_percent=mean, at_percent=float(buffer), others=others)
    if best is None:
        raise ValueError(f"{case.name}: no level has a run with a buffer of {printed.buffer_percent:g} %")
    return best


def savings(bench: Workbench, case: StudyCase) -> list[Saving]:
    """All savings printed for a case, with ours."""
    return [saving(bench, printed) for printed in SAVINGS if printed.case == case.name]


def fig6(bench: Workbench, output: Output) -> dict[str, Any]:
    """Acceleration (section 4.3)."""
    return _figure("fig6", bench, output, ACCELERATION)


def fig8(bench: Workbench, output: Output) -> dict[str, Any]:
    """Deceleration (section 4.4)."""
    return _figure("fig8", bench, output, DECELERATION)


LEGEND_ROOM_RATIO = 1.25
"""The axis of the savings goes this far beyond the largest, so that the legend lies on no curve."""


def _figure(name: str, bench: Workbench, output: Output, case: StudyCase) -> dict[str, Any]:
    curves = {variant: energy_curve(bench, case, variant) for variant in LEVELS}
    saved = {variant: _saved_percent(curve, curves[L3]) for variant, curve in curves.items()}
    found = savings(bench, case)
    rows = [
        (variant.name, *row)
        for variant, curve in curves.items()
        for row in zip(curve.buffer_percent, curve.l3_percent, _or_none(saved[variant]), strict=True)
    ]
    output.csv(f"{name}.csv", ["level", "buffer_percent", "energy_l3_percent", "l3_saves_percent"], rows)
    output.picture(name, _draw(case, curves, saved, found))
    return {"savings": [saving_json(item) for item in found]}


def _saved_percent(curve: EnergyCurve, l3: EnergyCurve) -> Floats:
    """What L3 saves against a level over its buffers; NaN beyond L3's largest."""
    return curve.l3_percent - np.interp(curve.buffer_percent, l3.buffer_percent, l3.l3_percent, right=np.nan)


def _draw(
    case: StudyCase, curves: dict[Variant, EnergyCurve], saved: dict[Variant, Floats], found: list[Saving]
) -> Any:
    figure = new_figure(9.5, 7.5)
    energy, gain = figure.subplots(2, 1, sharex=True, height_ratios=(1.5, 1))
    for variant, curve in sorted(curves.items(), key=lambda item: item[0].name in DASHES):
        energy.plot(curve.buffer_percent, curve.l3_percent, **_line(variant))
        if variant is not L3:
            gain.plot(curve.buffer_percent, saved[variant], **_line(variant))
    energy.set(ylabel="energy at L3, % of the fastest run", title=case.title)
    energy.legend(handles=_handles(), loc="upper right")
    _draw_printed(gain, found)
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


def _handles() -> list[Any]:
    from matplotlib.lines import Line2D

    return [Line2D([], [], label=f"optimal for {variant.label}", **_line(variant)) for variant in LEVELS]


def saving_json(item: Saving) -> dict[str, Any]:
    """A saving as the summary holds it."""
    return {
        "place": item.printed.place,
        "buffer_percent": item.printed.buffer_percent,
        "up_to": item.printed.up_to,
        "printed_percent": item.printed.saving_percent,
        "ours_percent": item.ours_percent,
        "ours_at_buffer_percent": item.at_percent,
        "against": item.others,
        "within_one_point": item.reached,
    }


def _draw_printed(axes: Any, found: list[Saving]) -> None:
    handles = []
    for up_to, mark, text in (
        (False, "o", "printed, ±1 point"),
        (True, "^", "printed “up to”, from here on, ±1 point"),
    ):
        printed = [item.printed for item in found if item.printed.up_to is up_to]
        x, y = [item.buffer_percent for item in printed], [item.saving_percent for item in printed]
        how: dict[str, Any] = {"color": "black", "linewidth": 1.2, "capsize": 3, "yerr": SAVING_TOLERANCE_PERCENT}
        handles.append(axes.errorbar(x, y, fmt=mark, label=text, **how))
    axes.legend(handles=handles, loc="upper right")


def _or_none(values: Floats) -> list[float | None]:
    return [float(v) if np.isfinite(v) else None for v in values]
