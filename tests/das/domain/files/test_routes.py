"""Route and journey files: what good ones give, tables of bad ones with their messages, and the command on journeys."""

from __future__ import annotations

import copy
import csv
import json
import math
import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from das.domain.errors import DasError, InputError
from das.domain.files.load import catalogue, load_journey, load_route, load_vehicle
from das.domain.files.routes import read_route
from das.domain.journey import Window
from das.domain.route import Route, Stop
from das.offline.asked_journey import Call, Journey, Passing, clock
from das.solver.section import build_section
from das.solver.solve import solve_front
from precompute.cli.journey import JourneyFiles, StopsOptions
from precompute.cli.journey import journey as journey_command
from precompute.cli.options import LineOptions, TrainOptions, WorldOptions
from tests.das.domain.files.refusing import named, refused_with
from tests.support.benchmark import journey_path, track_path
from tests.support.making import das_precompute, in_a_process, make_route

ROUTE = """schema_version = 1
[route]
id = "r"
name = "R"
length_km = 3.0
[[stops]]
name = "A"
position_km = 0.0
altitude_m = 400.0
[[stops]]
name = "B"
position_m = 3000.0
[speed_limits]
columns = ["position_km", "limit_kmh"]
rows = [[0.0, 72.0], [1.5, 90]]
[gradients]
columns = ["position_m", "gradient_permille"]
rows = [[0.0, 0.0], [800, -8.0]]
[curves]
columns = ["position_km", "radius_start_m", "radius_end_m"]
rows = [[0.0, inf, inf], [0.3, inf, -400], [0.4, -400, -400]]
[tunnels]
columns = ["position_km", "length_km", "cross_section_m2"]
rows = [[1.0, 0.5, 42.0], [2.0, 0.5, 42.0]]
"""


def test_a_good_route(tmp_path: Path) -> None:
    path = tmp_path / "r.toml"
    path.write_text(ROUTE)
    route = load_route(str(path))
    assert [(s.name, s.position_m) for s in route.stops] == [("A", 0), ("B", 3000)]
    assert route.limits_mps.at([1499, 1500]) == pytest.approx([20, 25])
    assert route.gradients_ratio.at([799, 800]) == pytest.approx([0, -0.008])
    assert route.curvature_per_m.at([0, 300, 400, 2999]) == pytest.approx([0, 1 / 800, 1 / 400, 1 / 400])
    assert [(t.start_m, t.length_m, t.area_m2) for t in route.tunnels] == [(1000, 500, 42), (2000, 500, 42)]
    assert route.location_deg(0) is None
    assert route.zone.key == "UTC"


def test_a_route_names_its_time_zone(tmp_path: Path) -> None:
    path = tmp_path / "r.toml"
    path.write_text(ROUTE.replace('name = "R"', 'name = "R"\ntime_zone = "Europe/Zurich"'))
    assert load_route(str(path)).reversed().zone.key == "Europe/Zurich"
    assert load_route("zurich-luzern").time_zone == "Europe/Zurich"


