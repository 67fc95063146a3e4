"""A driver that is a process of its own: the same states bit for bit, the page's program, and what silence leads to."""

from __future__ import annotations

import json
import math
import subprocess
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from das.advice.reason import Reason, ReasonCode
from das.bus import das_pb2
from das.bus.recording import read_recording
from das.bus.session import endpoint, free_ports
from das.bus.topics import CAB, CONTROLS, LOG, Topic, decode_restriction
from das.domain.clocks import Clocks
from das.domain.errors import DasError
from das.domain.restriction import Restriction
from sim.drivers.cab import AdviceView, CabView
from sim.drivers.kinds import DESK, EXTERNAL, Presentation
from sim.drivers.messages import CabLook, cab_message, command_of, recorded_view
from sim.plant.kernels import Command
from sim.plant.plant import COAST, force, lever, speed
from sim.world.driving import DayRun, How, drive_day
from sim.world.external import AT_THE_DESK, DeadMan, ExternalDriver, Patience
from sim.world.lockstep import Answers
from sim.world.service import Day, make_day
from tests.support.flat_days import FLAT, service_of, signal_at
from tests.support.making import REPOSITORY, das_sim, started

EXAMPLE = REPOSITORY / "docs" / "examples" / "external_driver.py"
HUMAN = "[human]\nbraking_mps2 = {min = 0.4, max = 0.7}\n"
RESTRICTED = "[[disturbances]]\nkind = 'restriction'\nfrom_m = 1200\nto_m = 1500\nspeed_kmh = 60\nannounced_m = 900\n"
SILENT = """
import sys, time
from das.bus import das_pb2
from das.bus.session import Bus
from das.bus.topics import CAB, CONTROLS

silent_from, silent_to = int(sys.argv[2]), int(sys.argv[3])
with Bus("T1", connect=[sys.argv[1]], hear=[CAB]) as bus:
    while True:
        received = bus.receive(0.2)
        if received is None:
            bus.publish(CONTROLS, das_pb2.Controls())
        elif received.topic is CAB and not silent_from <= received.message.look < silent_to:
            cab = received.message
            way_m = max(cab.stop_m - cab.s_m - cab.speed_mps, 0.0)
            held = das_pb2.Controls.HeldSpeed(speed_mps=min(30.0, way_m**0.5 if cab.may_depart else 0.0))
            bus.publish(CONTROLS, das_pb2.Controls(look=cab.look, held_speed=held))
"""
"""A driver that does not answer some looks."""
SECOND = """
import sys
from das.bus import das_pb2
from das.bus.session import Bus
from das.bus.topics import CAB, CONTROLS

with Bus("T1", connect=[sys.argv[1]], hear=[CAB]) as bus:
    while True:
        received = bus.receive(0.2)
        if received is not None:
            bus.publish(CONTROLS, das_pb2.Controls(look=received.message.look, lever_ratio=-1.0))
"""
"""A second driver: it brakes, and says nothing before the first has begun."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("outside")
    (folder / "flat.toml").write_text(FLAT)
    (folder / "eventful.toml").write_text(FLAT + HUMAN + RESTRICTED + signal_at(4000, 800))
    (folder / "silent.py").write_text(SILENT)
    (folder / "second.py").write_text(SECOND)
    (folder / "page.py").write_text(EXAMPLE.read_text(encoding="utf-8"))
    return folder


@contextmanager
def process(folder: Path, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A Python process of this checkout, ended with the block."""
    child = started(*arguments, cwd=folder)
    try:
        yield child
    finally:
        child.kill()
        child.communicate()


def day_of(folder: Path, name: str, seed: int = 3) -> Day:
    return make_day(service_of(folder / name), seed)


def driven(day: Day, place: str, out: Path, shown: Presentation, patience: Patience | None = None) -> DayRun:
    how = How(driver=EXTERNAL, advice=shown, train="T1", command="test", driver_at=place)
    return drive_day(day, ExternalDriver(day, patience=patience), how, out)


