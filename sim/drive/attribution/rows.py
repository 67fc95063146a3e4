"""The energy attribution of a drive as plain rows: for tables, for JSON and for the report."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.domain.units import KM, NS, kwh
from sim.drive.attribution.attribution import Attribution, LegAttribution, Places
from sim.drive.attribution.causes import EnergyCause


def as_dict(attribution: Attribution) -> dict[str, Any]:
    """The energy attribution for programs: energies in kWh at the current collector, times in s, positions in m."""
    against = attribution.against_timetable
    return {
        "driven_kwh": kwh(attribution.driven_j),
        "optimum_same_times_kwh": kwh(attribution.optimum_j),
        "above_optimum_kwh": kwh(attribution.difference_j),
        "above_optimum_ratio": attribution.above.ratio,
        "measured": attribution.measured,
        "by_cause_kwh": {str(cause): kwh(energy_j) for cause, energy_j in attribution.by_cause.items()},
        "optimum_timetable_kwh": None if attribution.timetable_j is None else kwh(attribution.timetable_j),
        "by_cause_against_timetable_kwh": None
        if against is None
        else {str(cause): kwh(energy_j) for cause, energy_j in against.items()},
        "legs": [leg_dict(leg) for leg in attribution.legs],
    }


def leg_dict(leg: LegAttribution) -> dict[str, Any]:
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
    """A stretch that lost energy above the optimum: where in words, how much (J), and its causes, the largest first."""

    where: str
    more_j: float
    causes: tuple[EnergyCause, ...]


DENSE = 2.0
LARGE_SHARE = 0.2
"""A cause that has this share of what the causes of a stretch took, or more, is named."""


def worst_places(attribution: Attribution, most: int = 5) -> list[WorstPlace]:
    """The stretches that lost most above the optimum, the worst first.

    A stretch is as long as the train lost more there, per 100 m, than `DENSE` times the average over the drive.
    """
    found = []
    losses = [leg.even.lost_more_j for leg in attribution.legs]
    usual_j = DENSE * max(float(np.concatenate(losses).mean()), 0.0) if losses else 0.0
    for leg, more_j in zip(attribution.legs, losses, strict=True):
        for first, last in _worst_runs(more_j - usual_j, most):
            start_m, end_m = float(leg.even.start_m[first]), float(leg.even.end_m[last])
            where = f"km {start_m / KM:.1f} to {end_m / KM:.1f}"
            found.append(WorstPlace(where, float(more_j[first : last + 1].sum()), _causes(leg, start_m, end_m)))
    return sorted(found, key=lambda one: -one.more_j)[:most]


def _causes(leg: LegAttribution, start_m: float, end_m: float) -> tuple[EnergyCause, ...]:
    parts = {cause: energy_j for cause, energy_j in leg.causes_between(start_m, end_m).items() if energy_j > 0}
    whole_j = sum(parts.values())
    named = [cause for cause in sorted(parts, key=lambda one: -parts[one]) if parts[cause] >= LARGE_SHARE * whole_j]
    return tuple(named) or (EnergyCause.REST,)


def _worst_runs(scores: NDArray[np.float64], most: int) -> list[tuple[int, int]]:
    """The runs of places (first, last) with the largest sums of scores, the largest first; none overlaps another."""
    left, found = scores.copy(), []
    for _ in range(most):
        upto = np.concatenate(([0.0], np.cumsum(left)))
        rise = upto - np.minimum.accumulate(upto)
        last = int(np.argmax(rise))
        if not rise[last] > 0:
            break
        first = int(np.argmin(upto[:last]))
        found.append((first, last - 1))
        left[first:last] = -float(np.abs(scores).sum())  # so that no other run pays to hold it
    return found


def seconds_by_cause(attribution: Attribution) -> dict[EnergyCause, float]:
    """For how long (s) what belongs to each cause went on."""
    total: dict[EnergyCause, float] = {}
    for leg in attribution.legs:
        lasted_s = np.diff(leg.leg.motion.time_ns[leg.committed.sample]) * NS
        for cause, over_s in zip(leg.committed.causes, lasted_s.tolist(), strict=True):
            total[cause] = total.get(cause, 0.0) + over_s
    return total