BAD_ROUTES = [
    ("schema_version = 1", "schema_version = 9", r"schema_version = 9: expected 1"),
    ("length_km = 3.0", "length_mile = 3.0", r"route\.length_mile = 3\.0: expected one of the keys"),
    ("length_km = 3.0", "length_km = 3000000", r"route\.length_km = 3000000: expected a number of at most 1e\+06"),
    ("[1.5, 90]", "[1e300, 90]", r"speed_limits\.rows\[1\]\.position = 1e\+300: expected a number"),
    ('name = "A"', 'name = "\\u001b[31mA"', r"stops\[0\]\.name = '\\x1b\[31mA': expected a string of at most"),
    ('name = "A"', f'name = "{"A" * 300}"', r"stops\[0\]\.name = 'AAAA"),
    ('name = "R"', 'name = "R"\n"\\u001b[2J" = 1', r"route\.\\x1b\[2J = 1: expected one of the keys"),
    ("length_km = 3.0", 'length_km = 3.0\nillustrative = "yes"', r"route\.illustrative = 'yes': expected true or fals"),
    *(
        ('name = "R"', f'name = "R"\ntime_zone = {zone}', rf"route\.time_zone = .*: expected {expected}")
        for zone, expected in (
            *(('"Europe/Zuerich"', "a time zone like"), ('"Europe"', "a time zone like")),
            *(('"../etc/passwd"', "a time zone like"), ('""', "a time zone like"), ("1", "a string")),
        )
    ),
    ('name = "B"', 'nom = "B"', r"stops\[1\]\.nom = 'B': expected one of the keys"),
    ("position_m = 3000.0", "", r"stops\[1\]\.position is missing: expected position_m or position_km"),
    ("altitude_m = 400.0", 'altitude_m = "high"', r"stops\[0\]\.altitude_m = 'high': expected a number"),
    ("[gradients]", "[gradient]", r"gradient = .*: expected one of the keys .*gradients"),
    ('"limit_kmh"]', '"limit_knots"]', r"speed_limits\.columns = 'limit_knots': expected limit_mps or limit_kmh"),
    ('["position_km", "limit_kmh"]', '["limit_kmh", "position_km"]', r"speed_limits\.columns = 'limit_kmh': expected "),
    ('["position_km", "limit_kmh"]', '["position_km"]', r"speed_limits\.columns = .*: expected 2 names: position, lim"),
    ("[[0.0, 72.0], [1.5, 90]]", "[]", r"speed_limits\.rows = \[\]: expected a list of rows"),
    ("[[0.0, 72.0], [1.5, 90]]", "[[0.0]]", r"speed_limits\.rows\[0\] = \[0\.0\]: expected a row with a value for eve"),
    ("[1.5, 90]", "[1.5, 90, 7]", r"speed_limits\.rows\[1\] = \[1\.5, 90, 7\]: expected a row"),
    ("[1.5, 90]", "[1.5, nan]", r"speed_limits\.rows\[1\]\.limit = nan: expected a number"),
    ("[1.5, 90]", "[1.5, 0]", r"speed.limits.*\[1\].* = 0\.0: expected a speed > 0"),
    ("[0.4, -400, -400]", "[0.4, -40, -400]", r"curves\[2\] radius = -40\.0: expected a radius of at least 60 m"),
    ("[2.0, 0.5, 42.0]", "[1.4, 0.5, 42.0]", r"tunnels\[1\] position = '1400 m': expected at least 1500 m"),
    ("[2.0, 0.5, 42.0]", "[2.0, 0.0, 42.0]", r"tunnels\[1\] length_m = 0\.0: expected a finite number > 0"),
]


@pytest.mark.parametrize("change", BAD_ROUTES, ids=named(BAD_ROUTES))
def test_a_bad_route_is_refused_in_one_line(tmp_path: Path, change: tuple[str, str, str]) -> None:
    refused_with(read_route, tmp_path / "bad.toml", ROUTE, change)


# --- journeys ---------------------------------------------------------------------------------------------------

NATIVE = """schema_version = 1
[journey]
id = "j"
name = "J"
source = "made for this test"
route = "test"
[[stops]]
stop = "a"
departure = "07:10"
departure_latest = "07:10:30.5"
[[passings]]
name = "Junction"
position_km = 2.5
earliest_s = 26000
latest = "07:14:00"
lowest_speed_kmh = 36
highest_speed_mps = 20.0
[[stops]]
name = "Halt"
position_m = 4000
arrival_earliest = "07:15:00"
arrival = "07:16:00"
departure_min = 437
dwell_s = 45
[[stops]]
stop = "2"
arrival = "25:00:00"
"""
LINE = make_route(10_000.0, [(0.0, 30.0)])


def native(tmp_path: Path, text: str = NATIVE, route: Route = LINE) -> Journey:
    path = tmp_path / "journey.toml"
    path.write_text(text)
    return load_journey(str(path), route)


def test_a_native_journey_is_read(tmp_path: Path) -> None:
    journey = native(tmp_path)
    assert (journey.id, journey.name, journey.source) == ("j", "J", str(tmp_path / "journey.toml"))
    first, passing, halt, last = journey.points
    assert first == Call(name="A", position_m=0.0, departure=Window(earliest_s=25_800.0, latest_s=25_830.5))
    assert passing == Passing(
        name="Junction",
        position_m=2_500.0,
        window=Window(earliest_s=26_000.0, latest_s=26_040.0),
        lowest_mps=pytest.approx(10.0),
        highest_mps=20.0,
    )
    assert halt == Call(
        name="Halt",
        position_m=4_000.0,
        arrival=Window(earliest_s=26_100.0, latest_s=26_160.0),
        departure=Window(earliest_s=26_220.0),
        dwell_s=45.0,
    )
    assert last == Call(name="B", position_m=10_000.0, arrival=Window(latest_s=90_000.0))
    assert journey.calls == (first, halt, last)


