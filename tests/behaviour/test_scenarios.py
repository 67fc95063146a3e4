"""What every bundled scenario is about, driven with the advisor in this process."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.advice.advice import Advice, Cause
from das.advice.display import VALID_FOR_S
from das.advice.regimes import BRAKES, TRACTION, Regime
from das.cab.heard import RestrictionsHeard
from das.domain.conditions import Conditions
from das.domain.restriction import Restriction
from das.domain.trajectory import PART_WORDS
from das.domain.units import KMH, NS, STANDARD_GRAVITY_MPS2, kwh
from das.estimate.estimate import STALE_AFTER_S
from sim.drivers.drivers import make_driver
from sim.drivers.kinds import DriverKind, Presentation
from sim.plant.kernels import adhesion_coefficient
from sim.plant.plant import Dynamics, Plant
from sim.world.disturbances import (
    AnnouncedRestriction,
    BusOutage,
    DelayOnTheWay,
    HeadWind,
    NodeRestart,
    SensorFault,
    SensorOutage,
    SignalStop,
    SlipperyRail,
    TrainAhead,
)
from sim.world.in_process import InProcess
from sim.world.loop import Run, Tick, Told, World
from sim.world.outcome import DayOutcome, DayResult, outcome, print_result
from sim.world.scenario import Drawn, Scenario, bundled_scenarios, load_scenario
from sim.world.service import Day, Service, make_day
from tests.support.crossing import few
from tests.support.flat_days import flat_day, service_for, service_of, signal_at

SEED = 1
STOPS = ("Zürich HB", "Thalwil", "Zug", "Luzern")
WHOLE = (0, 3)
WAYS = {
    "bus-outage": (0, 1),
    "clear-day": (1, 2),
    "departure-delay": (0, 2),
    "gps-dropouts": (2, 3),
    "node-restart": (0, 1),
    "restriction-ahead": (1, 2),
    "signal-stop": (2, 3),
}
"""The scenarios that the default run drives, each only between those of `STOPS` where it differs from a clear day."""
DELAY_SEED = 10
"""On this day the departure delay, 78 s, is one that can be made up in two sections."""
FROZEN_S = 800.0
"""The last fault of localisation begins so long after the departure from Zug, not at 1500 s."""
TRACKING_MPS = 0.4
"""A driver holds a speed to this."""
ROUNDED_KWH = 0.05 + 1e-9
"""A printed energy is rounded by at most this."""
FASTEST_S = 7.0
"""A real train, whose forces build up, is behind the plan's fastest run by less than this a section."""


class Witness(InProcess):
    """The advisor in this process, and everything that goes to and fro."""

    def __init__(self, service: Service, *, guide: bool = False) -> None:
        super().__init__(service, guide=guide)
        self.ticks: list[Tick] = []
        self.advices: list[Advice] = []
        self.told: list[Told] = []

    def exchange(self, tick: Tick) -> Advice:
        self.ticks.append(tick)
        self.advices.append(super().exchange(tick))
        return self.advices[-1]

    def restrictions(self) -> list[tuple[Tick, RestrictionsHeard]]:
        """Every tick at which restrictions are told, with them."""
        return [(tick, one) for tick in self.ticks for one in tick.told if isinstance(one, RestrictionsHeard)]

    def tell(self, now_ns: int, told: Told) -> None:
        self.told.append(told)


@dataclass(frozen=True)
class Driven:
    """A day, its run, and what was said on the way."""

    day: Day
    run: Run
    said: Witness
    figures: dict[str, Any] = field(default_factory=dict)
    found: DayOutcome | None = None

    def one(self, kind: type[Any]) -> Any:
        (found,) = self.day.of(kind)
        return found

    def array(self, name: str) -> np.ndarray:
        return np.array([getattr(state, name) for state in self.run.states])

    def late_s(self) -> list[float]:
        return [call.late_s for call in self.run.calls]

    def events(self) -> list[str]:
        return [event for told in self.said.told for event in told.events]


@cache
def planned() -> Service:
    """All bundled scenarios have the same line, train and timetable."""
    return service_for(load_scenario("clear-day"))


def between(name: str, way: tuple[int, int]) -> Scenario:
    """A bundled scenario of which only the sections between two of `STOPS` are driven."""
    whole, (first, last) = load_scenario(name), way
    assert whole.running_s is not None
    if way == WHOLE:
        return whole
    return replace(whole, from_stop=STOPS[first], to_stop=STOPS[last], running_s=whole.running_s[first:last])


