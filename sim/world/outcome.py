"""The figures of a run, for programs and as tables: punctuality, energies, losses, and the optimum."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from rich.table import Table

from das.command_line.printing import print_table, tell, typed
from das.domain.braking import ServiceBraking
from das.domain.conditions import Conditions
from das.domain.errors import InfeasibleError
from das.domain.trajectory import PART_WORDS, EnergyBalance
from das.domain.units import NS, kmh, kwh, kwh_words
from das.solver.front import Front
from das.solver.section import with_braking
from das.solver.solution import Solution
from das.solver.solve import solve_front
from sim.drive.above_optimum import NOT_COMPARABLE, AboveOptimum, SectionEnergy
from sim.drive.calls import KeptCall, KeptPassing, as_rows, keep, passing_table, passings_as_rows
from sim.drive.figures import DriveFigures
from sim.drivers.cab import AT_STOP_M
from sim.drivers.kinds import DriverKind, DriverName, FrictionPolicy, Presentation
from sim.recording.course import minutes
from sim.world.lockstep import Counts
from sim.world.loop import Run
from sim.world.service import Day, true_sections

if TYPE_CHECKING:
    from pathlib import Path

    from sim.drive.table import DriveTable
    from sim.world.lockstep import Traffic


def optimum_as_driven(fronts: Sequence[Front], run: Run) -> tuple[Solution, ...]:
    """The least-energy trajectory of each section for its time as driven; the fastest if that time was even less."""
    return tuple(
        front.trajectory(arrived.time_s - departed.time_s)
        for front, (departed, arrived) in zip(fronts, run.legs, strict=True)
    )


def above_optimum(day: Day, run: Run) -> AboveOptimum:
    """The energy above the optimum of the true train, by section."""
    sections = zip(pairwise(day.service.stops), run.legs, optimum_as_driven(true_fronts(day), run), strict=True)
    each = (
        SectionEnergy.of(start.name, end.name, day.plant.balance(departed, arrived).input, best)
        for (start, end), (departed, arrived), best in sections
    )
    return AboveOptimum.of(each, measured=True)


def true_fronts(day: Day) -> tuple[Front, ...]:
    """The fronts of the sections for the true train and the run's conditions; those of the plan if nothing differs.

    These fronts ignore events on the way: signals, restrictions, and slippery rail or wind on a part of the line.
    """
    service, truth = day.service, day.service.scenario.truth
    if truth.is_as_planned and day.conditions.changes_nothing:
        return service.fronts
    kept = service.true_fronts
    if day.conditions not in kept:
        planned = service.vehicle, service.level
        sections = true_sections(service.scenario, service.route, service.stops, planned, day.conditions)
        kept.clear()  # Each run of a service may have other conditions; only one set of fronts is kept.
        kept[day.conditions] = tuple(solve_front(section) for section in sections)
    return kept[day.conditions]


def fronts_of_braking(day: Day, driver: DriverName | None) -> tuple[Front, ...]:
    """The true train's fronts under the braking that a human driver intends or, for other drivers, the advice plans."""
    service, human = day.service, day.human
    braking = service.scenario.braking.of(service.vehicle)
    if driver is DriverKind.HUMAN:
        braking = ServiceBraking(
            deceleration_mps2=service.line.planned_braking_mps2(human.braking_mps2), build_up_s=0.0, reaction_s=0.0,
            deviation_m=0.0, below_limit_mps=human.below_limit_mps,
        )  # fmt: skip
    kept, key = service.braking_fronts, (day.conditions, braking)
    if key not in kept:
        kept.clear()
        kept[key] = tuple(solve_front(with_braking(front.section, braking)) for front in true_fronts(day))
    return kept[key]


EARLY_S: Final = 0.5
"""Earliness (s) above which a departure is called early."""
SHARES = ("component_loss", "resistance", "friction_brake", "unreturned", "comfort")
"""The parts of the dissipated energy, comfort systems included, as in a figure of Nold & Corman (2024).

`unreturned` is the braking energy that was not fed back into the line.
"""


