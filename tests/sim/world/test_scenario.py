"""Scenario files: what they may say, what a seed draws from them, and how they are refused."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from das.domain.braking import USUAL
from das.domain.errors import DasError
from das.domain.restriction import Restriction
from das.domain.units import KMH
from das.solver.section import with_braking
from sim.world.disturbances import AnnouncedRestriction, as_figures, described
from sim.world.scenario import bundled_scenarios, load_scenario, read_scenario
from sim.world.service import Service, lay_out, make_day, prepare_service
from tests.support.flat_days import FLAT
from tests.support.freight import FREIGHT

RESTRICTED = "[[disturbances]]\nkind = 'restriction'\nfrom_km = 1\nto_km = 2\nspeed_kmh = 60\nannounced_m = 500\n"
DELAY = "[[disturbances]]\nkind = 'departure-delay'\n"
FAULT = "[[disturbances]]\nkind = 'sensor-fault'\nfrom_s = 1\nfor_s = 1\n"
AT = r"disturbances\[0\]\."
"""The beginning of the keys of the first disturbance, as a pattern."""
BAD = [
    ("x = 1", "x = 1: expected one of the keys"),
    ("[truth]\nmass_percent = 0", "truth.mass_percent = 0: expected a number from 1 to 1000"),
    ("[truth]\nhead_wind_kmh = -400", "truth.head_wind_kmh = -400: expected a number from -180 to 180"),
    ("[truth]\nmas_percent = 100", "truth.mas_percent"),
    ("[truth]\nadhesion_percent = 50", "truth.adhesive_mass_t is missing"),
    ("[truth]\nadhesive_mass_t = -1", "truth.adhesive_mass_t = -1"),
    ("[truth]\nmass_ratio = nan", r"toml: truth.mass_ratio = nan: expected a number$"),
    ("[sensors]\nposition_noise_m = -1", "sensors.position_noise_m = -1"),
    ("[sensors]\nposition_noise_m = nan", "sensors.position_noise_m"),
    ("[sensors]\nforce_noise_percent = -2", "sensors.force_noise"),
    ("[braking]\nplanning_brake_mps2 = 5", "braking.planning_brake_mps2 = 5: expected a number from 0.1 to 1.5"),
    ("[braking]\nbelow_limit_kmh = -2", "braking.below_limit_kmh = -2: expected a number from 0 to 20"),
    ("[braking]\nbrake_mps2 = 0.5", "braking.brake_mps2 = 0.5: expected one of the keys"),
    ("[coach]\nreaction_s = 2", r"coach = .*: expected braking, as coach is now called$"),
    ("[guide]\nreaction_s = 2", r"guide = .*: expected braking, as guide is now called$"),
    ("[[disturbances]]\nkind = 'rain'", AT + r"kind = 'rain': expected one of departure-delay"),
    ("[[disturbances]]\nstop = 'A'", AT + r"kind"),
    (DELAY + "delay_s = 9", AT + r"stop"),
    (DELAY + "stop = 'A'", AT + r"delay"),
    (DELAY + "stop = 'Z'\ndelay_s = 9", AT + r"stop = 'Z': .* A"),
    (DELAY + "stop = 'A'\ndelay_s = -9", AT + r"delay_s = -9"),
    (DELAY + "stop = 'A'\ndelay_s = {min = 9, max = 3}", "in this order"),
    (DELAY + "stop = 'A'\ndelay_s = {min = 9}", AT + r"delay_s.max is missing"),
    (DELAY + "stop = 'A'\ndelay_s = {min = 1, max = 2, mean = 3}", "mean"),
    (DELAY + "stop = 'A'\ndelay_s = 'long'", "long"),
    (FAULT + "fault = 'rust'", "one of dropout"),
    (FAULT + "fault = 'jump'", AT + r"size is missing"),
    (FAULT + "fault = 'noise'\nsize_m = 0", AT + r"size_m = 0: expected a number from 1 to 1e\+07"),
    (FAULT + "fault = 'frozen'\nsize_m = 9", AT + r"size_m = 9: expected one of the keys"),
    (
        "[[disturbances]]\nkind = 'node-restart'\nat_s = 1e300",
        AT + r"at_s = 1e\+300: expected a number from 0 to 86400",
    ),
    (
        RESTRICTED.replace("announced_m = 500", "announced_m = 1e300"),
        AT + r"announced_m = 1e\+300: expected a number from 0 to 1e\+07",
    ),
    (RESTRICTED.replace("to_km = 2", "to_km = 1"), AT + r"to_km = 1: expected more than from = 1000 m"),
    (
        RESTRICTED.replace("from_km = 1", "from_km = 7").replace("to_km = 2", "to_km = 8"),
        "from is at km 7: expected on the way, km 0 to 6",
    ),
    (
        RESTRICTED + "valid_from_s = 60\nvalid_until_min = 1",
        AT + r"valid_until_min = 1: expected more than valid_from = 60 s",
    ),
    (RESTRICTED + "valid_until_s = -1", AT + r"valid_until_s = -1: expected a number from 0 to 86400"),
    (RESTRICTED + "valid_from = 1", AT + r"valid_from = 1: expected one of the keys"),
    (RESTRICTED.replace("speed_kmh = 60", "speed_kmh = 0"), r"speed_kmh = 0: expected a number from 3.6 to 720"),
    (RESTRICTED.replace("speed_kmh", "speed_t"), AT + r"speed_t"),
    (RESTRICTED + "speed_mps = 9", "only one of"),
    (RESTRICTED.replace("_kmh = 60", "_kmh = {min = 50, max = 60}") + "speed_mps = 9", "only one of speed_mps and"),
    ("[[disturbances]]\nkind = 'head-wind'\nfrom_km = 1\nto_km = 2\nwind_kmh = 300", "a number from -180 to 180"),
    (
        "[[disturbances]]\nkind = 'slippery-rail'\nfrom_km = 1\nto_km = 2\nadhesion_ratio = 0.3",
        "truth.adhesive_mass_t is missing: expected the mass on driven axles",
    ),
]


@pytest.mark.parametrize(("more", "message"), BAD)
def test_a_bad_scenario_is_refused_with_its_key(flat: Callable[..., Path], more: str, message: str) -> None:
    path = flat(more, base=FLAT if more.startswith("[") else more + FLAT)
    with pytest.raises(DasError, match=message) as error:
        make_day(prepare_service(read_scenario(path)), 0)
    assert "\n" not in str(error.value)


BAD_HEADS = [
    ("schema_version = 1", "schema_version = 2", "schema_version = 2: expected 1"),
    ('title = "Flat"', "", "scenario.title"),
    ('id = "flat"', 'id = "../flat"', "scenario.id = '../flat': expected 1 to 64 letters"),
    ('route = "flat-6km"', 'route = "nowhere"', r"s\d+.toml: scenario: nowhere: not a bundled route"),
    ('route = "flat-6km"', 'route = "nowhere.toml"', "nowhere.toml: no such file"),
    ('vehicle = "re460-ic"', 'vehicle = "re460-ic"\nload = "full"', "no load 'full'"),
    ('vehicle = "re460-ic"', 'vehicle = "re460-ic"\nto = "Q"', "Q"),
    ("buffer_percent = 10", "buffer_percent = -1", "timetable.buffer_percent = -1: expected a number from 0 to 1000"),
    ("buffer_percent = 10", "dwell_s = -1", "timetable.dwell_s = -1"),
    ("buffer_percent = 10", "dwell_s = 1e300", r"timetable.dwell_s = 1e\+300: expected a number from 0 to 86400"),
    ("buffer_percent = 10", "departure = '1960-01-01T00:00:00Z'", "a time in 1970 to 2199"),
    ("buffer_percent = 10", "departure = '9999-12-31T00:00:00Z'", "a time in 1970 to 2199"),
    ("buffer_percent = 10", "departure = 'noon'", "timetable.departure = 'noon': expected a time with its zone"),
    ("buffer_percent = 10", "departure = '2026-11-21T08:04:00'", "a time with its zone"),
    ("buffer_percent = 10", "running_s = 234", "timetable.running_s = 234: expected a list of times, one for each"),
    (
        "buffer_percent = 10",
        "running_s = [0]",
        r"timetable.running_s\[0\] = 0: expected more than 0, and a number from",
    ),
    ("buffer_percent = 10", "running_min = ['x']", r"timetable.running_min\[0\] = 'x': expected a number"),
    (
        "buffer_percent = 10",
        "running_s = [99, 99]",
        "timetable.running_s = '2 times': expected one for each of the 1 sec",
    ),
    ("buffer_percent = 10", "running_s = [99]\nrunning_min = [2]", "running_min = .2.: expected none with running_s"),
    (
        "buffer_percent = 10",
        "buffer_percent = 10\nrunning_s = [99]",
        "buffer_percent = 10: expected none with running_s",
    ),
    ("[scenario]", "[scenery]", "scenery"),
    ("schema_version = 1", "schema_version = 1\ndisturbances = 3", "disturbances = 3: expected a list"),
]


@pytest.mark.parametrize(("old", "new", "message"), BAD_HEADS)
def test_a_bad_head_is_refused_with_its_key(flat: Callable[..., Path], old: str, new: str, message: str) -> None:
    with pytest.raises(DasError, match=message):
        prepare_service(read_scenario(flat(base=FLAT.replace(old, new))))


def test_a_scenario_without_a_file_is_refused() -> None:
    with pytest.raises(DasError, match="not a bundled scenario"):
        load_scenario("nothing")
    with pytest.raises(DasError, match="no such file"):
        load_scenario("nothing.toml")


def test_units_defaults_and_files_beside_the_scenario(flat: Callable[..., Path]) -> None:
    path = flat(RESTRICTED.replace("speed_kmh = 60", "speed_kmh = {min = 36, max = 72}"))
    scenario = read_scenario(path)
    assert scenario.dwell_s == 60
    assert scenario.departure_ns == 1_795_248_240_000_000_000
    (drawn,) = scenario.day(4)
    assert isinstance(drawn, AnnouncedRestriction)
    assert 10 <= drawn.speed_mps <= 20
    assert (drawn.from_m, drawn.to_m, drawn.announced_m) == (1000, 2000, 500)
    beside = read_scenario(flat(base=FLAT.replace('"flat-6km"', '"lines/here.toml"')))
    assert beside.route == str(path.parent / "lines" / "here.toml")
    assert load_scenario("clear-day").departure_ns == scenario.departure_ns


def test_every_field_of_a_restriction_is_announced_and_survives_a_scenario_file(flat: Callable[..., Path]) -> None:
    service = prepare_service(read_scenario(flat("")))
    one = Restriction(1000.0, 2000.0, 10.0, service.moment_ns(30.0), service.moment_ns(120.0))
    assert all(vars(one).values()), "a field without a value could be lost unseen"
    announced = AnnouncedRestriction.of(one, 500.0, service.clock_s)
    assert vars(announced.restriction(service.moment_ns)) == vars(one)
    (figures,) = as_figures([announced])
    text = "\n".join(["[[disturbances]]", *(f"{name} = {json.dumps(value)}" for name, value in figures.items())])
    assert read_scenario(flat(text)).day(4) == (announced,)


def test_a_restriction_may_have_a_window_on_the_runs_clock(flat: Callable[..., Path]) -> None:
    window = "valid_from_s = {min = 30, max = 40}\nvalid_until_min = 2\n"
    days = [read_scenario(flat(RESTRICTED + more)).day(4) for more in ("", window)]
    (always,), (drawn,) = days
    assert isinstance(always, AnnouncedRestriction)
    assert isinstance(drawn, AnnouncedRestriction)
    assert drawn.valid_from_s is not None
    assert 30 <= drawn.valid_from_s <= 40
    assert drawn.valid_until_s == 120
    assert "valid_until_s" not in as_figures(days[0])[0]
    assert as_figures(days[1])[0]["valid_until_s"] == 120
    assert described(days[0]) == "restriction to 60 km/h from km 1.0 to 2.0, told 500 m ahead"
    said = f"valid from {drawn.valid_from_s:.0f} s until 120 s, told 500 m ahead"
    assert described(days[1]) == f"restriction to 60 km/h from km 1.0 to 2.0, {said}"
    told = drawn.restriction(lambda clock_s: round(clock_s * 10**9) + 1)
    assert told.valid_until_ns == 120 * 10**9 + 1
    assert always.restriction(round) == Restriction(1000.0, 2000.0, 60 * KMH)


def test_a_seed_is_a_day() -> None:
    scenario = load_scenario("departure-delay")
    assert scenario.day(3) == scenario.day(3)
    drawn = [scenario.day(seed)[0].delay_s for seed in range(200)]  # type: ignore[union-attr]
    assert len(set(drawn)) == 200
    assert 60 <= min(drawn) < 66
    assert 174 < max(drawn) <= 180
    assert np.mean(drawn) == pytest.approx(120, abs=4 * 120 / np.sqrt(12 * 200))


def test_what_happens_is_said_as_people_say_it() -> None:
    said = described(load_scenario("restriction-ahead").day(0))
    assert said == "restriction to 60 km/h from km 18.0 to 19.5, told 5000 m ahead"
    assert described(load_scenario("clear-day").day(0)) == "nothing"
    for name in bundled_scenarios():
        assert described(load_scenario(name).day(0))


@pytest.mark.parametrize(("calls", "stops"), [("[]", 2), ('["thalwil"]', 3), ('["Thalwil", "Zug"]', 4)])
def test_a_train_calls_where_the_scenario_says(flat: Callable[..., Path], calls: str, stops: int) -> None:
    text = FLAT.replace('"flat-6km"', '"zurich-luzern"').replace("[timetable]", f"calls = {calls}\n[timetable]")
    assert len(lay_out(read_scenario(flat(base=text)))[2]) == stops


@pytest.mark.parametrize(
    ("calls", "message"),
    [('["Bern"]', r"scenario.calls has 'Bern': expected some of A, B"), ("3", "scenario.calls = 3")],
)
def test_a_call_that_cannot_be_is_refused(flat: Callable[..., Path], calls: str, message: str) -> None:
    path = flat(base=FLAT.replace("[timetable]", f"calls = {calls}\n[timetable]"))
    with pytest.raises(DasError, match=message):
        lay_out(read_scenario(path))


BOARDS = """
schema_version = 1
route = {id = "boards", name = "boards", length_km = 5.0}
stops = [{name = "A", position_km = 0}, {name = "B", position_km = 5.0}]
speed_limits = {columns = ["position_km", "limit_kmh"], rows = [[0, 120], [4.94, 40]]}
gradients = {columns = ["position_km", "gradient_permille"], rows = [[0, 0], [3, 6]]}
"""
"""A line on which much of the time is that of braking."""


@pytest.fixture
def braked_late(tmp_path: Path) -> Callable[[str], Service]:
    """The service of a train that brakes gently, by the text of its timetable."""
    (tmp_path / "line.toml").write_text(BOARDS, encoding="utf-8")
    (tmp_path / "train.toml").write_text(FREIGHT.replace("mass_t = 1350", "mass_t = 1600"), encoding="utf-8")
    head = 'schema_version = 1\n[scenario]\nid = "late"\ntitle = "Late"\nroute = "line.toml"\nvehicle = "train.toml"\n'

    def prepared(timetable: str) -> Service:
        path = tmp_path / "day.toml"
        path.write_text(f"{head}[timetable]\n{timetable}\n", encoding="utf-8")
        return prepare_service(read_scenario(path))

    return prepared


def running_s(service: Service) -> list[float]:
    return [(table.arrival_ns - table.departure_ns) * 1e-9 for table in service.timetables]


def test_a_buffer_is_on_top_of_what_the_train_needs_as_the_advice_brakes(
    braked_late: Callable[[str], Service],
) -> None:
    service = braked_late("buffer_percent = 8")
    section = service.fronts[0].section
    least_s = with_braking(section, USUAL.of(service.vehicle)).fastest_run.time_to_go_s[0]
    full_s = service.fronts[0].fastest().time_s
    assert least_s > 1.08 * full_s + 6.0, "with full brakes, 8 % are less than the advice needs"
    assert 1.08 * least_s <= running_s(service)[0] < 1.08 * least_s + 6.0
    assert list(service.unkept()) == []


def test_a_timetable_that_the_advice_cannot_keep_is_said(braked_late: Callable[[str], Service]) -> None:
    service = braked_late("running_s = [336]")
    assert running_s(service) == [336.0]
    (line,) = service.unkept()
    assert re.search(
        r"day\.toml: A – B: 336 s in the timetable, a train braked as .* needs 3\d\d\.\d s: \d+\.\d s late", line
    )


def test_the_bundled_timetables_are_stated_as_times(flat: Callable[..., Path]) -> None:
    """Days before and after a change of how trains are braked compare."""
    for name in bundled_scenarios():
        assert load_scenario(name).running_s == (576.0, 642.0, 1080.0)
    timed = flat(base=FLAT.replace("buffer_percent = 10", "running_min = [3.9]"))
    assert running_s(prepare_service(read_scenario(timed))) == pytest.approx([234.0])
    assert load_scenario("clear-day").timed_by("zurich-luzern").running_s is None
