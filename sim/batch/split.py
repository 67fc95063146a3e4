"""What advice saves against none, split by what saves it: the parts of paired runs, which sum to the difference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.drivers.kinds import FOLLOWED_EXACTLY, DriverKind, Presentation

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
    """The savings of every presentation over none, for each scenario and driver that has both; failed runs left out."""
    good = {_key(row): row for row in rows if row.get("error") is None}
    kinds = dict.fromkeys(key[:3] for key in good if key[2] != Presentation.NONE)
    found = (_saving(good, *kind) for kind in kinds)
    return [one for one in found if one is not None]


def _key(row: Row) -> tuple[str, str, str, int]:
    return row["scenario"], row["driver"], row["advice"], row["seed"]


def _saving(
    good: Mapping[tuple[str, str, str, int], Row], scenario: str, driver: str, advice: str
) -> SplitSaving | None:
    """The saving of one presentation; None where no seed was driven without advice as well."""
    seeds = [key[3] for key in good if key[:3] == (scenario, driver, advice)]
    seeds = [seed for seed in seeds if (scenario, driver, Presentation.NONE, seed) in good]
    if not seeds:
        return None

    def column(name: str, driver: str, advice: str) -> Any:
        return np.array([good[scenario, driver, advice, seed][name] for seed in seeds])

    def less(name: str) -> Any:
        return column(name, driver, Presentation.NONE) - column(name, driver, advice)

    saved = less("energy_kwh")
    spread = float(saved.std(ddof=1)) if len(seeds) > 1 else float("nan")
    profile, tracking = float(less("energy_profile_kwh").mean()), None
    followed = driver != DriverKind.PERFECT and advice in FOLLOWED_EXACTLY
    if followed and all((scenario, DriverKind.PERFECT, advice, seed) in good for seed in seeds):
        lost = column("energy_profile_kwh", driver, advice) - column("energy_profile_kwh", DriverKind.PERFECT, advice)
        tracking = -float(lost.mean())
        profile -= tracking
    return SplitSaving(
        scenario=scenario, driver=driver, advice=advice, pairs=len(seeds),
        baseline_kwh=float(column("energy_kwh", driver, Presentation.NONE).mean()),
        saved_kwh=float(saved.mean()),
        interval_kwh=NORMAL_95 * spread / len(seeds) ** 0.5,
        time_shift_kwh=float(less("energy_hindsight_kwh").mean()),
        blending_kwh=float(less("energy_blending_kwh").mean()),
        profile_kwh=profile, tracking_kwh=tracking,
    )  # fmt: skip