@pytest.mark.nightly
def test_the_program_of_the_page_drives(folder: Path) -> None:
    place = endpoint(*free_ports(1))
    with process(folder, "page.py", place) as other:
        asked = ("run", "eventful.toml", "--driver", "external", "--driver-at", place, "--out", "p.mcap", "--json")
        done = das_sim(*asked, cwd=folder)
        other.communicate(timeout=60)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert other.returncode == 0
    assert found["driver"] == "external"
    assert found["messages_lost"] == found["over_limit_s"] == found["signals_passed"] == 0
    assert abs(found["stops"][-1]["stopping_error_m"]) < 10


@pytest.mark.nightly
def test_a_driver_that_falls_silent_is_braked_for_and_may_come_back(folder: Path, tmp_path: Path) -> None:
    """Silent for 30 looks; it answers again while the train brakes, and drives on after a stand."""
    day, place = day_of(folder, "flat.toml"), endpoint(*free_ports(1))
    with process(folder, "silent.py", place, "400", "430"):
        run = driven(day, place, tmp_path / "s.mcap", Presentation.NONE).run
    said = [
        (entry.message.message, entry.message.timestamp.ToNanoseconds())
        for entry in read_recording(tmp_path / "s.mcap").of(LOG)
    ]
    words = [text for text, _ in said]
    begins = words.index("the external driver has been silent for 2 s: the dead-man brake is applied")
    ends = words.index("the external driver answers again: the dead-man brake is released")
    assert begins < ends
    at_s = day.service.clock_s(said[begins][1])
    arrived_s = day.service.clock_s(run.calls[-1].arrived_ns)
    standing = [state.time_s for state in run.states if state.speed_mps == 0 and 0 < state.time_s < arrived_s - 1]
    braked = [state for state in run.states if at_s + 2 < state.time_s < min(standing) - 1]
    assert at_s == pytest.approx(399 * 0.2 - 10)  # the first look that was not answered
    assert all(state.acceleration_mps2 < -0.8 for state in braked)
    assert len(braked) > 5


@pytest.mark.nightly
def test_the_first_of_two_drivers_drives(folder: Path, tmp_path: Path) -> None:
    """The second one begins when the run has begun, and would not move the train; the states are those of the first."""
    runs = []
    for others in ((), ("second.py",)):
        day, place = day_of(folder, "flat.toml"), endpoint(*free_ports(1))
        with ExitStack() as stack:
            stack.enter_context(process(folder, "silent.py", place, "0", "0"))
            for other in others:
                stack.enter_context(process(folder, other, place))
            runs.append(driven(day, place, tmp_path / "two.mcap", Presentation.NONE)[0].states)
    assert runs[0] == runs[1]
    words = [entry.message.message for entry in read_recording(tmp_path / "two.mcap").of(LOG)]
    assert "another process answers as well; the first one drives" in words


@pytest.mark.nightly
def test_a_driver_that_is_gone_ends_the_run_with_its_recording(folder: Path, tmp_path: Path) -> None:
    day, place = day_of(folder, "flat.toml"), endpoint(*free_ports(1))
    with process(folder, "silent.py", place, "400", "99999"), pytest.raises(DasError) as raised:
        driven(day, place, tmp_path / "g.mcap", Presentation.NONE, Patience(given_up_s=1.0, driver=DESK))
    assert "--driver desk: the driver is gone, and the dead-man brake has stopped the train" in str(raised.value)
    assert read_recording(tmp_path / "g.mcap").of(LOG)


class Prompt:
    """In place of a lockstep with a driver who answers at once but for some looks, whenever there is time to listen.

    He pulls, but in the looks `eased` he sets the lever to 0.
    """

    def __init__(self, silent: range = range(0), eased: range = range(0)) -> None:
        self._silent, self._eased = silent, eased
        self.answers, self.processes = Answers(), None
        self.logs: list[str] = []
        self.cabs: list[Any] = []
        self.now_s = 0.0
        self._look = 0

    def send(self, topic: Topic, message: Any) -> None:
        if topic is CAB:
            self._look = message.look
            self.cabs.append(message)
        else:
            self.logs.append(message.message)

    def hear(self, done: Callable[[], bool], timeout_s: float) -> bool:
        if timeout_s > 0 and self._look not in self._silent:
            ratio = 0.0 if self._look in self._eased else 0.25
            self.answers.take(CONTROLS, das_pb2.Controls(look=self._look, lever_ratio=ratio), "driver")
        self.now_s += timeout_s
        return done()


