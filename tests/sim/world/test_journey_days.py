"""Days by the timetable of a journey file: its stops, dwells and passings reach the loop, the bus and the report."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest

from das.cab.heard import TargetsHeard
from das.domain.errors import DasError, InfeasibleError, InputError
from das.domain.files.load import load_vehicle
from das.domain.journey import Window
from das.domain.units import NS
from das.offline.asked_journey import Passing
from sim.drive.calls import (
    PASSINGS,
    DuePassing,
    KeptPassing,
    keep,
    passing_metadata,
    passings_as_rows,
    recorded_passings,
)
from sim.drivers.drivers import make_driver
from sim.drivers.kinds import DriverKind, Presentation
from sim.world.in_process import InProcess
from sim.world.loop import Run, World
from sim.world.outcome import DayOutcome, DayResult, outcome, print_result
from sim.world.scenario import load_scenario, read_scenario
from sim.world.service import Day, load_of, make_day, prepare_service, scenario_files
from sim.world.surroundings import Surroundings
from tests.support.making import refusal

JOURNEY = """
schema_version = 1
[journey]
id = "night"
name = "A night train"
route = "flat-6km"
[[stops]]
name = "Start"
position_km = 0
departure = "23:58:00"
[[stops]]
name = "Halt"
position_km = 2.4
departure = "24:02:30"
dwell_s = 40
[[stops]]
name = "End"
position_km = 6
arrival = "24:06:00"
[[passings]]
name = "Bridge"
position_km = 1.2
[[passings]]
name = "Junction"
position_km = 4.0
latest = "24:04:20"
[[passings]]
name = "Wish"
position_km = 5.0
time = "24:03:00"
wish = true
tolerance_s = 10
"""
SCENARIO = """
schema_version = 1
[scenario]
id = "night"
title = "Night"
route = "flat-6km"
vehicle = "re460-ic"
journey = "journey.toml"
[timetable]
departure = "2026-07-01T12:00:00Z"
"""


def written(folder: Path, scenario: str = SCENARIO, journey: str = JOURNEY) -> Path:
    (folder / "journey.toml").write_text(journey, encoding="utf-8")
    path = folder / "night.toml"
    path.write_text(scenario, encoding="utf-8")
    return path


@cache
def day() -> Day:
    return make_day(prepare_service(read_scenario(written(Path(mkdtemp())))), 1)


@cache
def driven() -> tuple[Run, DayOutcome]:
    """The day, driven by the perfect driver."""
    made = make_driver(DriverKind.PERFECT, day().service.line)
    run = World(day(), made, Presentation.SPEED_AND_EFFORT, InProcess(day().service)).run()
    return run, outcome(day(), run, DriverKind.PERFECT)


def test_the_service_has_the_stops_dwells_and_times_of_the_journey() -> None:
    service = day().service
    assert [(stop.name, stop.position_m) for stop in service.stops] == [
        ("Start", 0.0),
        ("Halt", 2400.0),
        ("End", 6000.0),
    ]
    assert service.dwells_s == (0.0, 40.0, 0.0)
    zero_ns = 1_782_864_000 * 10**9  # 2026-07-01, 0:00 UTC: the line names no time zone
    first, second = service.timetables
    assert first.departure_ns == zero_ns + (23 * 3600 + 58 * 60) * 10**9
    assert second.departure_ns == zero_ns + (24 * 3600 + 150) * 10**9
    assert second.arrival_ns == zero_ns + (24 * 3600 + 360) * 10**9
    assert first.arrival_ns <= second.departure_ns - 40 * 10**9


@pytest.mark.parametrize(("load", "named"), [("", "rain"), ("full", "full+rain"), ("dry+full", "dry+full")])
def test_the_train_runs_in_the_mode_that_the_journey_names(tmp_path: Path, load: str, named: str) -> None:
    """In the plan, for the driver and on board alike."""
    train = load_vehicle("re460-ic").source
    text = Path(train).read_text(encoding="utf-8")
    for table in Path(train).parent.glob("*.csv"):
        (tmp_path / table.name).write_bytes(table.read_bytes())
    modes = "".join(f"\n[modes.{name}.traction]\nmax_force_kn = 200\nmax_power_kw = 5500\n" for name in ("rain", "dry"))
    modes += "\n[loads.full]\nmass_t = 500\n"
    (tmp_path / "train.toml").write_text(text + modes, encoding="utf-8")
    scenario = SCENARIO.replace('"re460-ic"', f'"train.toml"\n{f"load = {load!r}" * bool(load)}')
    journey = JOURNEY.replace('route = "flat-6km"', 'route = "flat-6km"\nmode = "rain"')
    service = prepare_service(read_scenario(written(tmp_path, scenario, journey)))
    assert service.vehicle.id.partition("/")[2] == named
    assert service.vehicle.mode == ("dry" if "dry" in named else "rain"), "what the scenario names has precedence"
    assert {front.section.train.traction_power_w for front in service.fronts} == {5.5e6}
    assert load_of(service.scenario, service.route, service.vehicle) == named, "the node on a bus is told the same"


def test_the_day_is_kept_as_the_journey_says() -> None:
    run, found = driven()
    assert [abs(call.stopping_error_m) < 10.0 for call in run.calls[1:]] == [True, True]
    assert abs(found.late_s) < 10.0
    halt = run.calls[1]
    assert (halt.departed_ns - halt.arrived_ns) * NS >= 40.0
    rows = found.as_dict()["passings"]
    assert [row["name"] for row in rows] == ["Bridge", "Junction", "Wish"]
    bridge, junction, wish = rows
    assert bridge["late_s"] is None
    assert 0.0 < bridge["passed_s"] < 270.0
    assert junction["late_s"] <= 1.0
    assert wish["late_s"] == pytest.approx(wish["passed_s"] - 300.0)
    assert wish["late_s"] > 10.0


def test_each_passing_was_passed_when_the_train_was_there() -> None:
    run, found = driven()
    s_m, time_s = [state.s_m for state in run.states], [state.time_s for state in run.states]
    for one in found.passings:
        expected = day().service.moment_ns(float(np.interp(one.due.s_m, s_m, time_s)))
        assert one.passed_ns == pytest.approx(expected, abs=0.6e9)


def test_windows_are_told_to_the_node_as_targets_until_they_are_passed_and_wishes_are_not() -> None:
    around, service = Surroundings(day()), day().service
    state = day().plant.at(0.0, time_s=-10.0)
    around.news.update(state)
    (told,) = [one for one in around.operators(0, service.moment_ns(-10.0), state) if isinstance(one, TargetsHeard)]
    (target,) = told.targets
    junction = service.passings[1]
    assert (target.s_m, target.latest_ns, target.earliest_ns) == (4000.0, junction.latest_ns, 0)
    assert target.reason == "passing Junction"
    beyond = day().plant.at(4100.0, time_s=300.0)
    around.news.update(beyond)
    (last,) = [one for one in around.operators(1, service.moment_ns(300.0), beyond) if isinstance(one, TargetsHeard)]
    assert last.targets == ()


def test_a_bundled_journey_replaces_the_stops_of_a_scenario() -> None:
    scenario = load_scenario("clear-day").timed_by("zurich-luzern")
    assert scenario_files(scenario)["journey"].name == "zurich-luzern.toml"
    assert scenario != load_scenario("clear-day")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("[timetable]", 'from = "A"\n[timetable]'), r"scenario.from = 'A': expected none with scenario.journey"),
        (("[timetable]", "calls = []\n[timetable]"), r"scenario.calls = \[\]: expected none with scenario.journey"),
        (("departure =", "dwell_s = 3\ndeparture ="), r"timetable.dwell_s = 3: expected none with scenario.journey"),
        (("departure =", "buffer_percent = 3\ndeparture ="), r"timetable.buffer_percent = 3: expected none with"),
        (("journey.toml", "other.toml"), r"other.toml: no such file"),
        (("journey.toml", "night.toml"), r"is a scenario file of this program, expected a journey"),
    ],
)
def test_a_scenario_that_contradicts_its_journey_is_refused(tmp_path: Path, change: tuple[str, str], said: str) -> None:
    path = written(tmp_path, SCENARIO.replace(*change))
    with pytest.raises(DasError, match=said):
        prepare_service(read_scenario(path))


@pytest.mark.parametrize(
    ("change", "said", "kind"),
    [
        (('latest = "24:04:20"', "lowest_speed_kmh = 50"), r"speeds of Junction: expected none", DasError),
        (("position_km = 6\n", "position_km = 7\n"), r"position of End = '7000 m': expected a position on", InputError),
        (('"24:06:00"', '"24:03:50"'), r"arrival at End .* is \d+\.\d s too tight", InfeasibleError),
        (('"23:58:00"', '"99:58:00"'), r"expected at least 359920 s, because of the earliest", InputError),
        (('"flat-6km"', '"other"'), r"journey.route = 'other': expected flat-6km", InputError),
    ],
)
def test_a_journey_that_cannot_be_simulated_is_refused(
    tmp_path: Path, change: tuple[str, str], said: str, kind: type[DasError]
) -> None:
    path = written(tmp_path, journey=JOURNEY.replace(*change))
    with pytest.raises(kind, match=said):
        prepare_service(read_scenario(path))


def test_times_far_from_midnight_are_refused(tmp_path: Path) -> None:
    text = JOURNEY.replace('"23:58:00"', "").replace("departure = \n", "departure_s = 1e9\n")
    text = text.replace('departure = "24:02:30"\n', "").replace('arrival = "24:06:00"', "arrival_s = 1.1e9")
    text = text[: text.index("[[passings]]")]
    with pytest.raises(DasError, match="expected times from midnight, 0 to 240 h"):
        prepare_service(read_scenario(written(tmp_path, journey=text)))


DUE = DuePassing(name="P", s_m=100.0, earliest_ns=50 * 10**9, latest_ns=60 * 10**9, wish=True, tolerance_s=5.0)


@pytest.mark.parametrize(
    ("passed_s", "late_s", "words"),
    [(55, 0.0, "wish kept"), (64, 4.0, "wish kept"), (70, 10.0, "wish missed"), (40, -10.0, "wish missed")],
)
def test_a_passing_is_late_or_early_outside_its_window_and_missed_beyond_its_tolerance(
    passed_s: int, late_s: float, words: str
) -> None:
    kept = KeptPassing(due=DUE, passed_ns=passed_s * 10**9)
    assert (kept.late_s, kept.words) == (late_s, words)


def test_a_point_that_was_not_reached_has_no_time() -> None:
    (kept,) = keep([DUE], np.array([0, 10**9]), np.array([0.0, 50.0]))
    assert kept.words == "not reached"
    assert passings_as_rows([kept], 0)[0]["passed_s"] is None
    assert KeptPassing(due=replace(DUE, earliest_ns=0, latest_ns=0), passed_ns=1).words == ""


def test_recordings_state_the_passings_and_nonsense_in_them_is_none() -> None:
    assert recorded_passings(passing_metadata([DUE])) == (DUE,)
    assert passing_metadata([]) == {}
    one = '[{"name": "P", "s_m": 100.0, '
    wrong = (f'{one}"latest_ns": 1{"0" * 400}}}]', f'{one}"latest_ns": 1e400}}]', f'{one}"tolerance_s": []}}]')
    places = [f'[{{"name": "P", "s_m": {value}}}]' for value in ('"x"', "null", "NaN", "-1")]
    for text in ("[", "3", '[{"name": 1}]', '[{"name": 1, "s_m": 1}]', "[[]]", "null", *wrong, *places):
        assert recorded_passings({PASSINGS: text}) == (), text
    passing = Passing(name="P", position_m=100.0, window=Window(earliest_s=2.0))
    assert DuePassing.of(passing, 10**9) == DuePassing(name="P", s_m=100.0, earliest_ns=3 * 10**9)


def test_the_passings_are_printed_below_the_stops(capsys: pytest.CaptureFixture[str]) -> None:
    _, found = driven()
    result = DayResult(
        outcome=found,
        driver=DriverKind.PERFECT,
        advice=Presentation.SPEED_AND_EFFORT,
        happens="",
        drawn=day().drawn,
        wall_s=1.0,
    )
    print_result(result)
    out = re.sub(r"[ │]+", " ", capsys.readouterr().out)
    assert re.search(r"Bridge 1:\d\d", out)
    assert re.search(r"Junction … – 6:20 \d:\d\d \+0 s kept", out)
    assert re.search(r"Wish 5:00 ± 10 s \d:\d\d \+\d+ s wish missed", out)


def test_the_command_line_refuses_a_journey_that_is_not_there(tmp_path: Path) -> None:
    said = refusal("run", str(written(tmp_path)), "--journey", "nothing.toml", "--in-process", cwd=tmp_path)
    assert said.endswith("nothing.toml: no such file")
