"""What a run looks like as JSON and as a picture."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from das.command_line.outputs import offscreen_pyplot, save_figure
from das.domain.trajectory import Ledger, Trajectory
from das.domain.units import KM, KMH, KN, KW, PERMILLE, kwh
from das.solver.section import Section
from das.solver.solution import Fit, Solution
from precompute.baselines.strategies import Baseline
from precompute.baselines.strategy import Strategy


class Answer(Protocol):
    """What the optimal run (Solution) and the baselines (Baseline) share."""

    @property
    def trajectory(self) -> Trajectory: ...
    @property
    def ledger(self) -> Ledger: ...
    @property
    def fit(self) -> Fit: ...
    @property
    def least_time_s(self) -> float: ...
    @property
    def requested_s(self) -> float: ...
    @property
    def time_s(self) -> float: ...
    @property
    def feasible(self) -> bool: ...


def ledger_kwh(ledger: Ledger) -> dict[str, float]:
    """Every term of the energy ledger in kWh."""
    names = ("resistance", "component_loss", "friction_brake", "unreturned", "kinetic", "potential", "input", "comfort")
    return {name: kwh(getattr(ledger, name)) for name in names}


def solution_json(answer: Answer, min_time_s: float, solve_s: float) -> dict[str, Any]:
    """One run as the commands' `--json` prints it; what a strategy does not have is null."""
    return {
        "strategy": _strategy(answer),
        "min_time_s": min_time_s,
        "time_s": answer.time_s,
        "requested_time_s": answer.requested_s,
        "fit": str(answer.fit),
        "feasible": answer.feasible,
        "energy_input_kwh": kwh(answer.ledger.input),
        "energy_irreversible_kwh": kwh(answer.ledger.irreversible),
        "ledger_kwh": ledger_kwh(answer.ledger),
        "ledger_residual_ratio": answer.ledger.residual_ratio,
        **_certificate(answer),
        **_parameters(answer),
        "solve_s": solve_s,
    }


def _strategy(answer: Answer) -> str:
    return str(answer.strategy if isinstance(answer, Baseline) else Strategy.OPTIMAL)


def _certificate(answer: Answer) -> dict[str, float | str | None]:
    if not isinstance(answer, Solution):
        gaps = dict.fromkeys(("lambda_kw", "bound_kwh", "gap_ratio", "table_gap_ratio"))
        return {**gaps, "gap_reason": "a strategy other than optimal has no certificate"}
    return {
        "lambda_kw": _finite(answer.lambda_w / KW),
        "bound_kwh": _finite(kwh(answer.bound_j)),
        "gap_ratio": _finite(answer.gap_ratio),
        "table_gap_ratio": _finite(answer.table_gap_ratio),
        "gap_reason": answer.gap_reason,
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _parameters(answer: Answer) -> dict[str, Any]:
    if not isinstance(answer, Baseline):
        return {"cruise_speed_mps": None, "coasting_m": None}
    return {"cruise_speed_mps": answer.cruise_speed_mps, "coasting_m": [list(pair) for pair in answer.coasting_m]}


def draw_solution(path: Path, section: Section, answer: Answer) -> None:
    """Draw speed with limit, altitude, and wheel forces over the line."""
    pyplot = offscreen_pyplot()
    run = answer.trajectory
    x_km = run.s_m / KM
    figure, (speed, altitude, force) = pyplot.subplots(
        3, 1, figsize=(12, 8), sharex=True, height_ratios=(3, 1, 2), layout="constrained"
    )
    speed.step(x_km[:-1], run.limit_mps / KMH, where="post", color="0.45", linewidth=1, label="limit over the train")
    speed.plot(x_km, run.v_mps / KMH, color="tab:blue", label="speed")
    speed.set_ylabel("speed, km/h")
    speed.set_ylim(bottom=0)
    speed.legend(loc="lower center", ncols=2)
    speed.set_title(
        f"{section.route.name}, {section.vehicle.name}, level {section.level}, {_strategy(answer)}\n"
        f"{answer.time_s:.1f} s, {kwh(answer.ledger.input):.2f} kWh at the current collector"
    )
    altitude.fill_between(x_km, _altitude(section, run.s_m), color="0.8", step=None)
    low, high = _altitude(section, run.s_m).min(), _altitude(section, run.s_m).max()
    altitude.set_ylim(low - 5, high + 5 + 0.1 * (high - low))
    altitude.set_ylabel("altitude, m")
    steepest = np.abs(run.grade_ratio).max() / PERMILLE
    altitude.text(0.01, 0.9, f"steepest {steepest:.1f} ‰ under the train", transform=altitude.transAxes, va="top")
    force.stairs(run.force_el_n / KN, x_km, baseline=0, fill=True, color="tab:orange", alpha=0.7, label="motors")
    if run.force_friction_n.any():
        force.stairs(run.force_friction_n / KN, x_km, baseline=0, color="tab:red", label="friction brake")
    force.axhline(0, color="0.3", linewidth=0.5)
    force.set_ylabel("wheel force, kN")
    force.set_xlabel("position, km")
    force.legend(loc="upper right")
    save_figure(path, figure)
    pyplot.close(figure)


def _altitude(section: Section, s_m: Any) -> Any:
    return section.route.altitude_m(s_m)
