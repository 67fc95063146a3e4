"""What few changes of the controller cost, and what coach and driver do if the driver is slow, looks seldom, or errs.

`python -m docs.studies.coach` writes the tables into docs/explanation/coach.md again (a quarter of an hour on one
core), `python -m docs.studies.coach price` only the first of them (seconds); the pictures and the table of days are
made by `python -m docs.studies.coach_days`.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from das.advice.coach.settings import KeepingSettings
from das.command_line.files import load_route, load_vehicle
from das.domain.route import section_stops
from das.domain.units import KMH
from das.solver.section import build_section
from das.solver.solve import solve_front
from docs.studies.driving import KEEPING, WatchedRun, watched_run
from docs.studies.output import DOCS, write_table
from precompute.cli.few_switch import PRICES_S, few_switch_fronts, few_switch_rows, two_digits
from precompute.cli.options import numbers
from sim.drivers.kinds import Presentation
from sim.drivers.parameters import HumanParameters
from sim.world.scenario import load_scenario
from sim.world.service import Service, prepare_service

PAGE: Final = DOCS / "explanation" / "coach.md"
BUFFERS_PERCENT: Final = (4.0, 7.0)
"""Buffers of the table of prices."""

SCENARIOS: Final = ("clear-day", "train-ahead")
SEEDS: Final = (1, 2, 3)
DELAYS_S: Final = (0.2, 2.0, 4.0, 8.0)
GLANCES_S: Final = (0.2, 5.0, 15.0)
EFFORT_ERROR: Final = 0.1
MOVING_MPS: Final = 0.5

WITHOUT_DEAD_ZONE: Final = KeepingSettings(
    late_s=0.0, early_s=0.0, least_gain_s=0.0, late_gain_s=0.0, least_gain_power_s=0.0, astray_mps=0.0
)
"""Every difference is a reason for a new reference, but no reference is given up before its least age."""
WITHOUT_BOTH: Final = replace(WITHOUT_DEAD_ZONE, asked_every_s=0.0, least_age_s=0.0)
"""Every difference is a reason for a new reference, every second."""


class LoopDriver(NamedTuple):
    """A driver who follows all advice and has no lapses: reaction delay, mean time between looks, error of effort."""

    delay_s: float
    glance_s: float
    effort_error: float = EFFORT_ERROR

    @property
    def human(self) -> HumanParameters:
        """The driver's parameters; those that `LoopDriver` does not have are the default ones."""
        return HumanParameters(
            reaction_median_s=self.delay_s,
            reaction_log_sd=0.0,
            glance_mean_s=self.glance_s,
            glance_least_s=min(self.glance_s, HumanParameters().glance_least_s),
            force_error_ratio=self.effort_error,
            comply_traction_ratio=1.0,
            comply_hold_ratio=1.0,
            comply_coast_ratio=1.0,
            comply_brake_ratio=1.0,
            lapses_per_h=0.0,
        )


TYPICAL: Final = LoopDriver(4.0, 5.0)
DRIVERS: Final = (
    *(LoopDriver(delay, glance) for delay in DELAYS_S for glance in GLANCES_S),
    LoopDriver(4.0, 5.0, 0.0),
    LoopDriver(4.0, 5.0, 0.2),
    LoopDriver(8.0, 15.0, 0.2),
)
KEPT: Final = {"as it is": KEEPING, "no dead zones": WITHOUT_DEAD_ZONE, "nor least age": WITHOUT_BOTH}


@dataclass(frozen=True, kw_only=True)
class LoopMeasures:
    """Figures of the runs of one driver, summed over the runs.

    `rms_mps` is the root mean square of driven speed minus the speed of the reference at the same place. `causes`
    counts the new references by their cause, `most_in_3_min` is the largest number of them within three minutes.
    """

    changes: int
    minutes: float
    replans: int
    most_in_3_min: int
    reversals: int
    runs: int
    rms_mps: float
    causes: dict[str, int]

    @property
    def row(self) -> tuple[str, ...]:
        """The figures as the tables show them."""
        causes = ", ".join(f"{name} {count}" for name, count in sorted(self.causes.items()))
        return (
            f"{self.changes / self.minutes:.2f}",
            f"{self.replans / self.minutes:.2f}",
            f"{self.most_in_3_min}",
            f"{self.reversals / self.runs:.1f}",
            f"{self.rms_mps / KMH:.1f}",
            causes,
        )