def short(name: str, driver: str = "perfect") -> Driven:
    return driven_once(name, driver, "speed-and-effort", DELAY_SEED if name == "departure-delay" else SEED, WAYS[name])


def drive(name: str, driver: str = "perfect", advice: str = "speed-and-effort") -> Driven:
    return driven_once(name, driver, advice, SEED, WHOLE)


@cache
def driven_once(name: str, driver: str, advice: str, seed: int, way: tuple[int, int]) -> Driven:
    scenario = between(name, way)
    if name == "gps-dropouts" and way != WHOLE:
        *others, frozen = scenario.disturbances
        figures = {**frozen.figures, "from_s": Drawn(low=FROZEN_S, high=FROZEN_S)}
        scenario = replace(scenario, disturbances=(*others, replace(frozen, figures=figures)))
    service = planned().on(scenario) if way == WHOLE else service_for(scenario)
    return driven_day(make_day(service, seed), driver, advice, seed)


def driven_day(day: Day, driver: str, advice: str, seed: int = SEED) -> Driven:
    said = Witness(day.service, guide=advice == Presentation.GUIDE)
    run = World(day, make_driver(DriverKind(driver), day.service.line, seed=seed), Presentation(advice), said).run()
    found = outcome(day, run)
    return Driven(day, run, said, found.as_dict(), found)


def fastest_late_s(driven: Driven, section: int) -> float:
    """How late the section's fastest run would arrive after the departure as it was."""
    service, (left, due) = driven.day.service, driven.run.calls[section : section + 2]
    return service.fronts[section].fastest().time_s - (due.due_arrival_ns - left.departed_ns) * NS


def test_all_bundled_scenarios_share_what_the_tests_solve_once() -> None:
    assert len(bundled_scenarios()) == 12
    for name in bundled_scenarios():
        one = load_scenario(name)
        assert one.id == name
        assert planned().plans(one)
    assert not planned().plans(replace(load_scenario("clear-day"), dwell_s=61.0))