def at_pace(folder: Path, lockstep: Prompt, times_real: float, late_s: float = 0.0) -> list[Command]:
    """What 200 looks of a run at a pace come to; the run falls behind its pace by `late_s` before the first."""
    driver = paced_driver(folder, lockstep, times_real)
    lockstep.now_s += late_s
    return [driver.command(MOVING._replace(time_s=0.2 * look)) for look in range(200)]


def paced_driver(folder: Path, lockstep: Prompt, times_real: float, patience: Patience | None = None) -> ExternalDriver:
    clocks = Clocks(now_ns=lambda: round(lockstep.now_s * 1e9), seconds=lambda: lockstep.now_s)
    driver = ExternalDriver(day_of(folder, "flat.toml"), times_real=times_real, clocks=clocks, patience=patience)
    lockstep.answers.take(CONTROLS, das_pb2.Controls(), "driver")
    driver.begin(lockstep)  # type: ignore[arg-type]
    return driver


MOVING = CabView(0.0, 0.0, 10.0, 38.8, 6000.0, 0.0, 234.0)


@pytest.mark.parametrize(("looks", "braked"), [(9, 0), (10, 141), (40, 141)])
def test_at_a_pace_silence_is_counted_by_the_clock_of_the_run(folder: Path, looks: int, braked: int) -> None:
    """Ten looks of 0.2 s are 2 s at any pace: then the brake is applied, and stays while the train moves."""
    lockstep = Prompt(range(51, 51 + looks))
    commands = at_pace(folder, lockstep, 20.0)
    assert commands.count(lever(-1.0)) == braked
    assert commands.count(lever(0.25)) == 200 - braked
    assert len(lockstep.logs) == (1 if braked else 0)


def test_a_run_that_fell_behind_its_pace_slips_and_says_so(folder: Path) -> None:
    """10 s are lost at once: every look still lasts 0.2 s, nobody is silent, and the recording says what was lost."""
    lockstep = Prompt()
    assert set(at_pace(folder, lockstep, 1.0, late_s=10.0)) == {lever(0.25)}
    assert lockstep.logs == ["the run could not keep its pace: it is 9.9 s behind so far"]
    sent_s = [cab.wall_ns * 1e-9 for cab in lockstep.cabs]
    gaps_s = [after - before for before, after in pairwise(sent_s)]
    assert gaps_s[0] == pytest.approx(0.1)  # half a look to listen in, as the least
    assert gaps_s[1:] == pytest.approx([0.2] * 198)


def test_a_little_lateness_is_made_up_within_the_next_look(folder: Path) -> None:
    """What takes 50 ms after every look does not move the looks: they stay 0.2 s apart by an absolute schedule."""
    lockstep = Prompt()
    driver, sent_s = paced_driver(folder, lockstep, 1.0), []
    for look in range(50):
        lockstep.now_s += 0.05
        sent_s.append(lockstep.now_s)
        driver.command(MOVING._replace(time_s=0.2 * look))
    assert [after - before for before, after in pairwise(sent_s)] == pytest.approx([0.2] * 49)
    assert lockstep.logs == []


def test_the_dead_man_brake_is_applied_after_2_s_and_released_at_a_stand_without_traction() -> None:
    dead_man = DeadMan()
    assert [dead_man.silent(0.2) for _ in range(9)] == [None] * 9
    assert dead_man.answered(standing=False) is None
    told = [dead_man.silent(0.2) for _ in range(12)]
    assert [text is not None for text in told] == [False] * 9 + [True] + [False] * 2
    assert dead_man.braking
    assert dead_man.answered(standing=False) is None
    assert dead_man.answered(standing=True, pulls=True) is None
    assert dead_man.braking
    assert "released" in (dead_man.answered(standing=True) or "")
    assert not dead_man.braking
    assert dead_man.silent(Patience.silent_s) is not None


