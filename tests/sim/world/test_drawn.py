"""What differs from the plan on the day: the true train, its losses, and who drives."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.domain.errors import DasError
from das.domain.files.load import load_vehicle, locate_vehicle
from das.domain.levels import Level
from das.domain.losses import LossMap
from sim.drivers.kinds import DriverKind, Presentation
from sim.drivers.parameters import HumanParameters
from sim.experiment.driving import drive
from sim.experiment.one_line import DaysAsked
from sim.experiment.trials import trials_of
from sim.world.in_process import InProcess
from sim.world.loop import Told, World
from sim.world.outcome import outcome
from sim.world.scenario import read_scenario
from sim.world.service import Day, lay_out, make_day, scenario_files
from tests.support.flat_days import service_of
from tests.support.making import das_sim


def day_of(path: Path, seed: int = 1) -> Day:
    return make_day(service_of(path), seed)


def figures(path: Path) -> dict[str, Any]:
    """What a perfect follower's run comes to."""
    day = day_of(path)
    run = World(day, day.driver(DriverKind.PERFECT), Presentation.SPEED_AND_EFFORT, InProcess(day.service)).run()
    return outcome(day, run).as_dict()


def write_map(path: Path, times: float, every: tuple[int, int] = (1, 1)) -> None:
    """The bundled train's map with all losses multiplied; `every`: so many steps of speed and force are one."""
    loss_map = load_vehicle("re460-ic").loss_model(Level.L3)
    assert isinstance(loss_map, LossMap)
    table = times * loss_map.filled_w
    speeds, forces = (range(0, size, step) for size, step in zip(table.shape, every, strict=True))
    rows = [
        f"{loss_map.speed_mps[i] * 3.6},{loss_map.force_n[j] / 1e3},{table[i, j] / 1e3}" for i in speeds for j in forces
    ]
    path.write_text("\n".join(["speed_kmh,force_kn,loss_kw", *rows]) + "\n")


@pytest.mark.slow
def test_another_loss_map_costs_what_it_says_and_moves_nothing(flat: Callable[[str], Path]) -> None:
    """Losses do not act on the wheels, and nobody on board sees them: only the energy is another."""
    path = flat("[truth]\nloss_map = 'worn.csv'")
    write_map(path.parent / "worn.csv", 1.2)
    planned, worn = figures(flat("")), figures(path)
    assert worn["running_time_s"] == planned["running_time_s"]
    assert worn["resistance_kwh"] == planned["resistance_kwh"]
    assert worn["component_loss_kwh"] == pytest.approx(1.2 * planned["component_loss_kwh"], rel=1e-6)
    assert worn["energy_planned_kwh"] == planned["energy_planned_kwh"]


def test_the_true_losses_may_be_of_another_level(flat: Callable[[str], Path]) -> None:
    """The plan believes in L3, the train loses nothing."""
    dreamt = figures(flat("[truth]\nlevel = 'l0-reg'"))
    assert dreamt["component_loss_kwh"] < 0.2 * figures(flat(""))["component_loss_kwh"]
    assert dreamt["level"] == "l3"


def test_another_true_train(flat: Callable[[str], Path]) -> None:
    day = day_of(flat("[truth]\nvehicle = 're460-ic-igbt'\nmass_percent = 110"))
    igbt = load_vehicle("re460-ic-igbt")
    assert day.plant.vehicle.mass_kg == pytest.approx(1.1 * igbt.mass_kg)
    assert day.plant.vehicle.id == igbt.id
    assert day.service.vehicle.id == "re460-ic"


def test_a_true_train_from_a_file_beside(flat: Callable[[str], Path]) -> None:
    path = flat("[truth]\nvehicle = 'mine.toml'")
    mine = path.parent / "mine.toml"
    mine.write_text(locate_vehicle("re460-ic").read_text().replace("mass_t = 440.0", "mass_t = 840.0"))
    assert day_of(path).plant.vehicle.mass_kg > 1.5 * day_of(path).service.vehicle.mass_kg
    assert scenario_files(read_scenario(path))["true_vehicle"] == mine