@dataclass(frozen=True, kw_only=True)
class RunEnergies:
    """Energies of a run at the current collector, and the optima (J).

    `above` has the energy from departure to arrival for every section, and the least energy of the true train for the
    times that the sections took. `at_stops_j` is drawn at stops on the way. `planned_j` is the plan's least energy for
    the timetable. Both optima ignore events on the way.

    Driven = optimum + `blending_j` + `profile_j`, where `blending_j` went to friction brakes although the motors could
    have braked, and `profile_j` is the cost of the speed profile. `own_braking_j` is the optimum for the same times
    under the braking and the margin below limits that a human driver intends or, for other drivers, that the advice
    plans; its excess is the cost of such braking. It is None, with the reason in `no_own_braking`, if that is unknown.
    """

    above: AboveOptimum
    at_stops_j: float
    planned_j: float
    blending_j: float
    own_braking_j: float | None
    no_own_braking: str = ""

    @property
    def profile_j(self) -> float:
        """Energy above the optimum (J), without the part due to friction brakes where the motors could have braked."""
        return self.above.difference_j - self.blending_j

    def as_dict(self) -> dict[str, Any]:
        """The energies (kWh), for programs."""
        return {
            **self.above.as_dict(),
            "energy_at_stops_kwh": kwh(self.at_stops_j),
            "energy_planned_kwh": kwh(self.planned_j),
            "energy_blending_kwh": kwh(self.blending_j),
            "energy_profile_kwh": kwh(self.profile_j),
            "energy_own_braking_kwh": None if self.own_braking_j is None else kwh(self.own_braking_j),
        }


@dataclass(frozen=True, kw_only=True)
class DayOutcome:
    """The result of one run.

    `calls` (at stops) and `figures` (violations, quality of the advice) can also be computed from a recording of the
    run. `running_time_s` is the time between departures and arrivals, `simulated_s` the whole time of the run.
    `balance` is the energy balance from the first departure to the last arrival (J), comfort systems included. `counts`
    has the numbers of ticks at which advice was given, withdrawn or not received.
    """

    scenario: str
    seed: int
    level: str
    calls: tuple[KeptCall, ...]
    figures: DriveFigures
    running_time_s: float
    energies: RunEnergies
    balance: EnergyBalance
    counts: Counts
    simulated_s: int
    passings: tuple[KeptPassing, ...] = ()

    @property
    def late_s(self) -> float:
        """Lateness of the train at the last stop (s; early < 0)."""
        return self.calls[-1].late_s

    def as_dict(self) -> dict[str, Any]:
        """The figures for JSON and tables: times in s on the run's clock, energies in kWh, speeds in km/h."""
        zero_ns = self.calls[0].due_departure_ns
        return {
            "scenario": self.scenario,
            "seed": self.seed,
            "level": self.level,
            "late_s": self.late_s,
            "stops": as_rows(self.calls, zero_ns),
            "passings": passings_as_rows(self.passings, zero_ns),
            "running_time_s": self.running_time_s,
            **self.energies.as_dict(),
            **_parts(self.balance),
            "ledger_residual_ratio": self.balance.residual_ratio,
            "advices_given": self.counts.advised,
            "advices_withdrawn": self.counts.withdrawn,
            "advices_unheard": self.counts.unheard,
            "advices_above_limit": self.counts.above_limit,
            **self.figures.as_dict(),
            "simulated_s": self.simulated_s,
        }


def outcome(day: Day, run: Run, driver: DriverName | None = None) -> DayOutcome:
    """The result of one run. `own_braking_j` assumes the braking of `driver` (None: the braking that advice plans)."""
    service = day.service
    whole = day.plant.balance(run.legs[0][0], run.legs[-1][1])
    above = above_optimum(day, run)
    own_braking_j, no_own_braking = _own_braking(day, run, driver)
    times_ns = np.array([service.moment_ns(state.time_s) for state in run.states])
    return DayOutcome(
        scenario=service.scenario.id,
        seed=day.seed,
        level=str(service.level),
        calls=run.calls,
        figures=DriveFigures(
            violations=run.violations, stability=run.stability, instructions=run.instructions, calls=run.calls
        ),
        running_time_s=sum(arrived.time_s - departed.time_s for departed, arrived in run.legs),
        energies=RunEnergies(
            above=above,
            at_stops_j=whole.input - above.driven_j,
            planned_j=sum(solution.balance.input for solution in service.planned),
            blending_j=sum(arrived.blending_j - departed.blending_j for departed, arrived in run.legs),
            own_braking_j=own_braking_j,
            no_own_braking=no_own_braking,
        ),
        balance=whole,
        counts=run.counts,
        simulated_s=len(run.states) - 1,
        passings=keep(service.passings, times_ns, np.array([state.s_m for state in run.states])),
    )