def test_the_cab_says_that_the_dead_man_brake_holds_until_the_lever_is_at_0(folder: Path) -> None:
    """After 15 silent looks the driver pulls again; the brake holds, without advice, until he eases the lever."""
    lockstep = Prompt(range(51, 66), eased=range(150, 152))
    driver = paced_driver(folder, lockstep, 1.0)
    shown = replace(ADVICE, valid_until_s=1e9)
    commands = []
    for look in range(1, 171):
        cab = MOVING._replace(time_s=0.2 * look, speed_mps=0.0 if look > 100 else 10.0, advice=shown)
        commands.append(driver.command(cab))
    held = [cab.look for cab in lockstep.cabs if cab.interlock == das_pb2.Cab.INTERLOCK_SILENCE]
    assert held == list(range(61, 151))
    assert [cab.look for cab in lockstep.cabs if not cab.presentation] == held
    assert {*commands[60:149]} == {lever(-1.0)}
    assert commands[149:151] == [lever(0.0)] * 2
    assert commands[151:] == [lever(0.25)] * 19


def test_at_a_pace_the_clock_goes_on_while_the_driver_is_away_until_the_run_gives_up(folder: Path) -> None:
    lockstep = Prompt(range(11, 9999))
    driver = paced_driver(folder, lockstep, 1.0, Patience(given_up_s=20.0))
    cabs = (MOVING._replace(time_s=0.2 * look, speed_mps=0.0) for look in range(1, 9999))
    with pytest.raises(DasError, match="the driver is gone"):
        deque(map(driver.command, cabs))
    assert len(lockstep.cabs) == pytest.approx(10 + 20 * 5, abs=1)


class Pausing(Prompt):
    """A driver who asks for a pause at look 20, which lasts for `pause_s` of the 600 s that a run waits."""

    def __init__(self, pause_s: float) -> None:
        super().__init__()
        self._pause_s = pause_s

    def hear(self, done: Callable[[], bool], timeout_s: float) -> bool:
        if timeout_s > 1.0:
            self.now_s += min(self._pause_s, timeout_s)
            ended = self._pause_s < timeout_s
            answer = das_pb2.Controls(look=self._look, lever_ratio=0.25, paused=not ended)
            self.answers.take(CONTROLS, answer, "driver")
            return done()
        if self.answers.controls.paused:
            self.now_s += timeout_s
            return done()
        found = super().hear(done, timeout_s)
        if self._look == 20:
            self.answers.take(CONTROLS, das_pb2.Controls(look=20, lever_ratio=0.25, paused=True), "driver")
        return found


def test_a_pause_stops_the_run_without_the_dead_man_brake_and_is_recorded(folder: Path) -> None:
    lockstep = Pausing(32.5)
    driver = paced_driver(folder, lockstep, 1.0, AT_THE_DESK)
    assert {driver.command(MOVING._replace(time_s=0.2 * look)) for look in range(1, 60)} == {lever(0.25)}
    assert lockstep.logs == ["the driver asked for a pause: the run waited for 32.5 s"]
    gaps_s = [(after.wall_ns - one.wall_ns) * 1e-9 for one, after in pairwise(lockstep.cabs)]
    assert gaps_s[19] == pytest.approx(32.5, abs=0.21)
    assert gaps_s[:19] + gaps_s[20:] == pytest.approx([0.2] * 57)


def test_a_pause_that_never_ends_ends_in_the_dead_man_brake(folder: Path) -> None:
    lockstep = Pausing(1e9)
    driver = paced_driver(folder, lockstep, 1.0, AT_THE_DESK)
    commands = [driver.command(MOVING._replace(time_s=0.2 * look)) for look in range(1, 60)]
    assert commands[:20] == [lever(0.25)] * 20
    assert commands[-1] == lever(-1.0)
    assert "the run waited for 600.0 s" in lockstep.logs[0]