def measured(runs: Sequence[WatchedRun]) -> LoopMeasures:
    """The measures of runs under the coach."""
    errors = [_errors_mps(one) for one in runs]
    causes = [cause for one in runs for cause in one.replans.values()]
    return LoopMeasures(
        changes=sum(one.run.stability.changes for one in runs),
        minutes=sum(one.run.stability.shown_s for one in runs) / 60.0,
        replans=len(causes),
        most_in_3_min=max(_most_within(one, 180.0) for one in runs),
        reversals=sum(one.run.stability.reversals for one in runs),
        runs=len(runs),
        rms_mps=float(np.sqrt(np.mean(np.concatenate(errors) ** 2))),
        causes={cause.label: causes.count(cause) for cause in set(causes)},
    )


def _errors_mps(one: WatchedRun) -> np.ndarray:
    """Driven speed minus the speed of the reference, at every second in which the train moves."""
    pairs = zip(one.run.states, one.watched, strict=False)
    found = [state.speed_mps - x.reference_mps for state, x in pairs if state.speed_mps > MOVING_MPS]
    return np.array([x for x in found if not math.isnan(x)])


def _most_within(one: WatchedRun, span_s: float) -> int:
    """The largest number of new references within a span of time (s)."""
    times_s = [time_ns * 1e-9 for time_ns in one.replans]
    return max((sum(0.0 <= t - begin < span_s for t in times_s) for begin in times_s), default=0)


def runs_of(
    services: Sequence[Service], driver: LoopDriver, seeds: Sequence[int], keeping: KeepingSettings = KEEPING
) -> list[WatchedRun]:
    """The runs of a driver, one for each service and seed."""
    human = driver.human
    return [
        watched_run(service, seed, Presentation.COACH, human=human, keeping=keeping)
        for service in services
        for seed in seeds
    ]


HEAD: Final = "changes/min | replans/min | most in 3 min | reversals a run | rms, km/h | causes"


def driver_table(services: Sequence[Service], seeds: Sequence[int], drivers: Sequence[LoopDriver]) -> Iterator[str]:
    """The lines of the table of drivers, in Markdown, as they are computed."""
    yield f"| delay, s | glance, s | effort error | {HEAD} |"
    yield "|---:|---:|---:|---:|---:|---:|---:|---:|---|"
    for one in drivers:
        row = measured(runs_of(services, one, seeds)).row
        yield f"| {one.delay_s:g} | {one.glance_s:g} | {100 * one.effort_error:.0f} % | {' | '.join(row)} |"


def keeping_table(
    services: Sequence[Service], seeds: Sequence[int], kept: Mapping[str, KeepingSettings]
) -> Iterator[str]:
    """The lines of the table of ways to keep a reference, for one driver, as they are computed."""
    yield f"| reference given up | {HEAD} |"
    yield "|---|---:|---:|---:|---:|---:|---|"
    for name, keeping in kept.items():
        row = measured(runs_of(services, TYPICAL, seeds, keeping)).row
        yield f"| {name} | {' | '.join(row)} |"


def price_table() -> Iterator[str]:
    """The lines of the table of what few changes cost from Zug to Luzern, as in `das-precompute few-switch`."""
    route = load_route("zurich-luzern")
    start, end = section_stops(route, "Zug", "Luzern")
    section = build_section(route, load_vehicle("re460-ic"), start_m=start.position_m, end_m=end.position_m)
    front = solve_front(section)
    least_s = front.fastest().time_s
    fronts = few_switch_fronts(section, numbers("--prices", PRICES_S))
    yield "| buffer | run | changes | a minute | shortest, s | time, s | kWh | more, kWh | more, % |"
    yield "|---:|---|---:|---:|---:|---:|---:|---:|---:|"
    for buffer_percent in BUFFERS_PERCENT:
        for found in few_switch_rows(front, fronts, least_s * (1.0 + buffer_percent / 100.0)):
            name = found["run"] if found["price_s"] is None else f"price {found['run']}"
            shortest = "–" if found["shortest_s"] is None else f"{found['shortest_s']:.1f}"
            yield (
                f"| {buffer_percent:g} % | {name} | {found['changes']} | {found['changes_per_min']:.2f} | "
                f"{shortest} | {found['time_s']:.1f} | {found['energy_kwh']:.2f} | "
                f"{two_digits(found['more_kwh'])} | {two_digits(100 * found['more_ratio'])} |"
            )


def main() -> None:
    """Write the tables again, or those that are named."""
    names = sys.argv[1:] or ["price", "drivers", "keeping"]
    if "price" in names:
        write_table(PAGE, "price", price_table())
    services = [prepare_service(load_scenario(name)) for name in SCENARIOS]
    if "drivers" in names:
        write_table(PAGE, "drivers", driver_table(services, SEEDS, DRIVERS))
    if "keeping" in names:
        write_table(PAGE, "keeping", keeping_table(services, SEEDS, KEPT))


if __name__ == "__main__":
    main()
