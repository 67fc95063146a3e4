"""What a solution looks like as JSON, as a table in the terminal, and as a picture."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Any

import numpy as np

from das.domain.errors import DasError
from das.domain.files.writing import write_whole
from das.domain.trajectory import Ledger
from das.domain.units import KM, KMH, KN, KW, PERMILLE, kwh
from das.solver.front import Solution
from das.solver.section import Section


def ledger_kwh(ledger: Ledger) -> dict[str, float]:
    """Every term of the energy ledger in kWh."""
    names = ("resistance", "component_loss", "friction_brake", "kinetic", "potential", "input", "comfort")
    return {name: kwh(getattr(ledger, name)) for name in names}


def solution_json(solution: Solution, min_time_s: float, solve_s: float) -> dict[str, Any]:
    """One solution as the commands' `--json` prints it."""
    return {
        "min_time_s": min_time_s,
        "time_s": solution.time_s,
        "requested_time_s": solution.requested_s,
        "fit": str(solution.fit),
        "feasible": solution.feasible,
        "energy_input_kwh": kwh(solution.ledger.input),
        "energy_irreversible_kwh": kwh(solution.ledger.irreversible),
        "ledger_kwh": ledger_kwh(solution.ledger),
        "ledger_residual_ratio": solution.ledger.residual_ratio,
        "lambda_kw": solution.lambda_w / KW if math.isfinite(solution.lambda_w) else None,
        "gap_ratio": solution.gap_ratio if math.isfinite(solution.gap_ratio) else None,
        "solve_s": solve_s,
    }


def draw_solution(path: Path, section: Section, solution: Solution) -> None:
    """Speed with limit, altitude, and wheel forces over the line, as a PNG."""
    try:
        import matplotlib
    except ImportError:
        raise DasError("--plot needs matplotlib: install the extra, pip install '.[view]' in the checkout") from None
    matplotlib.use("Agg")
    from matplotlib import pyplot

    run = solution.trajectory
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
        f"{section.route.name}, {section.vehicle.name}, level {section.level}\n"
        f"{solution.time_s:.1f} s, {kwh(solution.ledger.input):.2f} kWh at the current collector"
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
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=120)
    pyplot.close(figure)
    write_whole(path, buffer.getvalue())


def _altitude(section: Section, s_m: Any) -> Any:
    return section.route.altitude_m(s_m)