def _own_braking(day: Day, run: Run, driver: DriverName | None) -> tuple[float | None, str]:
    """The value `RunEnergies.own_braking_j`, or why there is none: the true train may differ from the planned."""
    try:
        braking = optimum_as_driven(fronts_of_braking(day, driver), run)
    except InfeasibleError as error:
        return None, str(error)
    return sum(solution.balance.input for solution in braking), ""


def _parts(balance: EnergyBalance) -> dict[str, float]:
    """Energy (kWh) and share (0 to 1) of each part of the dissipated energy, and what the train has gained (kWh)."""
    parts_j = {name: float(getattr(balance, name)) for name in SHARES}
    total_j = sum(parts_j.values())
    return {
        **{f"{name}_kwh": kwh(energy_j) for name, energy_j in parts_j.items()},
        **{f"{name}_ratio": energy_j / total_j for name, energy_j in parts_j.items()},
        "kinetic_kwh": kwh(balance.kinetic),
        "potential_kwh": kwh(balance.potential),
    }


@dataclass(frozen=True, kw_only=True)
class DayResult:
    """The result of `das-sim run`: outcome, driver and advice, disturbances, and recording.

    `happens` is one line on the disturbances, `drawn` has all random draws of the seed (SI). `wall_s` is the duration
    of the run in real time. `file` is the recording, and `traffic` counts its messages; both are None for a run in a
    single process, which is not recorded.
    """

    outcome: DayOutcome
    driver: DriverName
    friction: FrictionPolicy = FrictionPolicy.AS_MEASURED
    advice: Presentation
    happens: str
    drawn: Mapping[str, Any]
    wall_s: float
    unkept: tuple[str, ...] = ()
    """A line for each section whose time is too short for the braking that the advice plans with."""
    file: Path | None = None
    traffic: Traffic | None = None
    table: DriveTable | None = None
    """The table of a drive in a single process, if it was kept."""

    @property
    def real_time_factor(self) -> float:
        """The speed of the run as a multiple of real time."""
        return self.outcome.simulated_s / max(self.wall_s, 1e-9)

    @property
    def warnings(self) -> list[str]:
        """Warnings about the advice of the run; empty if there are none."""
        warning = self.outcome.figures.stability.warning
        return [] if warning is None else [warning]

    def as_dict(self) -> dict[str, Any]:
        """The figures as `das-sim run --json` prints them."""
        return {
            **self.outcome.as_dict(),
            "driver": str(self.driver),
            "friction_policy": str(self.friction),
            "advice": str(self.advice),
            "happens": self.happens,
            "drawn": self.drawn,
            "wall_s": self.wall_s,
            "real_time_factor": self.real_time_factor,
            "warnings": [*self.unkept, *self.warnings],
            **({} if self.traffic is None else self.traffic.as_dict()),
            "file": None if self.file is None else str(self.file),
        }


STOP_LEGEND: Final = {
    "due, arrived, departed": "minutes and seconds since the timetable's first departure",
    "stopping error": "distance of the train beyond the stop (before it: negative)",
}
"""The legend below the table of stops."""


def print_result(result: DayResult) -> None:
    """Print the table of stops, the figures, notes, warnings, and the path of the recording."""
    print_table(_stops(result), STOP_LEGEND)
    if result.outcome.passings:
        print_table(passing_table(result.outcome.passings, result.outcome.calls[0].due_departure_ns))
    table = Table(show_header=False)
    table.add_column()
    table.add_column(justify="right", no_wrap=True)
    for row in _rows(result):
        table.add_row(*row)
    print_table(table)
    for note in _notes(result):
        tell(f"note: {note}")
    for warning in result.warnings:
        tell(f"warning: {warning}")
    if result.file is not None:
        tell(f"written: {result.file}")
        tell(f"view it: {typed('das-sim')} view {shlex.quote(str(result.file))}")


