"""One brain: a run in this process gives the same advice, byte for byte, as one over the bus with real processes.

One day has the disturbances of every bundled scenario in which something is said or happens on the bus that the others
do not have. The nightly tests drive every bundled scenario as well.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from das.advice.advice import Advice
from das.bus import codec, das_pb2
from das.bus.recording import read_recording
from das.bus.topics import ADVICE
from das.cab.heard import DelayHeard, Heard, PositionHeard, RestrictionsHeard, ToldRestriction
from das.estimate.estimate import PositionFix, Quality
from sim.drivers.drivers import make_driver
from sim.drivers.kinds import DriverKind, Presentation
from sim.world.driving import How, OverBus, make_processes
from sim.world.in_process import InProcess
from sim.world.lockstep import Lockstep
from sim.world.loop import Link, Tick, Told, World
from sim.world.scenario import bundled_scenarios, read_scenario
from sim.world.service import Day, make_day, prepare_service

SEED = 1
HOSTILE_EVERY, HOSTILE_FROM, RIGHT_AGAIN = 7, 100, 130
"""Every so many-th tick hears nonsense; restrictions that cannot be heeded come at one tick, right ones at another."""


class Hostile:
    """A link through which nonsense comes as well: positions and delays that cannot be, restrictions without sense."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._restrictions: RestrictionsHeard | None = None

    def exchange(self, tick: Tick) -> Any:
        """The advice for a tick at which nonsense may be told."""
        told: list[Heard] = list(tick.told)
        for one in tick.told:
            if isinstance(one, RestrictionsHeard):
                self._restrictions = one
        if tick.number % HOSTILE_EVERY == 0:
            told += _nonsense(tick)
        if tick.number == HOSTILE_FROM:
            nonsense = (ToldRestriction(5.0, 1.0, -3.0),)
            told.append(RestrictionsHeard(time_ns=tick.now_ns, restrictions=nonsense))
        if tick.number == RIGHT_AGAIN and self._restrictions is not None:
            told.append(replace(self._restrictions, time_ns=tick.now_ns))
        return self._link.exchange(tick._replace(told=tuple(told)))

    def newest(self) -> Any | None:
        """Advice that came later."""
        return self._link.newest()

    def tell(self, now_ns: int, told: Told) -> None:
        """Pass on what is only recorded."""
        self._link.tell(now_ns, told)

    def restart(self) -> None:
        """Restart the cab behind the link."""
        self._link.restart()


