"""The account of a drive as plain rows: for tables, for JSON and for the report."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from das.domain.units import KM, NS, kwh
from sim.accounts.account import Account, LegAccount
from sim.accounts.causes import EnergyCause
from sim.accounts.places import Places


def as_dict(account: Account) -> dict[str, Any]:
    """The account for programs: energies in kWh at the current collector, times in s, positions in m."""
    against = account.against_timetable
    return {
        "driven_kwh": kwh(account.driven_j),
        "optimum_same_times_kwh": kwh(account.optimum_j),
        "above_optimum_kwh": kwh(account.difference_j),
        "measured": account.measured,
        "by_cause_kwh": {str(cause): kwh(energy_j) for cause, energy_j in account.by_cause.items()},
        "optimum_timetable_kwh": None if account.timetable_j is None else kwh(account.timetable_j),
        "by_cause_against_timetable_kwh": None
        if against is None
        else {str(cause): kwh(energy_j) for cause, energy_j in against.items()},
        "legs": [leg_dict(leg) for leg in account.legs],
    }


def leg_dict(leg: LegAccount) -> dict[str, Any]:
    """One leg for programs."""
    driven = leg.leg

    def optional(energy_j: float | None) -> float | None:
        return None if energy_j is None else kwh(energy_j)

    return {
        "from": driven.start.name,
        "to": driven.end.name,
        "trip_s": driven.trip_s,
        "timetable_s": driven.timetable_s,
        "departed_ns": int(driven.motion.time_ns[0]),
        "arrived_ns": int(driven.motion.time_ns[-1]),
        "driven_kwh": kwh(leg.driven_j),
        "optimum_same_time_kwh": kwh(leg.optimum_j),
        "optimum_timetable_kwh": optional(leg.timetable_j),
        "late_departure_kwh": optional(leg.recovered_j),
        "early_arrival_kwh": optional(leg.early_j),
        "faster_than_plans_train": leg.too_fast_for_plan,
        "by_cause_kwh": {str(cause): kwh(energy_j) for cause, energy_j in leg.by_cause.items()},
        "per_100_m": place_rows(leg.even),
        "per_limit": place_rows(leg.by_limit),
    }


def place_rows(places: Places) -> list[dict[str, float]]:
    """One row a stretch, for programs."""
    return [
        {
            "start_m": float(places.start_m[i]),
            "end_m": float(places.end_m[i]),
            "driven_s": float(places.driven_s[i]),
            "optimum_s": float(places.optimum_s[i]),
            "driven_kwh": kwh(float(places.driven_j[i])),
            "optimum_kwh": kwh(float(places.optimum_j[i])),
            "lost_more_kwh": kwh(float(places.lost_more_j[i])),
        }
        for i in range(len(places.start_m))
    ]


class WorstPlace(NamedTuple):
    """A stretch that lost energy above the optimum: where in words, how much (J), and its main cause."""

    where: str
    more_j: float
    cause: EnergyCause


def worst_places(account: Account, most: int = 5) -> list[WorstPlace]:
    """The stretches between limits that lost most above the optimum, the worst first."""
    stretches = [
        (float(more), leg, float(start), float(end))
        for leg in account.legs
        for start, end, more in zip(leg.by_limit.start_m, leg.by_limit.end_m, leg.by_limit.lost_more_j, strict=True)
        if more > 0
    ]
    worst = sorted(stretches, key=lambda one: -one[0])[:most]
    return [
        WorstPlace(f"km {start / KM:.1f} to {end / KM:.1f}", more, leg.main_cause(start, end))
        for more, leg, start, end in worst
    ]


def seconds_by_cause(account: Account) -> dict[EnergyCause, float]:
    """For how long (s) what belongs to each cause went on."""
    total: dict[EnergyCause, float] = {}
    for leg in account.legs:
        lasted_s = np.diff(leg.leg.motion.time_ns[leg.committed.sample]) * NS
        for cause, over_s in zip(leg.committed.causes, lasted_s.tolist(), strict=True):
            total[cause] = total.get(cause, 0.0) + over_s
    return total
