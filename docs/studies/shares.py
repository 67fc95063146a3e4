"""Energy of a Zürich–Luzern trip by use: 49 measured runs in the paper compared with a modelled driver.

The driver runs each section with the timetable's buffer, by reduced maximum speed or by four modes, and brakes with a
given share of friction: at every moment that share of the brake force comes from the friction brake, the rest from the
motors. Comfort systems draw constant power all the time, including dwell. The shares refer to the irreversible energy
(component losses, resistance with curves and tunnels, friction brake, comfort), without the potential energy between
the ends. Assumed, not measured: the route between the stations, buffer, dwell, comfort power, driver.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

from matplotlib.patches import Patch

from das.domain.files.load import load_route, load_vehicle
from das.domain.levels import Level
from das.domain.trajectory import EnergyBalance, Trajectory
from das.domain.units import PERCENT, kwh
from das.domain.vehicle import Vehicle
from das.solver.section import Section, build_section
from docs.studies.cases import ENERGY_SHARES_PERCENT, GTO_VEHICLE
from docs.studies.drawing import new_figure
from docs.studies.output import Output, csv_text
from precompute.baselines import strategies as baselines

ROUTE = "zurich-luzern"
BUFFER_PERCENT = 7.0
"""Running time supplement of every section (assumption; usual values in the paper are 5 to 7 %)."""
DWELL_S = 120.0
"""Dwell at each intermediate stop (assumption)."""
DRIVERS: dict[str, Callable[[Section, float], Any]] = {
    "top-speed": baselines.reduced_maximum_speed,
    "four-mode": baselines.four_modes,
}
SHARE_STEPS = 40
"""Number of bisections in the search for the share of friction braking."""


@dataclass(frozen=True, kw_only=True)
class DrivenTrip:
    """The sections of a trip as driven, with the train and its losses."""

    vehicle: Vehicle
    runs: tuple[Trajectory, ...]

    @property
    def time_s(self) -> float:
        """Time from departure to arrival, including dwell (s)."""
        return sum(run.time_s for run in self.runs) + DWELL_S * (len(self.runs) - 1)


@dataclass(frozen=True, kw_only=True)
class Shares:
    """Energies (J) of a trip, by use."""

    friction_ratio: float
    component_loss: float
    resistance: float
    friction_brake: float
    comfort: float

    @property
    def total(self) -> float:
        """The irreversible energy (J)."""
        return self.component_loss + self.resistance + self.friction_brake + self.comfort

    def percent(self, name: str) -> float:
        """Share of one item in %."""
        return float(getattr(self, name)) / self.total / PERCENT


def drive(driver: str) -> DrivenTrip:
    """The trip with a kind of driver; every section with the same buffer."""
    route, vehicle = load_route(ROUTE), load_vehicle(GTO_VEHICLE)
    runs = []
    for start, end in pairwise(route.stops):
        section = build_section(route, vehicle, level=Level.L3, start_m=start.position_m, end_m=end.position_m)
        time_s = baselines.fastest(section).time_s * (1 + BUFFER_PERCENT * PERCENT)
        runs.append(DRIVERS[driver](section, time_s).trajectory)
    return DrivenTrip(vehicle=vehicle, runs=tuple(runs))


def braked_with_friction(run: Trajectory, friction_ratio: float) -> Trajectory:
    """The trajectory with a share of every brake force from the friction brake."""
    total = run.force_el_n + run.force_friction_n
    friction = friction_ratio * total.clip(max=0.0)
    return replace(run, force_el_n=total - friction, force_friction_n=friction)


def shares(trip: DrivenTrip, friction_ratio: float) -> Shares:
    """The energies of a trip with a share of friction braking."""
    loss = trip.vehicle.loss_model(Level.L3)
    energy_balances = [braked_with_friction(run, friction_ratio).balance(trip.vehicle, loss) for run in trip.runs]

    def total(pick: Callable[[EnergyBalance], float]) -> float:
        return sum(pick(balance) for balance in energy_balances)

    return Shares(
        friction_ratio=friction_ratio,
        component_loss=total(lambda x: x.component_loss),
        resistance=total(lambda x: x.resistance),
        friction_brake=total(lambda x: x.friction_brake),
        comfort=trip.vehicle.comfort_power_w * trip.time_s,
    )


def friction_for(trip: DrivenTrip, friction_brake_percent: float) -> float | None:
    """The share of friction braking at which the friction brake dissipates a given share of the energy, or None."""
    if shares(trip, 1.0).percent("friction_brake") < friction_brake_percent:
        return None
    low, high = 0.0, 1.0
    for _ in range(SHARE_STEPS):
        middle = 0.5 * (low + high)
        below = shares(trip, middle).percent("friction_brake") < friction_brake_percent
        low, high = (middle, high) if below else (low, middle)
    return high


def energy_shares(_bench: object, output: Output) -> None:
    """Write the shares of both drivers and of the paper, as CSV and picture."""
    drawn: dict[str, list[Shares]] = {}
    for driver in DRIVERS:
        trip = drive(driver)
        fitted = friction_for(trip, ENERGY_SHARES_PERCENT["friction_brake"])
        ratios = [0.0, *([fitted] if fitted is not None else []), 1.0]
        drawn[driver] = [shares(trip, ratio) for ratio in ratios]
    output.text("shares.csv", _csv(drawn))
    output.picture("shares", _draw(drawn))


_LABELS = {
    "component_loss": "component losses",
    "resistance": "running resistance",
    "friction_brake": "friction brake",
    "comfort": "comfort systems",
}
_COLOURS = {"component_loss": "#d55e00", "resistance": "#56b4e9", "friction_brake": "#555555", "comfort": "#e6b800"}


def _csv(drawn: dict[str, list[Shares]]) -> str:
    header = ["driver", "friction braking", *_LABELS.values(), "total kWh"]
    rows = [["paper, 49 measured runs", "–", *(f"{v:.1f} %" for v in ENERGY_SHARES_PERCENT.values()), "–"]]
    for driver, items in drawn.items():
        for item in items:
            cells = [f"{item.percent(n):.1f} % ({item.percent(n) - v:+.1f})" for n, v in ENERGY_SHARES_PERCENT.items()]
            rows.append([driver, f"{100 * item.friction_ratio:.0f} %", *cells, f"{kwh(item.total):.0f}"])
    return csv_text([header, *rows])


def _draw(drawn: dict[str, list[Shares]]) -> Any:
    bars: list[tuple[str, dict[str, float]]] = [("paper\n49 measured runs", dict(ENERGY_SHARES_PERCENT))]
    for driver, items in drawn.items():
        for item in items:
            percent = {name: item.percent(name) for name in ENERGY_SHARES_PERCENT}
            bars.append((f"{driver}\n{100 * item.friction_ratio:.0f} % friction", percent))
    figure = new_figure(10, 0.62 * len(bars) + 1.4)
    axes = figure.subplots()
    for row, (_, percent) in enumerate(bars):
        left = 0.0
        for name, value in percent.items():
            axes.barh(row, value, left=left, color=_COLOURS[name], edgecolor="white", height=0.72)
            if value > 3:
                ink = "white" if name == "friction_brake" else "black"
                axes.text(left + value / 2, row, f"{value:.1f}", ha="center", va="center", fontsize=9, color=ink)
            left += value
    axes.set_yticks(range(len(bars)), [text for text, _ in bars])
    axes.invert_yaxis()
    axes.set(xlim=(0, 100), xlabel="share of the energy net of regeneration, %")
    handles = [Patch(color=_COLOURS[name], label=text) for name, text in _LABELS.items()]
    axes.legend(handles=handles, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(_LABELS))
    return figure
