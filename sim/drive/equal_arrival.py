"""How much more energy a drive took than another one at equal arrival, and how much of a difference advice saved.

At equal arrival: the difference of the energies, less the difference of the optima for the times of both drives. The
latter is what the times are worth: the time difference at λ, the optimum's price of time, integrated over it
(λ = −dE*/dT). It is the difference of the energies above the optimum.

Saved by advice: two drives of the same day by the same driver with the same brakes, one of them without advice, at
equal arrival. Where no such two drives exist, nothing is stated.

Both are in % of the optimum for the times as driven, as the energy above the optimum is; of two drives, that is the
mean of both optima, so that a kWh is the same share whichever drive comes first.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from das.domain.units import kwh, kwh_words
from sim.drive.above_optimum import NOT_COMPARABLE, AboveOptimum, energy_words
from sim.drive.drive import Drive
from sim.drivers.kinds import DriverKind, FrictionPolicy, Presentation

ELECTRIC_FIRST: Final = "motors first"
"""The brakes of estimates and of all drivers of the simulator but the human one."""
SAME_BRAKES: Final = {
    True: "Both energies are those of the simulated train, with the same habit of braking.",
    False: "Both energies are estimates for the planned train: its mass, resistance, wind and brakes are not known.",
}
"""Conditions of a difference if both drives have the same brakes; the key tells whether their energy was measured."""
OTHER_BRAKES: Final = (
    "The brakes or the sources of the energies differ, so that both are estimates for the planned train with motors "
    "that brake first; neither includes friction braking."
)
"""Conditions of a difference if the drives have other brakes."""


def run_of(drive: Drive) -> Mapping[str, str]:
    """The metadata of a simulated run; empty for any other drive."""
    run = drive.table.run
    return run if run.get("kind") == "run" else {}


def brakes_of(drive: Drive) -> str:
    """The brakes that a drive was driven or estimated with, and whether its energy was measured, in words."""
    run = run_of(drive)
    if not drive.energy.measured:
        known = any(leg.motion.friction_j is not None for leg in drive.energy.legs)
        return f"estimated, {'brake forces as recorded' if known else ELECTRIC_FIRST}"
    driver, policy = run.get("driver", ""), run.get("friction_policy", "")
    if driver != DriverKind.HUMAN:
        return ELECTRIC_FIRST if driver in list(DriverKind) else f"those of the driver {driver}"
    if policy == FrictionPolicy.BY_ADVICE:
        return f"{policy}, shown {run.get('advice')}"
    return ELECTRIC_FIRST if policy == FrictionPolicy.ELECTRIC_FIRST else policy


def same_brakes(drives: Sequence[Drive]) -> bool:
    """Whether the energies of drives have the same source, with the same brakes."""
    return len({brakes_of(one) for one in drives}) == 1


@dataclass(frozen=True, kw_only=True)
class EqualArrival:
    """How much more energy a drive took than the first one at equal arrival (J); None if that cannot be stated.

    `times_j` is what the times are worth: how much more the optimum takes in the times of the drive than in those of
    the first. `ratio` is the share of the optimum, the mean for the times of both. `hangs_on` says what the figure
    depends on.
    """

    more_j: float | None
    times_j: float | None
    ratio: float | None
    hangs_on: str
    why_not: str = ""

    @classmethod
    def of(cls, first: Drive, other: Drive, *, own: bool) -> EqualArrival:
        """Compare two drives by their own energies or, if their brakes differ, by those of motors that brake first."""
        hangs_on = SAME_BRAKES[first.energy.measured] if own else OTHER_BRAKES
        before, after = ((one.energy.above if own else one.energy.motors_first) for one in (first, other))
        if before is None or after is None:
            why_not = first.energy.not_comparable or other.energy.not_comparable
        else:
            why_not = (
                _trains_differ(first, other, own=own) or before.why_not or after.why_not or _stops_differ(before, after)
            )
        if why_not or before is None or after is None:
            return cls(more_j=None, times_j=None, ratio=None, hangs_on=hangs_on, why_not=why_not)
        times_j = after.optimum_j - before.optimum_j
        more_j = after.driven_j - before.driven_j - times_j
        optimum_j = 0.5 * (before.optimum_j + after.optimum_j)
        ratio = more_j / optimum_j if optimum_j > 0 else None
        return cls(more_j=more_j, times_j=times_j, ratio=ratio, hangs_on=hangs_on)

    def as_dict(self) -> dict[str, float | str | None]:
        """The figures for programs (kWh, share of the optimum)."""
        return {
            "more_energy_equal_arrival_kwh": _kwh(self.more_j),
            "more_energy_equal_arrival_ratio": self.ratio,
            "times_worth_kwh": _kwh(self.times_j),
            "equal_arrival_not_comparable": self.why_not or None,
            "hangs_on": self.hangs_on,
        }

    def sentence(self, first: str) -> str:
        """The figures in words; `first` is the name of the first drive."""
        if self.more_j is None or self.times_j is None:
            return f"At equal arrival: {NOT_COMPARABLE}: {self.why_not}."
        return (
            f"At equal arrival, against {first}: {energy_words(self.more_j, self.ratio)}; the time difference is worth "
            f"{kwh_words(self.times_j, signed=True)} at the optimum's price of time."
        )


def _kwh(energy_j: float | None) -> float | None:
    return None if energy_j is None else kwh(energy_j)


def _trains_differ(first: Drive, other: Drive, *, own: bool) -> str:
    trains = [
        (one.table.inputs.vehicle.id, one.table.inputs.vehicle.mass_kg, one.table.inputs.level)
        for one in (first, other)
    ]
    same = trains[0] == trains[1] and (not own or _drawn(first).get("truth") == _drawn(other).get("truth"))
    return "" if same else "the trains differ"


def _drawn(drive: Drive) -> dict[str, Any]:
    drawn = json.loads(run_of(drive).get("drawn", "{}"))
    return drawn if isinstance(drawn, dict) else {}


def _stops_differ(before: AboveOptimum, after: AboveOptimum) -> str:
    stops = [[(section.start, section.end) for section in one.sections] for one in (before, after)]
    return "" if stops[0] == stops[1] else "they did not stop at the same stops"


DAY: Final = ("scenario_sha256", "seed", "route_sha256", "vehicle_sha256", "loss_map_sha256", "level")
"""Metadata that two drives of the same day share."""
DRIVER: Final = ("driver", "driver_sha256")
"""Metadata that two drives by the same driver share."""


def why_not_saved(first: Drive, other: Drive) -> str:
    """Why two drives do not tell what advice saved, in words; empty if they do."""
    runs = run_of(first), run_of(other)
    if not all(runs):
        return "this needs two simulated runs with the same disturbances, one of them without advice"
    if _apart(runs, DAY) or _day(first) != _day(other):
        return "the days differ"
    if _apart(runs, DRIVER) or _drawn(first).get("human") != _drawn(other).get("human"):
        return "the drivers differ"
    if not same_brakes((first, other)):
        return "the brakes differ"
    if sum(run.get("advice") == Presentation.NONE for run in runs) != 1:
        return "exactly one of them must be driven without advice"
    return ""


def _apart(runs: Sequence[Mapping[str, str]], keys: Sequence[str]) -> bool:
    return any(runs[0].get(key) != runs[1].get(key) for key in keys)


def _day(drive: Drive) -> tuple[Any, ...]:
    """What the seed drew for the day, and what a what-if changed of it."""
    drawn, kept = _drawn(drive), json.loads(run_of(drive).get("what_if_kept", "{}"))
    return drawn.get("disturbances"), drawn.get("truth"), {key: value for key, value in kept.items() if value}


@dataclass(frozen=True, kw_only=True)
class SavedByAdvice:
    """The energy that advice saved at equal arrival (J), and its share of the optimum.

    Both are None if that cannot be stated, for the reason `why_not`.
    """

    saved_j: float | None
    ratio: float | None
    why_not: str

    @classmethod
    def of(cls, first: Drive, other: Drive) -> SavedByAdvice:
        """What advice saved, by two drives of which one was driven without advice."""
        why_not = why_not_saved(first, other)
        if not why_not:
            alone, advised = (first, other) if run_of(first)["advice"] == Presentation.NONE else (other, first)
            found = EqualArrival.of(alone, advised, own=True)
            if found.more_j is not None:
                return cls(saved_j=-found.more_j, ratio=None if found.ratio is None else -found.ratio, why_not="")
            why_not = found.why_not
        return cls(saved_j=None, ratio=None, why_not=why_not)

    def as_dict(self) -> dict[str, float | str | None]:
        """The figures for programs (kWh, share of the optimum)."""
        return {
            "saved_by_advice_kwh": _kwh(self.saved_j),
            "saved_by_advice_ratio": self.ratio,
            "saved_by_advice_not_comparable": self.why_not or None,
        }

    @property
    def sentence(self) -> str:
        """The figures in words."""
        if self.saved_j is None:
            return f"Saved by advice: {NOT_COMPARABLE}: {self.why_not}."
        words = energy_words(self.saved_j, self.ratio)
        return f"Saved by advice: {words}, at equal arrival."