@pytest.mark.parametrize(("may_depart", "interlock"), [(True, 0), (False, das_pb2.Cab.INTERLOCK_DOORS)])
def test_the_cab_says_that_traction_is_withheld_before_the_departure(
    folder: Path, may_depart: bool, interlock: int
) -> None:
    lockstep = Prompt()
    paced_driver(folder, lockstep, 1.0).command(MOVING._replace(speed_mps=0.0, may_depart=may_depart))
    assert lockstep.cabs[0].interlock == interlock


ADVICE = AdviceView(
    time_s=0.1 + 0.2, valid_until_s=3.3, presentation=Presentation.SPEED_AND_EFFORT, mode=2, speed_mps=1 / 3,
    display_speed_mps=0.3, lever_ratio=-0.123, force_n=-1e4 / 7, horizon_speed_mps=(0.1, 0.2),
    horizon_force_n=(1.0, 2.0), next_mode=4, next_change_s=7.7, next_speed_mps=9.1,
    next_effort_ratio=0.6, next_change_m=44.4, second_mode=5, second_change_s=9.9, second_change_m=88.8,
    second_speed_mps=3.3, second_effort_ratio=-0.4, due_s=0.3, target_way_m=12.1,
    reason=Reason(code=ReasonCode.STOP, stop="B"),
    deviation_s=-4.4,
)  # fmt: skip


@pytest.mark.parametrize("advice", [None, ADVICE])
@pytest.mark.parametrize("signal_m", [float("inf"), 1234.5])
def test_a_cab_is_on_the_bus_as_the_driver_sees_it(folder: Path, advice: AdviceView | None, signal_m: float) -> None:
    line = day_of(folder, "flat.toml").service.line
    cab = CabView(
        0.1 + 0.2, 1 / 3, 2 / 3, 38.8, 6000.0, -0.1, 234.5, False, signal_m, (Restriction(1.1, 2.2, 3.3),), advice,
        7, 1.25, 0.004, 1e4 / 3, -2.0,
    )  # fmt: skip
    sent = das_pb2.Cab.FromString(cab_message(CabLook(1, cab, COAST, 5), line).SerializeToString())
    assert recorded_view(sent) == advice
    same = [name for name in CabView._fields if name not in ("time_s", "signal_m", "restrictions", "advice")]
    assert {name: getattr(sent, name) for name in same} == {name: getattr(cab, name) for name in same}
    assert sent.clock_s == cab.time_s
    assert sent.signal_m == signal_m if math.isfinite(signal_m) else math.isnan(sent.signal_m)
    assert [decode_restriction(one, Restriction) for one in sent.restrictions] == list(cab.restrictions)


HELD = das_pb2.Controls.HeldSpeed


@pytest.mark.parametrize(
    ("said", "command"),
    [
        (das_pb2.Controls(lever_ratio=0.1 + 0.2, friction_ratio=0.3), lever(0.1 + 0.2, friction_ratio=0.3)),
        (das_pb2.Controls(force_n=-1e5 / 3, friction_ratio=1.0), force(-1e5 / 3, friction_ratio=1.0)),
        (das_pb2.Controls(force_n=0.0), COAST),
        (das_pb2.Controls(held_speed=HELD(speed_mps=10 / 3)), speed(10 / 3)),
        (
            das_pb2.Controls(held_speed=HELD(speed_mps=0, rate_mps2=-0.1, force_n=7, gain_per_s=0, low_n=-5, high_n=0)),
            speed(0.0, rate_mps2=-0.1, force_n=7.0, gain_per_s=0.0, low_n=-5.0, high_n=0.0),
        ),
    ],
)
def test_controls_are_the_command_that_they_say(said: das_pb2.Controls, command: Command) -> None:
    assert command_of(das_pb2.Controls.FromString(said.SerializeToString()), 0.0) == command


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        (das_pb2.Controls(look=1), "neither lever_ratio, force_n nor held_speed"),
        (das_pb2.Controls(look=1, lever_ratio=float("nan")), "the lever's ratio = nan"),
    ],
)
def test_controls_that_no_train_understands_are_refused(said: das_pb2.Controls, expected: str) -> None:
    with pytest.raises(DasError, match="--driver external: at 2") as raised:
        command_of(said, 2.0)
    assert expected in str(raised.value)
