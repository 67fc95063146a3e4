"""The figures of a run: punctuality, energies, where they went, and the optimum beside them."""

from __future__ import annotations

import math
from typing import Any

from das.domain.trajectory import Ledger
from das.domain.units import kmh, kwh
from das.solver.solution import Fit
from sim.world.calls import KeptCall
from sim.world.day import Day
from sim.world.loop import Run

SHARES = ("component_loss", "resistance", "friction_brake", "unreturned", "comfort")
"""Where energy is lost for good, as in the paper's figure, and what the line did not take back."""


def outcome(day: Day, run: Run) -> dict[str, Any]:
    """The figures of a run (times in s on the run's clock, energies in kWh at the current collector).

    `energy_kwh` is from departure to arrival, summed over the sections; what is drawn at stops in between is
    `energy_at_stops_kwh`, comfort systems are beside both. The parts and their shares are of the whole time from the
    first departure to the last arrival. The optima are the plan's least energy: for the timetable, and (hindsight)
    for the times the sections really took; neither knows the day's disturbances.
    """
    service = day.service
    whole = day.plant.ledger(run.legs[0][0], run.legs[-1][1])
    energy_j = sum(day.plant.ledger(*leg).input for leg in run.legs)
    hindsight = [
        front.trajectory(arrived.time_s - departed.time_s)
        for front, (departed, arrived) in zip(service.fronts, run.legs, strict=True)
    ]
    hindsight_j = sum(solution.ledger.input for solution in hindsight)
    return {
        "scenario": service.scenario.id,
        "seed": day.seed,
        "level": str(service.level),
        "late_s": run.late_s,
        "stops": [_stop(call) for call in run.calls],
        "running_time_s": sum(arrived.time_s - departed.time_s for departed, arrived in run.legs),
        "energy_kwh": kwh(energy_j),
        "energy_at_stops_kwh": kwh(whole.input - energy_j),
        "energy_planned_kwh": kwh(sum(solution.ledger.input for solution in service.planned)),
        "energy_hindsight_kwh": kwh(hindsight_j),
        "hindsight_faster_than_possible": any(solution.fit is Fit.LATE for solution in hindsight),
        "beyond_hindsight_ratio": energy_j / hindsight_j - 1.0 if hindsight_j > 0 else None,
        **_parts(whole),
        "ledger_residual_ratio": whole.residual_ratio,
        "advices_given": run.counts.advised,
        "advices_withdrawn": run.counts.withdrawn,
        "advices_unheard": run.counts.unheard,
        "advices_above_limit": run.counts.above_limit,
        "signals_passed": run.violations.signals_passed,
        "beyond_signal_m": run.violations.beyond_signal_m,
        "over_limit_s": run.violations.over_limit_s,
        "over_limit_kmh": kmh(run.violations.over_limit_mps),
        "simulated_s": len(run.states) - 1,
    }


def _stop(call: KeptCall) -> dict[str, Any]:
    return {
        "name": call.name,
        "due_s": call.due_s,
        "arrived_s": None if math.isnan(call.arrived_s) else call.arrived_s,
        "departed_s": None if math.isnan(call.departed_s) else call.departed_s,
        "late_s": call.late_s,
        "missed_m": call.missed_m,
    }


def _parts(ledger: Ledger) -> dict[str, float]:
    """Energy and share of each way in which energy is lost for good, and the potential energy."""
    parts = {name: float(getattr(ledger, name)) for name in SHARES}
    total = sum(parts.values())
    return {
        **{f"{name}_kwh": kwh(energy_j) for name, energy_j in parts.items()},
        **{f"{name}_ratio": energy_j / total for name, energy_j in parts.items()},
        "potential_kwh": kwh(ledger.potential),
    }
