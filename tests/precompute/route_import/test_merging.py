"""Routes put together from several, and new ones."""

from __future__ import annotations

from dataclasses import replace

import pytest

from das.domain.errors import DasError
from das.domain.route import Altitudes
from precompute.route_import.merging import PARTS, merged, new_line
from precompute.route_import.order import Words
from tests.support.made_maps import ROUTE

OTHER = replace(
    new_line(["Adorf=0", "Cedorf=14.1"], 25.0, Words(id="other", licence="CC0")).route,
    data_source="a survey",
    altitudes=Altitudes.POINTS,
)


@pytest.mark.parametrize("part", PARTS)
def test_a_part_is_taken_from_the_other_route_and_the_rest_stays(part: str) -> None:
    found = merged(ROUTE, {part: OTHER}, Words()).route
    taken = {name for name in PARTS[part] if name not in ("altitude_at_start_m",)}
    for name in {name for names in PARTS.values() for name in names}:
        source = OTHER if name in taken else ROUTE
        if name == "limits_mps":
            assert getattr(found, name).value == pytest.approx(getattr(source, name).value), name
        elif name == "stops":
            assert [x.name for x in found.stops] == [x.name for x in source.stops]
        elif name == "altitudes":
            assert found.altitudes is source.altitudes
    assert found.length_m == ROUTE.length_m
    assert found.credit == "made by the driver advisory system developers as an example; a survey, CC0"


def test_positions_are_scaled_and_it_is_said() -> None:
    line = merged(OTHER, {"limits": ROUTE}, Words(name="Together"))
    assert line.route.limits_mps.start_m == pytest.approx(ROUTE.limits_mps.start_m * 14.1 / 14.0, abs=1e-3)
    assert line.route.name == "Together"
    assert "positions times 1.007143" in line.remarks[1]


@pytest.mark.parametrize("length_km", [13.9, 14.1])
def test_a_geometry_is_scaled_to_a_shorter_or_longer_line(length_km: float) -> None:
    """The geometry of the example ends with its line, at 14 km."""
    base = new_line(["Adorf=0", f"Cedorf={length_km}"], 25.0, Words()).route
    found = merged(base, {"geometry": ROUTE}, Words()).route
    assert found.geometry_position_m == pytest.approx(ROUTE.geometry_position_m * length_km / 14.0)
    assert found.geometry_latitude_deg.tolist() == ROUTE.geometry_latitude_deg.tolist()


def test_another_line_is_refused() -> None:
    with pytest.raises(DasError, match=r"15\.000 km: expected the same line|14\.000 km long"):
        merged(new_line(["A=0", "B=15"], 20.0, Words()).route, {"limits": ROUTE}, Words())


def test_the_result_is_one_way_if_what_depends_on_the_direction_is() -> None:
    one_way = replace(OTHER, one_way=True)
    assert merged(ROUTE, {"limits": one_way}, Words()).route.one_way
    assert not merged(ROUTE, {"gradients": one_way}, Words()).route.one_way
    assert merged(one_way, {"limits": ROUTE}, Words()).route.one_way
    assert not merged(one_way, {"limits": ROUTE, "supply": ROUTE}, Words()).route.one_way


@pytest.mark.parametrize(
    "stops",
    [[], ["A=0"], ["A=1", "B=2"], ["A", "B=2"], ["A=0", "B=x"], ["=0", "B=2"], ["A=0", "B=-2"], ["A=0", "B=inf"]],
)
def test_a_new_line_needs_two_stops_with_positions(stops: list[str]) -> None:
    with pytest.raises(DasError, match="expected"):
        new_line(stops, 20.0, Words())
