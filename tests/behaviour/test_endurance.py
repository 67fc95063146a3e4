"""A node that runs for long, and a follower on many late days.

A quarter of an hour of journeys and four days in CI; DAS_ENDURANCE_H=24 and DAS_LATE_DAYS=200 for what it must stand.
"""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from das.bus import das_pb2
from das.bus.topics import ADVICE, CONTROL, JOURNEY, POSITION, STATUS
from sim.drivers.drivers import make_driver
from sim.drivers.kinds import DriverKind, Presentation
from sim.world.in_process import InProcess
from sim.world.loop import World
from sim.world.outcome import fronts_of_braking
from sim.world.scenario import read_scenario
from sim.world.service import make_day, prepare_service
from tests.support.followed import after_a_second_mps
from tests.support.node_process import START_NS, a_journey, node, status, until

HOURS = float(os.environ.get("DAS_ENDURANCE_H", "0.25"))
LATE_DAYS = int(os.environ.get("DAS_LATE_DAYS", "4"))
GROWTH_MB = 15.0
S = 10**9
EARLY_RATIO = 0.2
"""Memory is compared with that after this share of the time, when everything has been used once."""


@pytest.mark.nightly
def test_a_node_drives_for_hours_without_growing(capsys: pytest.CaptureFixture[str]) -> None:
    """Journey after journey on 6 km, restricted now and then, each followed exactly as advised."""
    second, late_s, waited_s, memory_mb = 0, [], [], []
    with node("--clock", "bus") as (bus, child):
        until(bus, status(das_pb2.Status.STATE_WAITING), child)
        while second < HOURS * 3600:
            start_ns = START_NS + second * S
            message = a_journey()
            message.time_ns, message.stops[0].departure_ns = start_ns, start_ns + 5 * S
            message.stops[1].arrival_ns = start_ns + 260 * S
            bus.publish(JOURNEY, message)
            until(bus, lambda r: r.topic is STATUS and r.message.reason.startswith("ready"), child)
            s_m, speed_mps = 0.0, 0.0
            while second * S + START_NS < message.stops[1].arrival_ns + 40 * S:
                now_ns = START_NS + second * S
                bus.publish(POSITION, das_pb2.Position(time_ns=now_ns, s_m=s_m, speed_mps=speed_mps))
                advice, took_s = asked(bus, child, second, now_ns)
                waited_s.append(took_s)
                second += 1
                if s_m > 5_999.0 and speed_mps == 0:
                    break
                after = after_a_second_mps(advice) if advice.horizon_speed_mps else 0.0
                s_m, speed_mps = min(s_m + 0.5 * (speed_mps + after), 6_000.0), after
                if s_m >= 5_999.5:
                    speed_mps = 0.0
            assert s_m > 5_990.0
            late_s.append((START_NS + second * S - message.stops[1].arrival_ns) / S)
            memory_mb.append(resident_mb(child.pid))
            second += 40
    early = memory_mb[int(EARLY_RATIO * len(memory_mb))]
    with capsys.disabled():
        told = f"{len(late_s)} journeys, {second / 3600:.2f} h: memory {early:.0f} … {max(memory_mb):.0f} MB, advice"
        print(f"\n{told} p50 {1e3 * np.median(waited_s):.1f}, p99 {1e3 * np.percentile(waited_s, 99):.1f} ms")
    # The reserve for what a person loses brings this train early; the node learns that it loses nothing.
    assert max(late_s) <= 5.0
    assert -15.0 <= late_s[0] < late_s[-1]
    assert memory_mb[-1] - early <= GROWTH_MB


def asked(bus: Any, child: Any, tick: int, now_ns: int) -> tuple[Any, float]:
    """The advice for a tick, and how long it took to come (s)."""
    began = time.perf_counter()
    bus.publish(CONTROL, das_pb2.Control(time_ns=now_ns, tick=tick + 1))
    advice = until(bus, lambda r: r.topic is ADVICE and r.message.tick == tick + 1, child)
    return advice, time.perf_counter() - began


def resident_mb(pid: int) -> float:
    """Memory of a process that is in use."""
    return float(psutil.Process(pid).memory_info().rss) / 2**20


LATE = """
schema_version = 1
scenario = {id = "late-everywhere", title = "Late at every stop", route = "zurich-luzern", vehicle = "re460-ic"}
timetable = {departure = "2026-11-21T08:04:00Z", buffer_percent = 12}
sensors = {position_noise_m = 0, speed_noise_mps = 0}
disturbances = [
    {kind = "departure-delay", stop = "Zürich HB", delay_s = {min = 0, max = 90}},
    {kind = "dwell-overrun", stop = "Thalwil", delay_s = {min = 0, max = 90}},
    {kind = "dwell-overrun", stop = "Zug", delay_s = {min = 0, max = 150}},
]
"""
FEASIBLE_S = 2.0
"""A section is feasible where this is left beyond its least time: a real train builds its effort up."""


@pytest.mark.nightly
def test_a_follower_on_late_days_arrives_in_time_for_the_least_energy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Energy against the optimum, braking as advised, of every section for the time that was left on departure.

    Where next to no time is left, the second that forces take to build up costs more: not even the perfect follower
    can do without it.
    """
    (tmp_path / "late.toml").write_text(LATE, encoding="utf-8")
    service = prepare_service(read_scenario(tmp_path / "late.toml"))
    excess, late_s = [], []
    for seed in range(LATE_DAYS):
        day = make_day(service, seed)
        driver = make_driver(DriverKind.PERFECT, service.line, seed=seed)
        run = World(day, driver, Presentation.SPEED_AND_EFFORT, InProcess(service)).run()
        optimum_j = 0.0
        fronts = fronts_of_braking(day, None)
        for front, table, (departed, arrived) in zip(fronts, service.timetables, run.legs, strict=True):
            left_s = service.clock_s(table.arrival_ns) - departed.time_s
            optimum_j += front.trajectory(left_s).balance.input
            if left_s > front.fastest().time_s + FEASIBLE_S:
                late_s.append(arrived.time_s - service.clock_s(table.arrival_ns))
        excess.append(sum(day.plant.balance(*leg).input for leg in run.legs) / optimum_j - 1.0)
    with capsys.disabled():
        told = f"{LATE_DAYS} days: energy {100 * min(excess):+.2f} … {100 * max(excess):+.2f} %, mean"
        print(
            f"\n{told} {100 * np.mean(excess):+.2f} %; {len(late_s)} arrivals {min(late_s):+.1f} … {max(late_s):+.1f} s"
        )
    assert np.percentile(excess, 95) <= 0.005
    assert max(excess) <= 0.01
    # The reserve for what a person loses brings this train early; the node learns that it loses nothing.
    assert max(late_s) <= 5.0
    assert -15.0 <= late_s[0] < late_s[-1]