def _nonsense(tick: Tick) -> list[Heard]:
    kinds = (
        PositionFix(time_ns=tick.now_ns, s_m=math.nan, speed_mps=math.inf),
        PositionFix(time_ns=tick.now_ns + 10**12, s_m=1e300, speed_mps=-1e300),
        PositionFix(time_ns=tick.now_ns + 1, s_m=3.0, speed_mps=400.0, uncertainty_m=-1.0),
        PositionFix(time_ns=tick.now_ns + 2, s_m=3.0, speed_mps=4.0, quality=Quality.INVALID),
    )
    fix = kinds[tick.number // HOSTILE_EVERY % len(kinds)]
    return [PositionHeard(fix=fix), DelayHeard(time_ns=tick.now_ns, delay_s=math.inf)]


class Kept(InProcess):
    """The cab in this process, with every advice as the bus would carry it."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self.payloads: list[bytes] = []
        super().__init__(*arguments, **options)

    def exchange(self, tick: Tick) -> Advice:
        advice = super().exchange(tick)
        self.payloads.append(codec.advice_message(advice, tick.number).SerializeToString())
        return advice


def advices_in_process(day: Day, hostile: bool, shown: Presentation = Presentation.SPEED_AND_EFFORT) -> list[bytes]:
    kept = Kept(day.service, guide=shown is Presentation.GUIDE)
    driver = make_driver(DriverKind.HUMAN, day.service.line, seed=SEED)
    World(day, driver, shown, Hostile(kept) if hostile else kept).run()
    return kept.payloads


def advices_over_bus(
    day: Day, hostile: bool, out: Path, shown: Presentation = Presentation.SPEED_AND_EFFORT
) -> list[bytes]:
    how = How(driver=DriverKind.HUMAN, advice=shown, train="T1", command="test")
    processes = make_processes(day, how, out)
    driver = make_driver(DriverKind.HUMAN, day.service.line, seed=SEED)
    with Lockstep(processes) as lockstep:
        lockstep.begin(day.service.journey(processes.train, processes.start_ns))
        link: Link = OverBus(day, lockstep)
        run = World(day, driver, shown, Hostile(link) if hostile else link).run()
        lockstep.finish(day.service.moment_ns(run.states[-1].time_s))
    return [one.message.SerializeToString() for one in read_recording(out).of(ADVICE)]


EVENTFUL = (
    "bus-outage",
    "delay-on-the-way",
    "gps-dropouts",
    "node-restart",
    "restriction-ahead",
    "signal-stop",
    "train-ahead",
)
"""Scenarios with delays, restrictions, targets, signals, missing positions, a lost bus or a node that is killed. On the
other days the node hears the same kinds of messages with other figures."""


def eventful_scenario() -> str:
    """The text of a scenario whose day has the disturbances of all eventful scenarios."""
    begin = "[[disturbances]]"
    first, *others = (bundled_scenarios()[name].read_text() for name in EVENTFUL)
    return "\n".join([first, *(begin + other.partition(begin)[2] for other in others)])


def same_advices(scenario: Path, hostile: bool, out: Path) -> list[das_pb2.Advice]:
    """Drive one day of the scenario in process and over the bus, compare the advices, and give them."""
    service = prepare_service(read_scenario(scenario))
    here = advices_in_process(make_day(service, SEED), hostile)
    there = advices_over_bus(make_day(service, SEED), hostile, out)
    assert len(here) == len(there) > 100
    differing = [tick for tick, (a, b) in enumerate(zip(here, there, strict=True), 1) if a != b]
    assert not differing
    return [das_pb2.Advice.FromString(one) for one in here]


@pytest.mark.nightly
@pytest.mark.parametrize("hostile", [pytest.param(False, marks=pytest.mark.nightly), True])
def test_on_an_eventful_day_the_advice_is_the_same_byte_for_byte(hostile: bool, tmp_path: Path) -> None:
    scenario = tmp_path / "eventful.toml"
    scenario.write_text(eventful_scenario())
    advices = same_advices(scenario, hostile, tmp_path / "run.mcap")
    # What happens on the day reaches the advice: it is withdrawn, and given again.
    causes = {one.cause for one in advices}
    assert das_pb2.CAUSE_NONE in causes
    assert len(causes) > 1


@pytest.mark.nightly
@pytest.mark.parametrize("name", sorted(bundled_scenarios()))
def test_in_process_and_over_the_bus_the_advice_is_the_same_byte_for_byte(name: str, tmp_path: Path) -> None:
    same_advices(bundled_scenarios()[name], hostile=False, out=tmp_path / "run.mcap")


@pytest.mark.nightly
def test_the_guide_says_the_same_in_process_and_over_the_bus(tmp_path: Path) -> None:
    """On a day with a window, planned with the braking of its drivers; every advice under way has a guide."""
    file = tmp_path / "braking.toml"
    braking = "[braking]\nplanning_brake_mps2 = 0.5\nbelow_limit_kmh = 2.1\n"
    file.write_text(f"{bundled_scenarios()['train-ahead'].read_text()}\n{braking}")
    service = prepare_service(read_scenario(file))
    here = advices_in_process(make_day(service, SEED), False, Presentation.GUIDE)
    there = advices_over_bus(make_day(service, SEED), False, tmp_path / "run.mcap", Presentation.GUIDE)
    assert len(here) == len(there) > 100
    assert [tick for tick, (a, b) in enumerate(zip(here, there, strict=True), 1) if a != b] == []
    guided = [das_pb2.Advice.FromString(one).HasField("guide") for one in here]
    assert sum(guided) > 0.9 * len(guided)
