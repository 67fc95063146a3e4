"""Skills for own drivers: what a setting does to a train that moves by itself, notches, delays and noise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from das.domain.errors import DasError
from das.domain.files.load import load_route, load_vehicle
from docs.examples.weak_drivers import LOOK_S, Late
from sim.drivers.cab import CabView
from sim.drivers.knowledge import LineKnowledge
from sim.drivers.skills import NotchedLever, Skills, WanderingError
from sim.plant.plant import Plant, lever

LINE = LineKnowledge(route=load_route("flat-6km"), vehicle=load_vehicle("re460-ic"))


def cab(s_m: float, speed_mps: float, time_s: float = 0.0, signal_m: float = math.inf) -> CabView:
    return CabView(
        time_s=time_s, s_m=s_m, speed_mps=speed_mps, limit_mps=160 / 3.6, stop_m=6000.0, departure_s=-1.0,
        arrival_s=300.0, signal_m=signal_m,
    )  # fmt: skip


def driven(s_m: float, speed_mps: float, setting: object, until: object) -> tuple[float, float]:
    """Drive with a skill until it says so; the place (m) and the speed (m/s) then."""
    skills, plant = Skills(LINE), Plant(LINE.route, LINE.vehicle)
    state = plant.at(s_m, speed_mps)
    for _ in range(2000):
        skills.see(cab(state.s_m, state.speed_mps, state.time_s))
        if until(state):
            break
        state = plant.advance(state, lever(setting(skills)), LOOK_S)
    return state.s_m, state.speed_mps


def test_a_speed_is_held() -> None:
    _, speed_mps = driven(1000.0, 28.0, lambda skills: skills.hold(30.0), lambda state: state.time_s > 60.0)
    assert speed_mps == pytest.approx(30.0, abs=0.1)


def test_braking_to_a_speed_begins_in_time_and_ends_there() -> None:
    begun: list[float] = []

    def setting(skills: Skills) -> float:
        braking = skills.brake_to(20.0, 3000.0)
        if braking is not None:
            begun.append(skills.cab.s_m)
        return skills.hold(30.0) if braking is None else braking

    _, speed_mps = driven(1000.0, 30.0, setting, lambda state: state.s_m >= 3000.0)
    assert speed_mps == pytest.approx(20.0, abs=0.5)
    assert 3000.0 - begun[0] == pytest.approx((30.0**2 - 20.0**2) / 2 / 0.5 / 0.85, abs=10.0)
    assert Skills(LINE).see(cab(1000.0, 15.0)).brake_to(20.0, 1100.0) is None
    assert Skills(LINE).see(cab(1200.0, 25.0)).brake_to(20.0, 1100.0) < 0, "beyond the place he brakes as planned"


def test_a_train_is_stopped_at_a_mark() -> None:
    def setting(skills: Skills) -> float:
        stopping = skills.stop_at(3000.0)
        return 0.0 if stopping is None else stopping

    s_m, speed_mps = driven(2900.0, 9.5, setting, lambda state: state.speed_mps <= 0)
    assert speed_mps == 0
    assert s_m == pytest.approx(3000.0, abs=1.0)


def test_what_is_allowed_at_most_keeps_the_limit_and_stops_before_a_signal() -> None:
    s_m, speed_mps = driven(5000.0, 40.0, lambda skills: min(1.0, skills.most()), lambda state: state.speed_mps <= 0)
    assert (s_m, speed_mps) == (pytest.approx(6000.0, abs=5.0), 0.0)
    skills = Skills(LINE)
    assert skills.see(cab(2000.0, 30.0)).most() > 0 > skills.see(cab(2000.0, 30.0, signal_m=2500.0)).most()
    assert skills.halt_in_m == pytest.approx(485.0)


def test_what_was_seen_comes_late() -> None:
    late = Late(1.0, "nothing")
    assert [late.seen(str(look)) for look in range(7)] == ["nothing"] * 5 + ["0", "1"]


def test_noise_wanders_by_its_seed_and_spread() -> None:
    noise = WanderingError(1, deviation=2.0, correlation_s=5.0)
    times = LOOK_S * np.arange(200_000)
    values = np.array([noise.at(time_s) for time_s in times])
    assert values.std() == pytest.approx(2.0, rel=0.05)
    assert values.mean() == pytest.approx(0.0, abs=0.1)
    lag = round(5.0 / LOOK_S)
    assert np.corrcoef(values[:-lag], values[lag:])[0, 1] == pytest.approx(math.exp(-1.0), abs=0.05)
    again = WanderingError(1, deviation=2.0, correlation_s=5.0)
    assert [again.at(time_s) for time_s in times[:50]] == values[:50].tolist()
    assert WanderingError(2, deviation=2.0, correlation_s=5.0).at(0.0) != values[0]


def test_a_lever_without_notches_is_refused() -> None:
    with pytest.raises(DasError, match=r"NotchedLever: count = 0: expected at least one notch"):
        NotchedLever(0)
