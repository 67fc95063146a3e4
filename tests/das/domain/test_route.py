"""Routes: stretches against brute force over metre cells, reversal, altitude, curves, stops."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from das.domain.errors import DasError, InputError
from das.domain.files.load import load_route
from das.domain.restriction import Restriction
from das.domain.route import Route, Stop, Stretches, Tunnel, section_stops

LENGTH_M = 60


def stretches(*rows: tuple[float, float]) -> Stretches:
    return Stretches(start_m=np.array([r[0] for r in rows], float), value=np.array([r[1] for r in rows], float))


@st.composite
def any_stretches(draw: st.DrawFn) -> Stretches:
    starts = [0, *sorted(draw(st.sets(st.integers(1, LENGTH_M - 1), max_size=8)))]
    values = draw(st.lists(st.integers(-20, 20), min_size=len(starts), max_size=len(starts)))
    return stretches(*zip(starts, values, strict=True))


@st.composite
def any_interval(draw: st.DrawFn) -> tuple[int, int]:
    first = draw(st.integers(-20, LENGTH_M + 10))
    return first, first + draw(st.integers(1, 60))


def brute(of: Stretches, position: float) -> float:
    """The value of the last stretch that has begun, the first before the line."""
    begun = [v for s, v in zip(of.start_m, of.value, strict=True) if s <= position]
    return float(begun[-1] if begun else of.value[0])


def cells(of: Stretches, interval: tuple[int, int]) -> list[float]:
    return [brute(of, metre + 0.5) for metre in range(*interval)]


@given(any_stretches(), st.floats(-10, LENGTH_M + 10))
def test_the_value_at_a_position(of: Stretches, position: float) -> None:
    assert of.at(position) == brute(of, position)


@given(any_stretches(), any_interval())
def test_mean_and_minimum_over_an_interval(of: Stretches, interval: tuple[int, int]) -> None:
    first, last = np.array([interval[0]], float), np.array([interval[1]], float)
    assert float(of.mean(first, last)[0]) == pytest.approx(np.mean(cells(of, interval)), abs=1e-9)
    assert float(of.minimum(first, last)[0]) == min(cells(of, interval))


@given(any_stretches(), st.sampled_from([1.0, -1.0]))
def test_reversal_is_the_view_from_the_other_end(of: Stretches, sign: float) -> None:
    back = of.reversed(LENGTH_M, sign)
    assert cells(back, (0, LENGTH_M)) == [sign * v for v in reversed(cells(of, (0, LENGTH_M)))]
    again = back.reversed(LENGTH_M, sign)
    assert again.start_m.tolist() == of.start_m.tolist()
    assert again.value.tolist() == of.value.tolist()


def line() -> Route:
    return Route(
        id="t",
        name="t",
        source="t.toml",
        illustrative=True,
        length_m=1000.0,
        stops=(
            Stop(name="Aarau", position_m=0.0),
            Stop(name="Brugg", position_m=400.0),
            Stop(name="3", position_m=1e3),
        ),
        limits_mps=stretches((0, 20), (300, 30)),
        gradients_ratio=stretches((0, 0.01), (500, -0.002)),
        curvature_per_m=stretches((0, 0), (100, 0.002), (200, 0)),
        tunnels=(Tunnel(start_m=600.0, length_m=100.0, area_m2=42.0),),
        altitude_at_start_m=400.0,
        geometry_position_m=np.array([0.0, 1000.0]),
        geometry_latitude_deg=np.array([47.0, 47.1]),
        geometry_longitude_deg=np.array([8.0, 8.3]),
    )


def test_a_route_reversed() -> None:
    back = line().reversed()
    assert [(s.name, s.position_m) for s in back.stops] == [("3", 0), ("Brugg", 600), ("Aarau", 1000)]
    assert back.gradients_ratio.value.tolist() == [0.002, -0.01]
    assert back.gradients_ratio.start_m.tolist() == [0, 500]
    assert back.curvature_per_m.start_m.tolist() == [0, 800, 900]
    assert back.tunnels == (Tunnel(start_m=300.0, length_m=100.0, area_m2=42.0),)
    assert back.altitude_at_start_m == pytest.approx(404.0)
    assert back.altitude_m([0.0, 500.0, 1000.0]) == pytest.approx([404.0, 405.0, 400.0])
    assert back.location_deg(250.0) == pytest.approx((47.075, 8.225))


def test_a_route_keeps_its_temporary_restrictions_in_either_direction() -> None:
    one, other = (Restriction(start_m=a, end_m=a + 100.0, limit_mps=v) for a, v in ((100.0, 10.0), (500.0, 15.0)))
    restricted = line().with_restrictions([one]).with_restrictions([other])
    assert restricted.restrictions == (one, other)
    back = restricted.reversed()
    assert [(x.start_m, x.end_m) for x in back.restrictions] == [(800.0, 900.0), (400.0, 500.0)]
    assert [float(back.limits_mps.at(x.start_m + 50.0)) for x in back.restrictions] == [10.0, 15.0]


def test_the_name_of_a_stop_at_a_position() -> None:
    assert [line().stop_name_at(s_m) for s_m in (0.5, 399.5, 402.0)] == ["Aarau", "Brugg", ""]


def test_a_route_reversed_twice_is_itself() -> None:
    there, again = line(), line().reversed().reversed()
    assert again.stops == there.stops
    assert again.tunnels == there.tunnels
    assert again.altitude_at_start_m == pytest.approx(400.0)
    assert again.breakpoints_m().tolist() == there.breakpoints_m().tolist() == [0, 100, 200, 300, 500, 600, 700]
    for one, other in zip(there.quantities(), again.quantities(), strict=True):
        assert one[1].value.tolist() == other[1].value.tolist(), one[0]
    assert again.geometry_latitude_deg.tolist() == [47.0, 47.1]


def test_a_route_with_a_change_exactly_at_its_end_can_be_reversed() -> None:
    route = replace(line(), limits_mps=stretches((0, 20), (1000, 10)))
    assert route.reversed().limits_mps.at([1.0, 999.0]).tolist() == [20, 20]


BAD_LINES = {
    "length": ({"length_m": 0.0}, r"length = 0.0: expected a length > 0 m"),
    "one stop": ({"stops": (Stop(name="A", position_m=0.0),)}, r"stops = 1: expected at least two stops"),
    "stop beyond": ({"length_m": 900.0}, r"stops\[2\] position = '1000 m': expected at most 900 m"),
    "stop before": (
        {"stops": (Stop(name="A", position_m=-1.0), Stop(name="B", position_m=2.0))},
        r"stops\[0\] position = '-1 m': expected a position >= 0 m",
    ),
    "stops in reverse": (
        {"stops": (Stop(name="A", position_m=5.0), Stop(name="B", position_m=5.0))},
        r"stops\[1\] position = '5 m': expected more than 5 m",
    ),
    "gap at the start": ({"gradients_ratio": stretches((10, 0))}, r"gradients\[0\] position = '10 m': expected 0 m"),
    "no limits": ({"limits_mps": stretches()}, r"speed limits = '\[\]': expected at least one entry"),
    "nan": ({"gradients_ratio": stretches((0, 0), (5, np.nan))}, r"gradients\[1\] = nan: expected a finite number"),
    "tunnel before the line": ({"tunnels": (Tunnel(start_m=-5.0, length_m=9.0, area_m2=42.0),)}, r"tunnels"),
    "tunnel beyond the line": ({"tunnels": (Tunnel(start_m=999.0, length_m=9.0, area_m2=42.0),)}, r"tunnels"),
}


@pytest.mark.parametrize(("changes", "expected"), BAD_LINES.values(), ids=BAD_LINES)
def test_a_bad_route_is_refused(changes: dict[str, object], expected: str) -> None:
    with pytest.raises(InputError, match=f"^t.toml: {expected}"):
        replace(line(), **changes)


def test_the_bundled_route_passes_through_the_altitudes_of_its_stops() -> None:
    route = load_route("zurich-luzern")
    altitude = route.altitude_m([stop.position_m for stop in route.stops])
    assert [stop.name for stop in route.stops] == ["Zürich HB", "Thalwil", "Zug", "Luzern"]
    assert altitude == pytest.approx([408, 435, 425, 436], abs=0.6)


@pytest.mark.parametrize(("wanted", "position_m"), [("Aarau", 0), ("bRUGG", 400), ("1", 0), ("2", 400), ("3", 1000)])
def test_a_stop_is_found_by_name_or_number(wanted: str, position_m: float) -> None:
    assert line().stop(wanted).position_m == position_m


@pytest.mark.parametrize("wanted", ["Olten", "", "0", "4", "-1", "1.0", "²", "١٢"])
def test_an_unknown_stop_is_refused_with_those_there_are(wanted: str) -> None:
    with pytest.raises(DasError, match=rf"^t.toml: no stop '{wanted}'; it has 1: Aarau, 2: Brugg, 3: 3$"):
        line().stop(wanted)


def test_a_section_leads_forwards() -> None:
    route = line()
    assert [s.name for s in section_stops(route, None, None)] == ["Aarau", "3"]
    assert [s.name for s in section_stops(route, "brugg", None)] == ["Brugg", "3"]
    assert [s.name for s in section_stops(route.reversed(), "brugg", "aarau")] == ["Brugg", "Aarau"]
    for start, end in (("Brugg", "Aarau"), ("Brugg", "2")):
        with pytest.raises(DasError, match=r"does not come after 'Brugg' in this direction; see --reverse"):
            section_stops(route, start, end)
    with pytest.raises(DasError, match="no stop 'Olten'"):
        section_stops(route, "Aarau", "Olten")


def test_a_one_way_line_cannot_be_reversed_and_says_why() -> None:
    line = replace(load_route("zurich-luzern"), one_way=True)
    with pytest.raises(
        DasError, match=r"one_way = true: its limits are those from .* to .*, and it cannot be reversed"
    ):
        line.reversed()
    first, last = line.stops[0].name, line.stops[-1].name
    with pytest.raises(DasError, match="the line is one_way"):
        section_stops(line, last, first)


def test_source_and_licence_are_the_credit_of_a_line() -> None:
    plain = load_route("zurich-luzern")
    assert plain.credit == ""
    assert replace(plain, data_source="a survey").credit == "a survey"
    line = replace(plain, data_source="a survey", licence="CC0")
    assert line.credit == "a survey, CC0"
    assert "data: a survey, CC0" in repr(line)
    assert line.reversed().credit == line.credit