BAD = [
    ("[truth]\nloss_map = 'no.csv'", "truth.loss_map = .*no.csv': no such file"),
    ("[truth]\nloss_map = 3", "truth.loss_map = 3: expected a string"),
    ("[truth]\nvehicle = 'nothing'", "nothing: not a bundled vehicle"),
    ("[truth]\nload = 'heavy'", "no load 'heavy'"),
    ("[truth]\nlevel = 'l9'", "truth.level = 'l9': expected one of l0"),
    ("[truth]\nlevel = 'l1'\nloss_map = 'x.csv'", "truth.level = 'l1': expected l3"),
    ("[truth]\nmass_percent = {min = 0, max = 100}", "toml: truth.mass_percent = .*}: expected a number from 1 to"),
    ("[human]\nglance_s = 3", "human.glance_s = 3: expected one of the keys"),
    ("[human]\nglance_mean_s = 99", "toml: human.glance_mean_s = 99.0: expected 0.2 to 60 s"),
    ("[human]\nglance_mean_s = {min = 3, max = 99}", "human.glance_mean_s = 99"),
    ("[human]\nglance_mean_s = {min = 2, max = 5}\nglance_least_s = {min = 1, max = 3}", "at least glance_least_s"),
    ("[human]\nnotches = 2.5", "human.notches = 2.5: expected a whole number"),
    ("[human]\nnotches = {min = 2, max = 5}", "expected one whole number"),
    ("[human]\ntrips = -1", "human.trips = -1"),
    ("[human]\ntrips = nan", "human.trips = nan"),
]


@pytest.mark.parametrize(("more", "message"), BAD)
def test_what_cannot_be_is_refused(flat: Callable[[str], Path], more: str, message: str) -> None:
    with pytest.raises(DasError, match=message) as error:
        lay_out(read_scenario(flat(more)))
    assert "\n" not in str(error.value)


def test_every_seed_draws_its_driver(flat: Callable[[str], Path]) -> None:
    path = flat("[human]\nglance_mean_s = {min = 3, max = 15}\nnotches = 8\ntrips = 20")
    drawn = [day_of(path, seed).human for seed in range(40)]
    glances = np.array([human.glance_mean_s for human in drawn])
    assert 3 <= glances.min() < 5
    assert 13 < glances.max() <= 15
    assert day_of(path, 7).human == drawn[7]
    assert drawn[0] == replace(HumanParameters(), glance_mean_s=drawn[0].glance_mean_s, notches=8).after(20)


def test_the_driver_of_the_scenario_drives(flat: Callable[[str], Path]) -> None:
    """With four notches the controller knows nine settings."""

    class Ear(InProcess):
        def tell(self, now_ns: int, told: Told) -> None:
            settings.add(told.command.value)

    settings: set[float] = set()
    day = day_of(flat("[human]\nnotches = 4"))
    World(day, day.driver(DriverKind.HUMAN), Presentation.SPEED_AND_EFFORT, Ear(day.service)).run()
    assert len(settings) > 3
    assert settings <= {n / 4 for n in range(-4, 5)}


@pytest.mark.slow
def test_a_trial_and_a_run_drew_the_same(flat: Callable[[str], Path], tmp_path: Path) -> None:
    path = flat(
        "[human]\nreaction_median_s = {min = 1, max = 4}\ntrips = 3\n"
        "[truth]\nresistance_ratio = {min = 0.9, max = 1.2}\n"
        "[[disturbances]]\nkind = 'dwell-overrun'\nstop = 'A'\ndelay_s = 7"
    )
    asked = DaysAsked(
        scenarios=[str(path)],
        drivers=[DriverKind.HUMAN, DriverKind.PERFECT],
        advice=[Presentation.SPEED_AND_EFFORT],
        seeds=[5],
    )
    trials = trials_of(asked.design())
    human, perfect = (drive(trial, asked.population).day.drawn for trial in trials)
    expected = day_of(path, 5).drawn
    assert human == perfect == expected
    assert expected["disturbances"] == [{"kind": "dwell-overrun", "stop": "A", "delay_s": 7.0}]
    assert 0.9 <= expected["truth"]["resistance_ratio"] <= 1.2
    done = das_sim("run", str(path), "--seed", "5", "--in-process", "--json", cwd=tmp_path)
    assert json.loads(done.stdout)["drawn"] == expected
    shown = das_sim("run", str(path), "--seed", "5", "--in-process", cwd=tmp_path).stdout
    assert f"the driver: reaction_median_s {expected['human']['reaction_median_s']:.4g}, trips 3" in shown
    assert f"the true train: resistance_ratio {expected['truth']['resistance_ratio']:.4g}" in shown
    assert "disturbances: dwell at A 7 s longer" in shown


def test_every_seed_draws_its_truth(flat: Callable[[str], Path]) -> None:
    path = flat("[truth]\nmass_percent = {min = 90, max = 110}\nhead_wind_kmh = {min = -18, max = 36}")
    days = [day_of(path, seed) for seed in range(40)]
    planned_kg = days[0].service.vehicle.mass_kg
    ratios = np.array([day.plant.vehicle.mass_kg / planned_kg for day in days])
    assert 0.9 <= ratios.min() < 0.93
    assert 1.07 < ratios.max() <= 1.1
    winds = [day.drawn["truth"]["head_wind_mps"] for day in days]
    assert -5 <= min(winds) < -3
    assert 8 < max(winds) <= 10
    assert day_of(path, 3).drawn == days[3].drawn