BAD_NATIVE = [
    ("schema_version = 1", "schema_version = 2", r"schema_version = 2: expected 1"),
    ('route = "test"', 'route = "other"', r"journey\.route = 'other': expected test, the route it is planned on"),
    ("dwell_s = 45", "dwel_s = 45", r"stops\[1\]\.dwel_s = 45: expected one of the keys arrival,"),
    ("dwell_s = 45", "dwell_s = -1", r"dwell of Halt = -1\.0: expected a finite number >= 0"),
    ('stop = "a"', 'stop = "Bern"', r"stops\[0\]\.stop = 'Bern': expected a stop of the route \(test: no stop 'Bern';"),
    ('stop = "a"', 'stop = "a"\nname = "A"', r"stops\[0\]\.name = 'A': expected no name or position"),
    ('stop = "a"', 'stop = "a"\nposition_m = 0', r"stops\[0\]\.position_m = 0: expected no name or position"),
    ('stop = "a"', "stop = true", r"stops\[0\]\.stop = True: expected name or number of a stop of the route"),
    ('stop = "a"', "stop = 9", r"stops\[0\]\.stop = 9: expected a stop of the route \(test: no stop '9';"),
    ('name = "Halt"', "", r"stops\[1\]\.name is missing: expected a string"),
    ("position_m = 4000", "", r"stops\[1\]\.position is missing: expected position_m or position_km"),
    ("position_m = 4000", "position_m = 2500.5", r"position of Halt = '2500\.5 m': expected at least 1 m after Juncti"),
    ('stop = "2"', 'name = "Halt 2"\nposition_m = 10001', r"position of Halt 2 = '10001 m': expected a position"),
    ('arrival = "07:16:00"', 'arrival = "7.16"', r"stops\[1\]\.arrival = '7\.16': expected a time in quotes like"),
    ('arrival = "07:16:00"', "arrival = 07:16:00", r"stops\[1\]\.arrival = datetime.*: expected a time in quotes like"),
    ('arrival = "07:16:00"', 'arrival = "07:60:00"', r"stops\[1\]\.arrival = '07:60:00': expected a time in quotes li"),
    ('arrival = "07:16:00"', 'arrival = "07:16"\narrival_s = 1', r"stops\[1\]\.arrival_s = 1: expected only one of ar"),
    ('arrival = "07:16:00"', 'arrival = "07:14:59"', r"times of Halt = '26100 … 26099 s': expected an earliest time n"),
    ("departure_min = 437", "departure_latest_s = 26144", r"departure of Halt, latest = '26144 s': expected at least "),
    ("earliest_s = 26000", "earliest_s = -1e300", r"passings\[0\]\.earliest = -1e\+300: expected a time of at most"),
    ("earliest_s = 26000", "earliest_s = inf", r"times of Junction = 'inf … 26040 s': expected an earliest time not"),
    ("lowest_speed_kmh = 36", "lowest_speed_kmh = 73", r"speeds of Junction = '73 … 72 km/h': expected 0 <= lowest"),
    ("lowest_speed_kmh = 36", "lowest_speed_kmh = -1", r"speeds of Junction = '-1 … 72 km/h': expected 0 <= lowest"),
    ("highest_speed_mps = 20.0", "highest_speed_mps = 0", r"speeds of Junction = '36 … 0 km/h': expected 0 <= lowest"),
    ('departure = "07:10"', "", r"departure of A is missing: expected an earliest time: the journey begins there"),
    ('arrival = "25:00:00"', "", r"arrival at B is missing: expected a latest time: the journey ends by then"),
    ('arrival = "25:00:00"', 'arrival = "07:16:59"', r"arrival at B, latest = '26219 s': expected at least 26220 s, b"),
    ('arrival = "25:00:00"', 'arrival = "25:00"\ndwell_s = 5', r"departure or dwell of B = 'given': expected none at "),
    ('departure = "07:10"', 'departure = "07:10"\narrival_s = 5', r"arrival or dwell of A = 'given': expected none at"),
    ('[[stops]]\nstop = "2"\narrival', "[[passings]]\nstop = '2'\nlatest", r"last point = 'B': expected a stop"),
    ('[[passings]]', "[passings]", r"passings = \{.*\}: expected a list of \[\[passings\]\]"),
]  # fmt: skip


