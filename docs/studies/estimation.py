"""Errors of on-board localisation and calibration, found on simulated drives with known true values.

`python -m docs.studies.estimation` writes localisation.md and calibration.md, the tables of the pages with these names,
to the working folder. The drives are those of tests/das/estimate/test_calibration.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.domain.files.load import load_vehicle
from das.domain.units import NS
from das.estimate.estimate import PositionFix
from das.estimate.localisation import Localisation
from sim.plant.kernels import PlantState

Floats = NDArray[np.float64]
WANDER_S: Final = 30.0
"""Correlation time (s) of a receiver's error."""


class Noise(NamedTuple):
    """Standard deviations of a receiver's positions (m) and speeds (m/s), which the receiver also reports."""

    position_m: float
    speed_mps: float


NOISES: Final = (Noise(3.0, 0.05), Noise(8.0, 0.3))
SEEDS: Final = tuple(range(40))
"""Seeds of the receiver's noise: many, because an error correlated over 30 s has few independent values in a drive."""


def localisation_table(
    states: Sequence[PlantState], seeds: Sequence[int] = SEEDS, noises: Sequence[Noise] = NOISES
) -> Iterator[str]:
    """The lines of the table: root mean square errors while moving, as measured and as filtered."""
    yield "| noise | as measured | filtered | mean squared error of the position over the stated variance |"
    yield "|---|---:|---:|---:|"
    for noise in noises:
        found = np.concatenate([filtered_errors(states, noise, seed) for seed in seeds])
        raw_m, raw_mps, off_m, off_mps = np.sqrt(np.mean(found[:, :4] ** 2, axis=0))
        honest = np.mean((found[:, 2] / found[:, 4]) ** 2)
        yield (
            f"| {noise.position_m:g} m, {noise.speed_mps:g} m/s | {raw_m:.1f} m, {raw_mps:.3f} m/s | "
            f"{off_m:.1f} m, {off_mps:.3f} m/s | {honest:.2f} |"
        )


def filtered_errors(states: Sequence[PlantState], noise: Noise, seed: int) -> Floats:
    """Errors of position and speed, measured and filtered, and the stated deviation, for each second while moving."""
    localisation, random = Localisation(load_vehicle("re460-ic")), np.random.default_rng(seed)
    keep, wander_m, found = math.exp(-1.0 / WANDER_S), noise.position_m * random.standard_normal(), []
    for state in states:
        if state.speed_mps <= 0:
            continue
        fresh = random.standard_normal(2)
        wander_m = keep * wander_m + math.sqrt(1.0 - keep**2) * noise.position_m * fresh[0]
        fix = PositionFix(
            time_ns=round((1e9 + state.time_s) / NS), s_m=state.s_m + wander_m,
            speed_mps=max(state.speed_mps + noise.speed_mps * fresh[1], 0.0),
            uncertainty_m=noise.position_m, speed_uncertainty_mps=noise.speed_mps,
        )  # fmt: skip
        localisation.take(fix)
        at = localisation.at(fix.time_ns)
        raw = (fix.s_m - state.s_m, fix.speed_mps - state.speed_mps)
        found.append((*raw, at.s_m - state.s_m, at.speed_mps - state.speed_mps, at.position_sd_m))
    return np.array(found)


def calibration_table(relative: Callable[[], Floats]) -> Iterator[str]:
    """The lines of the table; `relative` gives errors as ratios (trains, seeds, early or end, mass or resistance)."""
    yield "| | mass: rms, largest error | resistance: rms, largest error |"
    yield "|---|---|---|"
    found = 100.0 * relative()
    rms, most = np.sqrt(np.mean(found**2, axis=1)), np.abs(found).max(axis=(0, 1))
    for moment, words in enumerate(("5 km after the start", "at the next stop (12, 17 km)")):
        cells = (
            f"{rms[:, moment, what].min():.1f} to {rms[:, moment, what].max():.1f} %, {most[moment, what]:.1f} %"
            for what in (0, 1)
        )
        yield f"| {words} | {' | '.join(cells)} |"


def main() -> None:
    """Write both tables."""
    from tests.das.estimate import test_calibration as drives

    tables = {
        "calibration.md": calibration_table(drives.all_errors),
        "localisation.md": localisation_table(drives.driven()),
    }
    for name, lines in tables.items():
        Path(name).write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")


if __name__ == "__main__":
    main()
