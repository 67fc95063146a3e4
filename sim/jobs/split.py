"""What advice saves against none, split by what saves it: the parts of paired runs, which sum to the difference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sim.drivers.kinds import DriverKind, Presentation
from sim.drivers.presentations.presenter import presenter_of

Row = Mapping[str, Any]
NORMAL_95 = 1.96


@dataclass(frozen=True, kw_only=True)
class SplitSaving:
    """What a presentation saves against no advice, in kWh: means over the seeds that both have.

    `time_shift`: the optimum of the baseline's times is higher. `blending`: less friction where the motors could brake.
    `profile`: a better speed profile, as it was driven; where a perfect driver, who follows vector and coach, drove the
    same days, it is the profile of the advice alone, and `tracking` (mostly < 0) is what the driver lost by not keeping
    to it. The parts sum to `saved`, whose 95 % interval over the pairs is ± `interval` (normal).
    """

    scenario: str
    driver: str
    advice: str
    pairs: int
    baseline_kwh: float
    saved_kwh: float
    interval_kwh: float
    time_shift_kwh: float
    blending_kwh: float
    profile_kwh: float
    tracking_kwh: float | None

    def as_dict(self) -> dict[str, Any]:
        """The fields, for programs."""
        return dict(vars(self))


def savings(rows: Sequence[Row]) -> list[SplitSaving]:
    """The savings of every presentation over none, for each scenario and driver that has both; failed runs left out.

    A pair is the same day with the same person (column `participant`, where there is one).
    """
    good: dict[tuple[str, str, str], dict[_Pair, Row]] = {}
    for row in rows:
        if row.get("error") is None:
            runs = good.setdefault((row["scenario"], row["driver"], row["advice"]), {})
            runs[_Pair(row["seed"], row.get("participant"))] = row
    found = (_saving(good, *kind) for kind in good if kind[2] != Presentation.NONE)
    return [one for one in found if one is not None]


class _Pair(NamedTuple):
    """What two runs that are compared have in common: the day and the person."""

    seed: int
    participant: int | None


def _saving(
    good: Mapping[tuple[str, str, str], Mapping[_Pair, Row]], scenario: str, driver: str, advice: str
) -> SplitSaving | None:
    """The saving of one presentation; None where no day was driven without advice as well."""
    advised, alone = good[scenario, driver, advice], good.get((scenario, driver, Presentation.NONE), {})
    pairs = [pair for pair in advised if pair in alone]
    if not pairs:
        return None

    def less(name: str) -> Any:
        return np.array([alone[pair][name] - advised[pair][name] for pair in pairs])

    saved = less("energy_kwh")
    spread = float(saved.std(ddof=1)) if len(pairs) > 1 else float("nan")
    profile, tracking = float(less("energy_profile_kwh").mean()), None
    followable = presenter_of(Presentation(advice)).follower() is not None
    exact = good.get((scenario, DriverKind.PERFECT, advice), {}) if followable else {}
    followed = {pair.seed: row for pair, row in exact.items()}
    if driver != DriverKind.PERFECT and all(pair.seed in followed for pair in pairs):
        lost = [advised[pair]["energy_profile_kwh"] - followed[pair.seed]["energy_profile_kwh"] for pair in pairs]
        tracking = -float(np.mean(lost))
        profile -= tracking
    return SplitSaving(
        scenario=scenario, driver=driver, advice=advice, pairs=len(pairs),
        baseline_kwh=float(np.mean([alone[pair]["energy_kwh"] for pair in pairs])),
        saved_kwh=float(saved.mean()),
        interval_kwh=NORMAL_95 * spread / len(pairs) ** 0.5,
        time_shift_kwh=float(less("energy_hindsight_kwh").mean()),
        blending_kwh=float(less("energy_blending_kwh").mean()),
        profile_kwh=profile, tracking_kwh=tracking,
    )  # fmt: skip
