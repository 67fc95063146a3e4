"""Worth designs of a short line, invented trials of a worth study, and an analysis of trials.csv that shares no code
with the program."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from sim.experiment.design import freeze
from sim.experiment.study_files import TRIALS_TABLE, trials_table
from sim.experiment.trials import trials_of
from sim.experiment.worth.study import WorthDesign

Floats = NDArray[np.float64]
DESIGN = """
schema_version = 1
[worth]
name = "short"
title = "Six flat kilometres"
scenario = "flat-6km"
drivers = 4
[inputs]
price_eur_per_kwh = {value = 0.2, low = 0.1, high = 0.3, source = "made up"}
co2_g_per_kwh = {value = 100, low = 100, high = 100, source = "made up"}
trains_per_day = {value = 10, low = 10, high = 12, source = "made up"}
days_per_year = {value = 300, low = 300, high = 300, source = "made up"}
followers_ratio = {value = 0.8, low = 0.5, high = 1.0, source = "made up"}
receptivity_ratio = {value = 1.0, low = 1.0, high = 1.0, source = "made up"}
haste_ratio = {value = 0.5, low = 0.5, high = 0.5, source = "made up"}
electric_brake_ratio = {value = 0.6, low = 0.6, high = 1.0, source = "made up"}
"""


def write_trials(worth: WorthDesign, folder: Path, energy: Callable[[str, np.random.Generator], float]) -> Path:
    """Write the study of a worth design as if its trials had been driven; `energy` invents the energy of a case."""
    design, random = worth.study, np.random.default_rng(5)
    trials = trials_of(design)
    invented = {}
    for trial in trials:
        kwh = energy(trial.levels[0], random)
        optimum, late_s = 48.0 + 0.1 * random.normal(), float(random.normal(-30.0, 30.0))
        invented[trial.number] = dict.fromkeys(design.measures, 0.0) | {
            "energy_kwh": kwh,
            "energy_optimum_kwh": optimum,
            "energy_at_equal_arrival_kwh": kwh - optimum + 50.0,
            "above_optimum_kwh": kwh - optimum,
            "late_s": late_s,
        }
    freeze(design, folder)
    (folder / TRIALS_TABLE).write_bytes(trials_table(design, trials, invented))
    return folder


def own_steps(folder: Path, value: Mapping[str, float]) -> list[dict[str, Any]]:
    """The five steps from trials.csv alone, with inputs by key: saved energy and half its interval (kWh a train), the
    ratio, punctuality before and after, and the money of a year (EUR)."""
    with (folder / "trials.csv").open(newline="", encoding="utf-8") as file:
        rows = {(row["case"], row["participant"]): row for row in csv.DictReader(file)}
    who = sorted({name for _, name in rows})

    def column(case: str, name: str) -> Floats:
        cells = [rows.get((case, one), {}).get(name, "") for one in who]
        return np.array([float(cell) if cell else np.nan for cell in cells])

    def equal(case: str) -> Floats:
        return np.where(
            np.isnan(column(case, "above_optimum_kwh")), np.nan, column(case, "energy_at_equal_arrival_kwh")
        )

    def optimum(case: str) -> Floats:
        return equal(case) - column(case, "energy_kwh") + column(case, "energy_optimum_kwh")

    share = value["followers_ratio"]
    energy = "energy_kwh"
    plan = [
        (column("all-out", energy), optimum("all-out"), "all-out", None, 1.0),
        (column("all-out", energy), column("obedient", energy), "all-out", "obedient", 1.0),
        (column("today", energy), column("today-guided", energy), "today", "today-guided", share),
        (equal("today"), equal("today-guided"), "today", "today-guided", share),
        (equal("in-time"), equal("in-time-guided"), "in-time", "in-time-guided", share),
    ]
    found = []
    for used, advised, before, after, part in plan:
        saved = used - advised
        known = np.isfinite(saved)
        n = int(known.sum())
        late = [column(before, "late_s")[known], np.zeros(n) if after is None else column(after, "late_s")[known]]
        times = [[x.mean(), np.mean(x <= 0), np.mean(x <= 60)] for x in late]
        half = stats.t.ppf(0.975, n - 1) * saved[known].std(ddof=1) / np.sqrt(n)
        trains = value["trains_per_day"] * value["days_per_year"]
        found.append(
            {
                "saved_kwh": part * saved[known].mean(),
                "interval_kwh": part * half,
                "saved_ratio": part * saved[known].mean() / used[known].mean(),
                "before": times[0],
                "after": [(1 - part) * a + part * b for a, b in zip(*times, strict=True)],
                "eur": part * saved[known].mean() * trains * value["price_eur_per_kwh"],
            }
        )
    return found
