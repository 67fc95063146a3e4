"""The picture of a line: what it has panels for, and where its data come from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from das.domain.files.load import load_route
from das.domain.route import Route, Stretches
from das.drawing.picture import Picture, draw_fronts
from das.drawing.plotted import PlottedFront
from precompute.cli.route_report import draw_line

FLAT, HILLY = load_route("flat-6km"), load_route("zurich-luzern")


def labels(picture: Picture) -> list[str]:
    """The names of the vertical axes, from top to bottom."""
    return [axis.get_ylabel() for axis in picture.axes]


def test_a_line_has_a_panel_for_each_thing_that_is_known() -> None:
    assert labels(draw_line(FLAT)) == ["limit, km/h"]
    every = ["limit, km/h", "altitude, m", "gradient, ‰", "curvature, 1/km", "latitude, ° north"]
    assert labels(draw_line(HILLY)) == every
    straight = replace(HILLY, curvature_per_m=Stretches.constant(0.0))
    assert "curvature, 1/km" not in labels(draw_line(straight))


def test_all_panels_over_the_position_have_one_axis_and_the_map_its_own() -> None:
    *over, course = draw_line(HILLY).axes
    assert [axis.get_xlim() for axis in over] == [pytest.approx((-0.57, 57.57))] * len(over)
    assert course.get_xlim()[0] > 8.0
    assert sum(len(axis.patches) for axis in over) == 4 * len(HILLY.tunnels)


def test_source_and_licence_stand_in_the_picture_of_a_line_and_of_fronts() -> None:
    credited = replace(HILLY, data_source="© somebody", licence="CC0", one_way=True)
    title = draw_line(credited).get_suptitle()
    assert title.splitlines() == ["Zürich HB – Luzern (illustrative): 57.000 km, one way", "data: © somebody, CC0"]
    assert "data" not in draw_line(HILLY).get_suptitle()
    point = np.array([1.0])
    front = PlottedFront(names=("x",), buffer_percent=point, time_s=point, energy_j=point, credit="© somebody, CC0")
    assert draw_fronts([front, front]).get_suptitle().endswith("data: © somebody, CC0")


@pytest.mark.parametrize("latitude_deg", [89.9999, 0.0])
def test_a_line_at_a_pole_or_the_equator_is_drawn(latitude_deg: float, tmp_path: Path) -> None:
    place = np.array([latitude_deg - 0.05, latitude_deg])
    at_m, longitude = np.array([0.0, 6000.0]), np.array([8.0, 8.0])
    route = Route(**{**vars(FLAT), "geometry_position_m": at_m, "geometry_latitude_deg": place,
                     "geometry_longitude_deg": longitude})  # fmt: skip
    draw_line(route).save(tmp_path / "line.png")
    assert (tmp_path / "line.png").stat().st_size > 1000