@pytest.mark.parametrize(
    "name",
    [
        *few(sorted(WAYS), ("signal-stop",), pytest.mark.slow),
        *few(sorted(bundled_scenarios().keys() - WAYS.keys()), ()),
    ],
)
def test_the_parts_of_the_end_table_sum_to_the_energy_that_it_prints(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    driven = short(name, "human" if name == "bus-outage" else "perfect") if name in WAYS else drive(name)
    assert driven.found is not None
    how = {"driver": DriverKind.PERFECT, "advice": Presentation.SPEED_AND_EFFORT, "happens": "", "drawn": {"truth": {}}}
    print_result(DayResult(outcome=driven.found, wall_s=1.0, **how))
    rows = re.findall(r"^│( *\S.*?) *│ *([-+]?[\d.]+) kWh│$", capsys.readouterr().out, re.MULTILINE)
    printed_kwh = {words.strip(): float(energy) for words, energy in rows}
    whole_kwh = printed_kwh["energy including stops, the sum of"]
    parts_kwh = [printed_kwh[words] for words in PART_WORDS.values()]
    assert sum(parts_kwh) == pytest.approx(whole_kwh, abs=ROUNDED_KWH * (len(parts_kwh) + 1))
    sections_kwh = printed_kwh["energy, departures to arrivals"] + printed_kwh["at stops on the way"]
    assert sections_kwh == pytest.approx(whole_kwh, abs=3 * ROUNDED_KWH)
    # And in `--json`, to the rounding of numbers.
    figures = driven.figures
    assert figures["energy_kwh"] + figures["energy_at_stops_kwh"] == pytest.approx(
        sum(figures[f"{part}_kwh"] for part in PART_WORDS), rel=1e-6
    )


# --- what every bundled scenario is about ------------------------------------------------------------------------


def test_clear_day_goes_as_planned() -> None:
    """The follower's train against the plan: arrivals within 2 s, energy within 0.5 %."""
    driven = short("clear-day")
    assert np.abs(driven.late_s()).max() <= 2.0
    assert driven.figures["energy_kwh"] == pytest.approx(driven.figures["energy_planned_kwh"], rel=1e-2)
    assert max(abs(call.stopping_error_m) for call in driven.run.calls) < 1.0
    assert driven.figures["ledger_residual_ratio"] < 1e-6
    assert driven.run.counts.withdrawn == driven.run.counts.unheard == driven.run.counts.above_limit == 0
    limits = np.array([told.cab.limit_mps for told in driven.said.told])
    assert (driven.array("speed_mps")[:-1] <= limits + TRACKING_MPS).all()


@pytest.mark.nightly
def test_half_the_step_changes_the_energy_little() -> None:
    service = planned()
    halved = Plant(service.route, service.vehicle, level=service.level, dynamics=Dynamics(step_s=0.025))
    day = replace(make_day(service, SEED), plant=halved)
    run = World(
        day, make_driver(DriverKind.PERFECT, service.line), Presentation.SPEED_AND_EFFORT, InProcess(service)
    ).run()
    energy_kwh = kwh(outcome(day, run).energies.above.driven_j)
    assert energy_kwh == pytest.approx(drive("clear-day").figures["energy_kwh"], rel=5e-4)


@pytest.mark.slow
def test_departure_delay_is_made_up_as_far_as_possible() -> None:
    driven = short("departure-delay")
    late_s = driven.late_s()
    assert 60 <= late_s[0] <= 181
    for section in range(2):
        # As soon as it can: the fastest run, until the delay is gone.
        assert max(fastest_late_s(driven, section), 0.0) - 2.0 <= late_s[section + 1]
        assert late_s[section + 1] <= max(fastest_late_s(driven, section), 0.0) + FASTEST_S
    assert late_s[1] > 10
    assert abs(late_s[-1]) <= 2.0
    planned_kwh = driven_once("clear-day", "perfect", "speed-and-effort", SEED, (0, 2)).figures["energy_kwh"]
    assert driven.figures["energy_kwh"] > planned_kwh


@pytest.mark.slow
def test_delay_on_the_way_is_known_to_the_driver_alone_and_made_up() -> None:
    driven = drive("delay-on-the-way")
    slow = driven.one(DelayOnTheWay)
    s_m, speed_mps = driven.array("s_m"), driven.array("speed_mps")
    within = (s_m >= slow.from_m) & (s_m <= slow.to_m + driven.day.service.vehicle.train_length_m)
    assert speed_mps[within].max() <= slow.speed_mps + TRACKING_MPS
    assert speed_mps[within].mean() > 0.9 * slow.speed_mps
    assert all(not told.restrictions for _, told in driven.said.restrictions())
    advised = [a.advised_speed_mps for a in driven.said.advices if slow.from_m < a.s_m < slow.to_m]
    assert np.nanmax(advised) > slow.speed_mps
    late_s = driven.late_s()
    assert late_s[2] > 20
    assert abs(late_s[3]) <= 2.0


def test_restriction_is_kept_by_the_driver_and_told_in_time() -> None:
    driven = short("restriction-ahead")
    one = driven.one(AnnouncedRestriction)
    s_m, speed_mps = driven.array("s_m"), driven.array("speed_mps")
    end_m = one.to_m + driven.day.service.vehicle.train_length_m
    within = (s_m >= one.from_m) & (s_m <= end_m)
    assert speed_mps[within].max() <= one.speed_mps + TRACKING_MPS
    assert speed_mps[s_m < one.from_m - 2_000].max() > one.speed_mps + 5
    told = driven.said.restrictions()
    assert told[0][0] is driven.said.ticks[0]  # at the first tick: a node must know that there are none
    none, (first, begun_m), (last, over_m) = [
        (heard.restrictions, driven.run.states[tick.number - 1].s_m) for tick, heard in told
    ]
    assert none == ((), driven.day.service.stops[0].position_m)
    assert first == (Restriction(one.from_m, one.to_m, one.speed_mps),)
    assert last == ()
    way_m = 60.0  # in a second
    assert one.from_m - one.announced_m <= begun_m <= one.from_m - one.announced_m + way_m
    assert end_m <= over_m <= end_m + way_m
    clear = short("clear-day").found
    assert clear is not None
    assert driven.figures["energy_kwh"] > kwh(clear.energies.above.sections[0].driven_j)


def test_restriction_is_kept_by_the_advice_from_the_tick_it_is_told() -> None:
    """The line's limit under the train and the temporary one, as this test reads them, above every advised speed."""
    driven = short("restriction-ahead")
    one, service = driven.one(AnnouncedRestriction), driven.day.service
    told_ns = next(tick.now_ns for tick, heard in driven.said.restrictions() if heard.restrictions)
    advices = [
        # The operator withdraws it when the tail has left it, which the estimate may learn a few metres later.
        a
        for a in driven.said.advices
        if a.time_ns >= told_ns and a.s_m <= one.to_m + service.vehicle.train_length_m - a.position_sd_m
    ]
    assert advices[0].time_ns == told_ns
    assert any(a.s_m > one.to_m for a in advices)
    for advice in advices:
        assert advice.mode is not Regime.NONE
        s_m, before_mps = advice.s_m, advice.advised_speed_mps
        for after_mps in advice.horizon_speed_mps:
            s_m, before_mps = s_m + 0.5 * (before_mps + after_mps), after_mps
            if one.from_m + 1 < s_m < one.to_m + service.vehicle.train_length_m - 1:
                assert after_mps <= one.speed_mps + 1e-6
        if advice.s_m > one.from_m:
            assert advice.advised_speed_mps <= advice.limit_mps <= one.speed_mps
    # Reduced in time: never is the train told that it is much too fast.
    assert all(advice.speed_mps <= advice.advised_speed_mps + 1.5 for advice in advices)


@pytest.mark.slow
def test_a_told_target_avoids_the_stop_at_the_signal_and_costs_less_than_stopping() -> None:
    driven = drive("train-ahead")
    ahead, service = driven.one(TrainAhead), driven.day.service
    s_m, speed_mps, time_s = (driven.array(name) for name in ("s_m", "speed_mps", "time_s"))
    in_sight_s = time_s[np.argmax(s_m >= ahead.at_m - ahead.seen_m)]
    assert ahead.clears_s <= in_sight_s <= ahead.clears_s + 6
    assert speed_mps[(s_m > 31_000) & (s_m < ahead.at_m)].min() > 10
    assert not any("danger" in event for event in driven.events())
    # The same signal, and nobody told of it: the train stops.
    scenario = load_scenario("train-ahead")
    (planned_one,) = scenario.disturbances
    near = {"low": ahead.seen_m + 1, "high": ahead.seen_m + 1}
    figures = {
        **planned_one.figures,
        "told_m": Drawn(**near),
        "clears_s": Drawn(low=ahead.clears_s, high=ahead.clears_s),
    }
    untold = replace(scenario, disturbances=(replace(planned_one, figures=figures),))
    day = make_day(service.on(untold), SEED)
    run = World(
        day, make_driver(DriverKind.PERFECT, service.line), Presentation.SPEED_AND_EFFORT, InProcess(day.service)
    ).run()
    slowest = min(state.speed_mps for state in run.states if 31_000 < state.s_m < ahead.at_m)
    assert slowest < 5 < speed_mps[(s_m > 31_000) & (s_m < ahead.at_m)].min()
    assert kwh(outcome(day, run).energies.above.driven_j) > driven.figures["energy_kwh"]
    assert run.calls[-1].late_s > driven.late_s()[-1] - 1.0


@pytest.mark.parametrize("driver", ["perfect", pytest.param("human", marks=pytest.mark.nightly)])
def test_signal_stop_stops_the_train_until_it_clears(driver: str) -> None:
    driven = short("signal-stop", driver)
    signal = driven.one(SignalStop)
    s_m, speed_mps, time_s = (driven.array(name) for name in ("s_m", "speed_mps", "time_s"))
    stands = (speed_mps <= 0) & (np.abs(s_m - signal.at_m) < 20)
    assert stands.sum() > 5
    assert (s_m[stands] <= signal.at_m + 10).all()
    seen_s = time_s[np.argmax(s_m >= signal.at_m - signal.seen_m)]
    passed_s = time_s[np.argmax(s_m > signal.at_m + 15)]
    assert time_s[stands][-1] >= seen_s + signal.clears_after_s - 1
    assert seen_s + signal.clears_after_s < passed_s < seen_s + signal.clears_after_s + 40
    assert [event for event in driven.events() if "signal" in event] == [
        "signal at km 42.0 at danger",
        "signal at km 42.0 clear",
    ]
    late_s = driven.late_s()[-1]
    assert max(fastest_late_s(driven, 0), 0.0) < late_s < signal.clears_after_s + 60


BRAKES_MPS2 = 0.2
"""A train that slows down by more than this brakes."""


@pytest.mark.slow
@pytest.mark.parametrize("advice", few(["guide", "speed-and-effort"], ("guide",), pytest.mark.slow))
def test_nobody_who_brakes_for_a_signal_or_stands_at_it_is_told_to_go_on(advice: str) -> None:
    """From 3 s after the driver begins to brake until the train moves; then the advice is there at once.

    On the flat line of 6 km.
    """
    driven = driven_day(flat_day(signal_at(3_000, 1_500)), "human", advice)
    signal, told, said = driven.one(SignalStop), driven.said.told, driven.said.advices
    speed_mps, slows_mps2 = driven.array("speed_mps")[:-1], -driven.array("acceleration_mps2")[:-1]
    stands = np.flatnonzero((speed_mps <= 0) & (np.abs(driven.array("s_m")[:-1] - signal.at_m) < 20))
    in_sight = next(k for k, one in enumerate(told) if one.cab.signal_m == signal.at_m)
    begins = in_sight + int(np.argmax(slows_mps2[in_sight:] > BRAKES_MPS2))
    moves = int(stands[-1]) + 1
    quiet = (Cause.DRIVER_BRAKES, Cause.STANDS_ON_LINE)
    for one in said[begins + 3 : moves]:
        shown = one.guide.now.mode if one.guide else one.mode
        assert shown in {Regime.NONE, Regime.COAST, *BRAKES}
        assert one.mode is not Regime.NONE or one.cause in quiet
    assert {said[k].cause for k in stands[1:]} == {Cause.STANDS_ON_LINE}
    assert said[moves + 2].mode in TRACTION


@pytest.mark.slow
def test_dwell_overrun_is_made_up_as_far_as_possible() -> None:
    driven = drive("dwell-overrun")
    zug = driven.run.calls[2]
    late_s = (zug.departed_ns - zug.due_arrival_ns) * NS - driven.day.service.scenario.dwell_s
    assert 40 <= late_s <= 121
    assert driven.late_s()[-1] <= max(fastest_late_s(driven, 2), 0.0) + 2.0
    assert abs(driven.late_s()[2]) <= 2.0


def time_to(driven: Driven, speed_mps: float) -> float:
    return float(driven.array("time_s")[np.argmax(driven.array("speed_mps") >= speed_mps)])


@pytest.mark.nightly
def test_slippery_rail_lengthens_the_run_up() -> None:
    driven, clear = drive("slippery-rail"), drive("clear-day")
    rail = driven.one(SlipperyRail)
    assert time_to(driven, 35 * KMH) > 2.0 * time_to(clear, 35 * KMH) > 5
    s_m, speed_mps, force_n = (driven.array(name) for name in ("s_m", "speed_mps", "force_el_n"))
    length_m = driven.day.service.vehicle.train_length_m
    whole = (s_m > rail.from_m + length_m) & (s_m < rail.to_m - 50)
    most_n = rail.adhesion_ratio * 84e3 * STANDARD_GRAVITY_MPS2 * np.array([adhesion_coefficient(v) for v in speed_mps])
    assert (force_n[whole] <= 1.001 * most_n[whole]).all()
    assert force_n[whole].max() > 0.9 * most_n[whole].min()
    assert driven.figures["energy_kwh"] > clear.figures["energy_kwh"]


@pytest.mark.nightly
def test_head_wind_costs_its_work() -> None:
    """∫ c2·((v + w)² − v²) ds over the windy stretch is what the resistance takes more."""
    driven, clear = drive("head-wind"), drive("clear-day")
    wind = driven.one(HeadWind)
    state = driven.array("s_m"), driven.array("speed_mps")
    way_m, mean_mps = np.diff(state[0]), 0.5 * (state[1][:-1] + state[1][1:])
    windy = state[0][:-1] > wind.from_m
    c2 = driven.day.service.vehicle.resistance.c2_n_per_mps2
    work_j = float((c2 * (2 * mean_mps + wind.wind_mps) * wind.wind_mps * way_m)[windy].sum())
    more_j = driven.run.states[-1].resistance_j - clear.run.states[-1].resistance_j
    assert work_j > 0.05 * clear.run.states[-1].resistance_j
    assert more_j == pytest.approx(work_j, rel=0.05)
    assert driven.run.states[-1].input_j - clear.run.states[-1].input_j > 0.8 * work_j


def test_gps_dropouts_withdraw_the_advice_with_the_reason() -> None:
    driven = short("gps-dropouts")
    clock_s = driven.day.service.clock_s
    faults = driven.day.of(SensorOutage)
    withdrawn = [a for a in driven.said.advices if a.mode is Regime.NONE]
    for fault in faults:
        inside = [a for a in withdrawn if fault.from_s <= clock_s(a.time_ns) <= fault.from_s + fault.for_s + 1]
        if fault.fault is SensorFault.DROPOUT:
            assert len(inside) >= fault.for_s - STALE_AFTER_S - 2
            assert all("s old" in a.reason.text for a in inside)
        if fault.fault is SensorFault.JUMP:  # too short to matter: the estimate is carried on
            assert not inside
        if fault.fault is SensorFault.FROZEN:
            assert len(inside) >= fault.for_s - STALE_AFTER_S - 1
            assert all("frozen" in a.reason.text for a in inside)
    true_m = {state.time_s: state.s_m for state in driven.run.states}
    off_m = [abs(a.s_m - true_m[round(clock_s(a.time_ns))]) for a in driven.said.advices if a.mode is not Regime.NONE]
    assert max(off_m) < 20.0
    begun = [fault.from_s for fault in faults]
    assert all(any(0 <= clock_s(a.time_ns) - b <= 70 for b in begun) for a in withdrawn)
    # Nothing is shown while nothing is known, and the run goes on.
    for told in driven.said.told:
        for fault in faults:
            if fault.fault is SensorFault.DROPOUT:
                into_s = told.state.time_s - fault.from_s
                assert not (STALE_AFTER_S + 1 < into_s < fault.for_s and told.cab.shown is not None)
    assert abs(driven.late_s()[-1]) <= 5.0
    assert driven.run.counts.above_limit == 0


def test_bus_outage_shows_no_advice_and_the_run_arrives() -> None:
    driven = short("bus-outage", "human")
    outage, _ = driven.day.of(BusOutage)  # the second would be on the way to Luzern
    assert driven.run.counts.unheard == outage.for_s == 30
    for told in driven.said.told:
        into_s = told.state.time_s - outage.from_s
        assert not (VALID_FOR_S <= into_s < outage.for_s and told.cab.shown is not None)
    # What was heard is out of date at once when it is over, and advice is back.
    back = next(a for a in driven.said.advices if driven.day.service.clock_s(a.time_ns) >= outage.from_s + 30)
    assert back.mode is not Regime.NONE
    assert driven.events().count("bus outage, 30 s") == 1
    assert -5 <= driven.late_s()[-1] < 60


def test_node_restart_leaves_the_driver_without_advice_for_seconds() -> None:
    driven = short("node-restart")
    restart = driven.one(NodeRestart)
    assert driven.run.counts.unheard == 2
    clock_s = driven.day.service.clock_s
    times = np.array([clock_s(a.time_ns) for a in driven.said.advices])
    gap = times[:-1][np.diff(times) > 1.5]
    assert gap.tolist() == pytest.approx([restart.at_s - 1])
    after = driven.said.advices[int(np.argmax(times > restart.at_s)) :]
    silent = list(takewhile(lambda one: one.mode is Regime.NONE, after))
    assert 0 < len(silent) <= 5, "until the way between positions confirms the unit of the speeds"
    assert {one.cause for one in silent} == {Cause.POSITION_UNCERTAIN}
    assert "the node is killed and restarted" in driven.events()
    assert abs(driven.late_s()[-1]) <= 2.0


@pytest.mark.nightly
def test_a_train_heavier_than_planned_is_found_out_and_planned_with(tmp_path: Path) -> None:
    """With the forces measured the node plans with the mass it finds; without, with that of the file."""
    source = load_scenario("clear-day").source.read_text(encoding="utf-8")
    truth = "\n[truth]\nmass_ratio = 1.15\nresistance_ratio = 1.25\n"
    found = []
    for name, sensors in (("told", "[sensors]\nforce_noise_percent = 2\n"), ("untold", "")):
        (tmp_path / f"{name}.toml").write_text(source + truth + sensors, encoding="utf-8")
        service = service_of(tmp_path / f"{name}.toml")
        link = InProcess(service)
        driver = make_driver(DriverKind.PERFECT, service.line, seed=SEED)
        run = World(make_day(service, SEED), driver, Presentation.SPEED_AND_EFFORT, link).run()
        assert abs(run.calls[-1].late_s) <= 5
        found.append(link.cab.legs.situation.conditions)
    assert found[0].mass_ratio == pytest.approx(1.15, abs=0.03)
    assert found[0].resistance_ratio == pytest.approx(1.25, abs=0.08)
    assert found[1] == Conditions()