def _stops(result: DayResult) -> Table:
    found, zero_ns = result.outcome, result.outcome.calls[0].due_departure_ns
    title = f"{found.scenario}, seed {found.seed}, driver {result.driver}, advice {result.advice}"
    table = Table(title=title, title_justify="left")
    table.add_column("stop")
    for name in ("due", "arrived", "departed", "late", "stopping error"):
        table.add_column(name, justify="right")
    for call in found.calls:
        times_ns = (call.due_arrival_ns or call.due_departure_ns, call.arrived_ns, call.departed_ns)
        times = (minutes((time_ns - zero_ns) * NS) if time_ns else "" for time_ns in times_ns)
        late = "" if math.isnan(call.late_s) else f"{call.late_s:+.0f} s"
        error = f"{call.stopping_error_m:+.1f} m" if call.arrived_ns else ""
        table.add_row(call.name, *times, late, error)
    return table


def _rows(result: DayResult) -> list[tuple[str, str]]:
    found, energies = result.outcome, result.outcome.energies
    braking, own_j = "this driver" if result.driver is DriverKind.HUMAN else "advised", energies.own_braking_j
    rows = [
        ("energy, departures to arrivals", kwh_words(energies.above.driven_j)),
        ("  optimum of the plan", kwh_words(energies.planned_j)),
        ("  optimum for the times as driven", kwh_words(energies.above.optimum_j)),
        ("  above that optimum", energies.above.words),
        ("    friction where motors could brake", kwh_words(energies.blending_j, signed=True)),
        ("    speed profile", kwh_words(energies.profile_j, signed=True)),
        (f"  optimum braking as {braking}", "not known" if own_j is None else kwh_words(own_j)),
    ]
    rows += [
        ("  at stops on the way", kwh_words(energies.at_stops_j, signed=True)),
        ("energy including stops, the sum of", kwh_words(found.balance.input)),
        *((f"  {PART_WORDS[name]}", kwh_words(part_j, signed=True)) for name, part_j in found.balance.parts.items()),
        ("comfort systems, not part of it", kwh_words(found.balance.comfort)),
    ]
    counts, traffic = found.counts, result.traffic
    told = f"{counts.advised}, {counts.withdrawn} withdrawn, {counts.unheard} not received"
    rows.append(("advice messages", told))
    rows += found.figures.rows()
    if traffic is not None:
        rows.append(("messages recorded / lost", f"{traffic.recorded.total()} / {traffic.lost}"))
    rows.append(("simulated", f"{found.simulated_s} s at {result.real_time_factor:.0f} × real time"))
    return rows


def _notes(result: DayResult) -> list[str]:
    found, violations = result.outcome, result.outcome.figures.violations
    notes = [f"disturbances: {result.happens}"]
    human = result.drawn["human"] if result.driver is DriverKind.HUMAN else {}
    if human:
        notes.append("the driver: " + ", ".join(f"{name} {value:.4g}" for name, value in human.items()))
    truth = {name: value for name, value in result.drawn["truth"].items() if value != getattr(Conditions, name)}
    if truth:
        notes.append("the true train: " + ", ".join(f"{name} {value:.4g}" for name, value in truth.items()))
    beyond = (call for call in found.calls if call.stopping_error_m > AT_STOP_M)
    notes += [f"the train stopped {call.stopping_error_m:.0f} m beyond {call.name}" for call in beyond]
    early = ((call.name, (call.due_departure_ns - call.departed_ns) * NS) for call in found.calls[:-1])
    notes += [f"the train left {name} {early_s:.1f} s before its time" for name, early_s in early if early_s > EARLY_S]
    if violations.signals_passed:
        beyond_m = violations.beyond_signal_m
        notes.append(f"signals passed at danger: {violations.signals_passed}, by up to {beyond_m:.0f} m")
    if violations.over_limit_s:
        over_kmh = kmh(violations.over_limit_mps)
        notes.append(f"{violations.over_limit_s:.0f} s above limits, by up to {over_kmh:.0f} km/h")
    if found.energies.above.why_not:
        notes.append(f"{NOT_COMPARABLE}: {found.energies.above.why_not}")
    if why := found.energies.no_own_braking:
        notes.append(f"optimum with such braking unknown: {why}")
    if found.counts.above_limit:
        notes.append(f"{found.counts.above_limit} advice messages were above the limit: please report this")
    return notes