@pytest.mark.parametrize("change", BAD_NATIVE, ids=named(BAD_NATIVE))
def test_a_bad_native_journey_is_refused_in_one_line(tmp_path: Path, change: tuple[str, str, str]) -> None:
    refused_with(lambda path: load_journey(path, LINE), tmp_path / "journey.toml", NATIVE, change)


TTOBENCH: dict[str, Any] = {
    "metadata": {"id": "T1"},
    "timing points": {
        "units": {
            "position": "km",
            "lower time constraint": "min",
            "upper time constraint": "s",
            "lower speed constraint": "km/h",
            "upper speed constraint": "m/s",
        },
        "values": [
            [0, 1, 60, 0, 0],
            [1.5, None, 200, 36, None],
            [3, 5, 320, 0, 0],
            [3, 6, None, 0, 0],
            [4, None, None, 0, 0],
            [10, None, 1000, 0, 0],
        ],
    },
}


def ttobench(tmp_path: Path, data: Any) -> Journey:
    path = tmp_path / "journey.json"
    path.write_text(json.dumps(data))
    return load_journey(str(path), LINE)


def test_a_ttobench_journey_is_read(tmp_path: Path) -> None:
    journey = ttobench(tmp_path, TTOBENCH)
    assert journey.id == "T1"
    assert journey.points == (
        Call(name="0 m", position_m=0.0, departure=Window(earliest_s=60.0, latest_s=60.0)),
        Passing(name="1500 m", position_m=1_500.0, window=Window(latest_s=200.0), lowest_mps=pytest.approx(10.0)),
        Call(
            name="3000 m",
            position_m=3_000.0,
            arrival=Window(earliest_s=300.0, latest_s=320.0),
            departure=Window(earliest_s=360.0),
        ),
        Call(name="4000 m", position_m=4_000.0),
        Call(name="10000 m", position_m=10_000.0, arrival=Window(latest_s=1_000.0)),
    )


BAD_TTOBENCH: list[tuple[int, Any, str]] = [
    (
        1,
        [1.5, None, 200, 36],
        r"timing points\.values\[1\] = \[1\.5, None, 200, 36\]: expected 5 numbers: position, lower",
    ),
    (1, [None, None, 200, 36, None], r"timing points\.values\[1\]\.position = None: expected a number"),
    (1, [1.5, "5", 200, 36, None], r"timing points\.values\[1\]\.lower time constraint = '5': expected a number"),
    (1, [1.5, None, 200, 36, 9], r"speeds of 1500 m = '36 … 32\.4 km/h': expected 0 <= lowest speed <= highest"),
    (1, [1.5, None, 200, 36, 0], r"timing points at 1500 m = '1 rows': expected one, or two with speeds 0: a stop"),
    (1, [3, None, 200, 0, 0], r"timing points at 3000 m = '3 rows': expected one, or two with speeds 0: a stop"),
    (2, [3, 5, 320, 0, 5], r"timing points at 3000 m = '2 rows': expected one, or two with speeds 0: a stop"),
    (1, [0, None, 200, 0, 0], r"timing points at 0 m = '2 rows': expected one row at an end of the journey"),
    (0, [0, 1, 60, 0, None], r"first point = '0 m': expected a stop \(a journey has at least two\)"),
    (1, [5, None, 200, 36, None], r"position of 3000 m = '3000 m': expected at least 1 m after 5000 m \(5000 m\)"),
    (5, [10, None, None, 0, 0], r"arrival at 10000 m is missing: expected a latest time: the journey ends by then"),
    (5, [11, None, 1000, 0, 0], r"position of 11000 m = '11000 m': expected a position on test, 0 … 10000 m"),
]


