"""The measures of an experiment: what each is, its formula, its unit and where it is from."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from das.domain.units import kwh
from sim.experiment import driving_measures as driving
from sim.experiment.driven import Driven

NOLD: Final = "as in Nold & Corman (2024)"
LEDGER: Final = "energy balance of the simulated train (docs/reference/plant.md)"
OWN: Final = "own definition"


@dataclass(frozen=True, kw_only=True)
class Measure:
    """A measure of a trial: its column, which ends in its unit, its formula, where it is from, and how it is found.

    `of` gives a number, or None where a trial has none (no advice was shown, or the driver keeps no diary).
    """

    name: str
    title: str
    unit: str
    formula: str
    source: str
    of: Callable[[Driven], float | int | None]


def _energy(name: str) -> Callable[[Driven], float | None]:
    def of(driven: Driven) -> float | None:
        value: float | None = driven.outcome.energies.as_dict()[name]
        return value

    return of


def _ledger(name: str) -> Callable[[Driven], float | None]:
    return lambda driven: kwh(float(getattr(driven.outcome.ledger, name)))


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value


_LISTED: Final = (
    Measure(
        name="gap_to_optimum_ratio",
        title="Gap to the optimum",
        unit="1",
        source=NOLD,
        of=_energy("beyond_hindsight_ratio"),
        formula="E / E_opt − 1: the energy E from departure to arrival, and the least energy E_opt with which the "
        "simulated train could have kept the limits and the running times that the sections really took; smaller "
        "is better",
    ),
    Measure(
        name="energy_at_equal_arrival_kwh",
        title="Energy at equal arrival",
        unit="kWh",
        source=OWN,
        of=lambda driven: kwh(driven.equal_arrival_j),
        formula="E − E_opt + E_opt(timetable): the energy that the trial would have taken with the same distance "
        "to the optimum if every section had taken its time by the timetable",
    ),
    Measure(
        name="energy_kwh",
        title="Energy",
        unit="kWh",
        source=LEDGER,
        of=_energy("energy_kwh"),
        formula="E: energy at the current collector from departure to arrival, summed over the sections",
    ),
    Measure(
        name="energy_hindsight_kwh",
        title="Optimum for the times as driven",
        unit="kWh",
        source=NOLD,
        of=_energy("energy_hindsight_kwh"),
        formula="E_opt: least energy of the true train for the running times that the sections really took",
    ),
    Measure(
        name="energy_blending_kwh",
        title="Lost to friction brakes where the motors could brake",
        unit="kWh",
        source=LEDGER,
        of=_energy("energy_blending_kwh"),
        formula="part of E − E_opt: what would not have been needed if the motors had given all braking that they"
        " could",
    ),
    Measure(
        name="energy_profile_kwh",
        title="Lost to the speed profile",
        unit="kWh",
        source=OWN,
        of=_energy("energy_profile_kwh"),
        formula="the rest of E − E_opt",
    ),
    Measure(
        name="component_loss_kwh",
        title="Losses of the train",
        unit="kWh",
        source=LEDGER,
        of=_ledger("component_loss"),
        formula="∫ of the losses of the traction chain from the first departure to the last arrival",
    ),
    Measure(
        name="resistance_kwh",
        title="Running resistance",
        unit="kWh",
        source=LEDGER,
        of=_ledger("resistance"),
        formula="∫ resistance · v dt, tunnels and curves included",
    ),
    Measure(
        name="friction_brake_kwh",
        title="Friction brakes",
        unit="kWh",
        source=LEDGER,
        of=_ledger("friction_brake"),
        formula="∫ force of the friction brakes · v dt",
    ),
    Measure(
        name="running_time_s",
        title="Running time",
        unit="s",
        source=OWN,
        of=lambda driven: driven.outcome.running_time_s,
        formula="time from departures to arrivals, summed over the sections",
    ),
    Measure(
        name="late_s",
        title="Delay at the last stop",
        unit="s",
        source=OWN,
        of=lambda driven: driven.outcome.late_s,
        formula="arrival at the last stop − arrival by the timetable (early < 0)",
    ),
    Measure(
        name="stop_error_m",
        title="Stop error",
        unit="m",
        source="Askey & Sheridan (1995) judge stop accuracy",
        of=driving.stop_error_m,
        formula="mean over the stops after the first of |where the train stands − where it should|",
    ),
    Measure(
        name="speed_rmse_mps",
        title="Speed error against what was shown",
        unit="m/s",
        source="tracking error of manual control",
        of=driving.speed_rmse_mps,
        formula="√ mean (v − shown)² over the moving seconds in which a speed was shown; for a reduced maximum "
        "speed only what is above it counts, and of the coach only the times in which a speed is to be "
        "held",
    ),
    Measure(
        name="speed_in_band_ratio",
        title="Time in band",
        unit="1",
        source="band of 3 km/h: assumption",
        of=driving.speed_in_band_ratio,
        formula="share of those seconds with |v − shown| ≤ 3 km/h",
    ),
    Measure(
        name="effort_rmse_ratio",
        title="Effort error against what was shown",
        unit="1",
        source="tracking error of manual control",
        of=driving.effort_rmse_ratio,
        formula="√ mean (controller − shown effort)² over the moving seconds in which an effort was shown; 1 is "
        "full scale",
    ),
    Measure(
        name="reaction_s",
        title="Reaction time",
        unit="s",
        source="decisions of the driver",
        of=driving.reaction_s,
        formula="median time from the glance at which advice was noticed to acting on it; departures left out",
    ),
    Measure(
        name="response_s",
        title="Response time",
        unit="s",
        source="decisions of the driver",
        of=driving.response_s,
        formula="median time from when advice was first shown to acting on it; departures left out",
    ),
    Measure(
        name="compliance_ratio",
        title="Compliance",
        unit="1",
        source="decisions of the driver",
        of=driving.compliance_ratio,
        formula="followed / (followed + refused) of the advice that was noticed",
    ),
    Measure(
        name="control_movements_per_min",
        title="Control movements",
        unit="1/min",
        source="Balfe et al. (2017) count controller movements",
        of=driving.control_movements_per_min,
        formula="times that a controller that stood still begins to move, per minute in which the train moved",
    ),
    Measure(
        name="power_brake_reversals",
        title="Power–brake reversals",
        unit="1",
        source="Large, Golightly & Taylor (2017) compare how often drivers switch",
        of=driving.power_brake_reversals,
        formula="times that traction is followed by brakes, or brakes by traction, with less than 10 s between "
        "(wheel force beyond ±1 kN, train moving)",
    ),
    Measure(
        name="jerk_rms_mps3",
        title="Jerk",
        unit="m/s³",
        source="acceleration noise",
        of=driving.jerk_rms_mps3,
        formula="√ mean (Δa / 1 s)² over the seconds in which the train moved",
    ),
    Measure(
        name="over_limit_s",
        title="Time above limits",
        unit="s",
        source=OWN,
        of=lambda driven: driven.outcome.violations.over_limit_s,
        formula="time with a speed more than 1 km/h above what is allowed",
    ),
    Measure(
        name="over_limit_mps",
        title="Greatest speed above limits",
        unit="m/s",
        source=OWN,
        of=lambda driven: driven.outcome.violations.over_limit_mps,
        formula="max (v − limit) over those times; 0 where there are none",
    ),
    Measure(
        name="signals_passed",
        title="Signals passed at danger",
        unit="1",
        source=OWN,
        of=lambda driven: driven.outcome.violations.signals_passed,
        formula="signals at danger that the train's head is more than 0.5 m beyond",
    ),
    Measure(
        name="advice_changes_per_min",
        title="Advice changes",
        unit="1/min",
        source=OWN,
        of=lambda driven: _known(driven.outcome.restlessness.changes_per_min),
        formula="seconds that begin with another mode, speed (km/h) or effort (step of 0.2) on the display, per "
        "minute in which the train moved and advice was shown",
    ),
    Measure(
        name="glances_per_min",
        title="Glances at the display",
        unit="1/min",
        source="decisions of the driver",
        of=driving.glances_per_min,
        formula="glances while the train moves, per minute in which it moved",
    ),
    Measure(
        name="lapses",
        title="Lapses of attention",
        unit="1",
        source="decisions of the driver",
        of=driving.lapses,
        formula="times that the driver's attention went away",
    ),
)
MEASURES: Final = {one.name: one for one in _LISTED}
"""Every measure by its name, which is also its column."""


def measured(driven: Driven, names: list[str]) -> dict[str, Any]:
    """The values of some measures of a trial, by name."""
    return {name: MEASURES[name].of(driven) for name in names}


def measure_markdown() -> str:
    """The table of measures as docs/reference/measures.md shows it."""
    rows = [f"| `{one.name}` | {one.unit} | {_cell(one.formula)} | {_cell(one.source)} |" for one in MEASURES.values()]
    return "\n".join(["| measure | unit | formula | source |", "|---|---|---|---|", *rows])


def _cell(text: str) -> str:
    """Text for a cell of a table: a bar would end the cell."""
    return text.replace("|", "\\|")