@pytest.mark.parametrize(("index", "row", "expected"), BAD_TTOBENCH, ids=[str(case[1]) for case in BAD_TTOBENCH])
def test_a_bad_ttobench_journey_is_refused_in_one_line(tmp_path: Path, index: int, row: Any, expected: str) -> None:
    data = copy.deepcopy(TTOBENCH)
    data["timing points"]["values"][index] = row
    with pytest.raises(InputError, match=f"^{re.escape(str(tmp_path / 'journey.json'))}: {expected}"):
        ttobench(tmp_path, data)


def test_the_journey_of_the_benchmark_is_read() -> None:
    """It is in this project's own format; test_ttobench.py compares it with the library's file."""
    journey = load_journey(str(journey_path()), load_route(str(track_path("CH_StGallen_Wil"))))
    assert [point.position_m for point in journey.points] == [0.0, 12_500.0, 15_000.0, 20_000.0, 29_556.1]
    assert [call.position_m for call in journey.calls] == [0.0, 15_000.0, 29_556.1]
    assert journey.points[2] == Call(
        name="15000 m",
        position_m=15_000.0,
        arrival=Window(earliest_s=620.0, latest_s=680.0),
        departure=Window(earliest_s=800.0, latest_s=840.0),
    )


def test_every_bundled_journey_fits_its_route() -> None:
    for name in catalogue("journeys"):
        journey = load_journey(name, load_route(name))
        assert journey.id == name
        assert all(math.isfinite(call.departure.earliest_s) for call in journey.calls[:-1])


def test_a_journey_over_stops_is_free_but_for_its_ends() -> None:
    stops = [Stop(name=name, position_m=x) for name, x in (("A", 0.0), ("M", 4_000.0), ("B", 10_000.0))]
    journey = Journey.over_stops(stops, time_s=600.0, dwell_s=40.0)
    assert journey.points == (
        Call(name="A", position_m=0.0, departure=Window(earliest_s=0.0, latest_s=0.0)),
        Call(name="M", position_m=4_000.0, dwell_s=40.0),
        Call(name="B", position_m=10_000.0, arrival=Window(latest_s=600.0)),
    )
    with pytest.raises(InputError, match=r"^stops: arrival at B, latest = '39 s': expected at least 40 s, because of"):
        Journey.over_stops(stops, time_s=39.0, dwell_s=40.0)


@pytest.mark.parametrize(
    ("time_s", "shown"),
    [
        (0.0, "0:00:00.0"),
        (25_830.54, "7:10:30.5"),
        (59.96, "0:01:00.0"),
        (90_000.0, "25:00:00.0"),
        (-61.0, "-0:01:01.0"),
    ],
)
def test_times_are_shown_as_a_clock_shows_them(time_s: float, shown: str) -> None:
    assert clock(time_s) == shown


# --- the command ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path]:
    """The bundled journey: what `--json` printed, and the folder with run.csv and run.png."""
    folder = tmp_path_factory.mktemp("planned")
    words = ("journey", "zurich-luzern", "zurich-luzern", "re460-ic", "--json", "--out", "run.csv", "--plot", "run.png")
    done = in_a_process("precompute.cli", *words, cwd=folder)
    assert (done.returncode, done.stderr) == (0, "")
    return json.loads(done.stdout), folder


@pytest.mark.slow
def test_the_bundled_journey_keeps_its_windows(planned: tuple[dict[str, Any], Path]) -> None:
    result, sections = planned[0], planned[0]["hops"]
    assert [(section["from"], section["to"]) for section in sections] == [
        ("Zürich HB", "Thalwil"),
        ("Thalwil", "Zug"),
        ("Zug", "Luzern"),
    ]
    assert sections[0]["departure"] == {"time_s": 25_800.0, "held": "earliest"}
    assert 26_400.0 <= sections[1]["departure"]["time_s"] <= 26_440.0
    assert 27_090.0 <= sections[2]["departure"]["time_s"] <= 27_150.0
    assert sections[2]["arrival"] == {"time_s": pytest.approx(28_170.0, abs=0.01), "held": "latest"}
    (tunnel,) = sections[1]["passings"]
    assert (tunnel["time_s"], tunnel["held"]) == (pytest.approx(26_760.0, abs=0.01), "earliest")
    # One price of time up to the window that is held at its earliest, a higher one after it.
    assert (
        sections[0]["lambda_kw"][0]
        == sections[1]["lambda_kw"][0]
        < sections[1]["lambda_kw"][1]
        == sections[2]["lambda_kw"][0]
    )
    assert result["feasible"]
    assert 0.0 <= result["gap_ratio"] < 0.02
    assert result["energy_kwh"] == pytest.approx(sum(section["energy_kwh"] for section in sections))
    assert result["energy_kwh"] < result["others_kwh"]["proportional"] < result["others_kwh"]["fastest"]
    assert result["comfort_kwh"] == pytest.approx(250.0 * result["time_s"] / 3600.0)
    assert (
        0.05
        < sum(section["time_s"] for section in sections) / sum(section["min_time_s"] for section in sections) - 1
        < 0.08
    )


@pytest.mark.nightly
def test_the_csv_is_the_whole_journey_on_its_clock(planned: tuple[dict[str, Any], Path]) -> None:
    with (planned[1] / "run.csv").open() as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    assert (rows[0]["s_m"], rows[0]["t_s"], rows[-1]["s_m"]) == (0.0, 25_800.0, 57_000.0)
    assert rows[-1]["t_s"] == pytest.approx(28_170.0, abs=0.01)
    pairs = list(pairwise(rows))
    assert all(a["s_m"] <= b["s_m"] and a["t_s"] < b["t_s"] for a, b in pairs)
    dwells = [(a["s_m"], b["t_s"] - a["t_s"]) for a, b in pairs if a["s_m"] == b["s_m"]]
    assert dwells == [(12_000.0, pytest.approx(45.0, abs=0.01)), (29_000.0, pytest.approx(60.0, abs=0.01))]
    assert (planned[1] / "run.png").read_bytes().startswith(b"\x89PNG")


def plan_journey(
    journey: str, route: str, *, out: Path | None = None, plot: Path | None = None, **times: float | None
) -> None:
    """The command as a function: the bundled train on a route."""
    journey_command(
        journey,
        LineOptions(route=route),
        TrainOptions(vehicle="re460-ic"),
        WorldOptions(),
        StopsOptions(**times),
        JourneyFiles(out=out, plot=plot),
    )


SHORT = """
schema_version = 1
route = {id = "short", name = "Two sections", length_km = 7.0}
stops = [{name = "A", position_km = 0.0}, {name = "B", position_km = 2.5}, {name = "C", position_km = 7.0}]
speed_limits = {columns = ["position_km", "limit_kmh"], rows = [[0.0, 80.0], [3.0, 140.0]]}
gradients = {columns = ["position_km", "gradient_permille"], rows = [[0.0, 3.0], [2.0, -3.0]]}
"""


def test_all_stops_are_a_journey_and_the_table_says_what_it_saves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "short.toml"
    path.write_text(SHORT, encoding="utf-8")
    plan_journey("stops", str(path), buffer_percent=7.0, dwell_s=60.0)
    printed = capsys.readouterr().out
    route, train = load_route(str(path)), load_vehicle("re460-ic")
    least_s = [
        solve_front(build_section(route, train, start_m=a.position_m, end_m=b.position_m)).fastest().time_s
        for a, b in pairwise(route.stops)
    ]
    whole = re.escape(clock(1.07 * sum(least_s) + 60.0))
    found = re.search(rf"in total {whole}, ([\d.]+) kWh, gap to the lower bound 0\.\d+ %", printed)
    assert found, printed
    assert re.search(rf"B – C .* ≤ {whole}", printed)
    other = re.search(r"with the same buffer everywhere: ([\d.]+) kWh, the plan saves ([\d.]+) %", printed)
    assert other, printed
    assert float(other[2]) == pytest.approx(100 * (1 - float(found[1]) / float(other[1])), abs=0.02)


@pytest.mark.parametrize(
    ("journey", "route", "options", "expected"),
    [
        ("stops", "flat-6km", {}, r"stops: give either --time \(s\) or --buffer \(%\)$"),
        ("stops", "flat-6km", {"time_s": 9.0, "buffer_percent": 9.0}, r"stops: give either --time \(s\) or --buffer"),
        ("stops", "flat-6km", {"buffer_percent": -1.0}, r"buffer -1\.0 %: expected a number from 0 to 10000$"),
        (
            "stops",
            "flat-6km",
            {"time_s": 100.0},
            r"stops: arrival at B \(latest 0:01:40\.0\) is [\d.]+ s too tight: aft",
        ),
        (
            "zurich-luzern",
            "flat-6km",
            {},
            r".*zurich-luzern\.toml: journey\.route = 'zurich-luzern': expected flat-6km",
        ),
        ("stops", "flat-6km", {"time_s": 300.0, "out": Path("no/x")}, r"no/x: no such folder no$"),
        (
            "stops",
            "flat-6km",
            {"out": Path("x.png"), "plot": Path("x.png")},
            r"x\.png: two outputs name the same file$",
        ),
    ],
)
def test_what_cannot_be_planned_is_refused(journey: str, route: str, options: dict[str, Any], expected: str) -> None:
    with pytest.raises(DasError, match=f"^{expected}"):
        plan_journey(journey, route, **options)


def test_a_refusal_is_one_line_and_writes_nothing(tmp_path: Path) -> None:
    done = das_precompute(tmp_path, "journey", "nix", "flat-6km", "re460-ic", "--out", "x.csv")
    assert (done.returncode, done.stdout) == (2, "")
    expected = r"error: nix: not a bundled journey \(zurich-luzern\) and not a \.toml or \.json file\n"
    assert re.fullmatch(expected, done.stderr)
    assert list(tmp_path.iterdir()) == []


PASSING = """
schema_version = 1
journey = {id = "x", name = "x"}
stops = [{name = "A", position_km = 0, departure_s = 0}, {name = "B", position_km = 5, arrival_s = 300}]
[[passings]]
name = "P"
position_km = 2
"""


def passing(tmp_path: Path, text: str) -> Passing:
    path = tmp_path / "journey.toml"
    path.write_text(PASSING + text, encoding="utf-8")
    (found,) = load_journey(path, None).passings
    return found


def test_a_journey_whose_points_have_positions_needs_no_route(tmp_path: Path) -> None:
    assert passing(tmp_path, "") == Passing(name="P", position_m=2000.0)
    with pytest.raises(
        InputError, match=r"stops\[0\].stop = 'Zürich HB': expected name and position, because no route"
    ):
        load_journey("zurich-luzern", None)


def test_a_passing_has_a_window_a_time_or_a_wish(tmp_path: Path) -> None:
    assert passing(tmp_path, 'time = "00:02:00"').window == Window.at(120.0)
    assert passing(tmp_path, "earliest_s = 100").window == Window(earliest_s=100.0)
    wished = passing(tmp_path, "time_s = 120\nwish = true")
    assert (wished.wish, wished.tolerance_s, wished.tolerated) == (True, 30.0, Window(earliest_s=90.0, latest_s=150.0))
    assert [wished.missed_s(x) for x in (80.0, 90.0, 120.0, 151.0)] == [-10.0, 0.0, 0.0, 1.0]
    loose = passing(tmp_path, "latest_s = 120\nwish = true\ntolerance_min = 1")
    assert (loose.tolerance_s, loose.missed_s(200.0), loose.missed_s(0.0)) == (60.0, 20.0, 0.0)


def test_a_wish_may_contradict_what_is_enforced(tmp_path: Path) -> None:
    assert passing(tmp_path, "time_s = 9000\nwish = true").window == Window.at(9000.0)
    with pytest.raises(InputError, match="arrival at B, latest = '300 s': expected at least 9000 s"):
        passing(tmp_path, "time_s = 9000")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time_s = 1\nlatest_s = 2", r"latest_s = 2: expected no window together with time_s"),
        ("tolerance_s = 10", r"tolerance_s = 10: expected no tolerance without wish = true"),
        ("wish = true", r"times of P is missing: expected a time, because the passing is a wish"),
        ("wish = 1", r"wish = 1: expected true or false"),
        ("time_s = 1\nwish = true\ntolerance_s = -1", r"tolerance_s = -1: expected a number from 0 to 3600"),
        ('time = "noon"', r"time = 'noon': expected a time in quotes"),
    ],
)
def test_passings_that_make_no_sense_are_refused(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        passing(tmp_path, text)
