"""The file of a route: what is written is read back as it was."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from das.domain.files.load import catalogue, load_route
from das.domain.route import Altitudes, Route, Stretches, Zone
from precompute.route_import.line import route_toml
from tests.support.made_maps import ROUTE, same_line


def read_back(folder: Path, route: Route, *remarks: str) -> Route:
    path = folder / "written.toml"
    path.write_text(route_toml(route, remarks), encoding="utf-8")
    return load_route(path)


@pytest.mark.parametrize("name", catalogue("routes"))
def test_a_bundled_route_is_written_and_read_back(tmp_path: Path, name: str) -> None:
    route = load_route(name)
    again = read_back(tmp_path, route)
    assert again.limits_mps.value == pytest.approx(route.limits_mps.value, rel=1e-9)
    assert again.gradients_ratio.value == pytest.approx(route.gradients_ratio.value, abs=1e-9)
    assert again.curvature_per_m.value == pytest.approx(route.curvature_per_m.value, abs=1e-12)
    for key in ("length_m", "stops", "tunnels", "time_zone", "altitude_at_start_m", "one_way", "altitudes"):
        assert getattr(again, key) == getattr(route, key), key
    assert same_line(replace(again, curvature_per_m=route.curvature_per_m), route)


def test_every_key_comes_back(tmp_path: Path) -> None:
    route = replace(
        ROUTE,
        name='A "quoted" name \\ – with ü',
        data_source='somebody\'s "map"',
        licence="CC0",
        one_way=True,
        altitudes=Altitudes.SMOOTHED,
        receptivity_ratio=Stretches(start_m=np.array([0.0, 5000.0]), value=np.array([1.0, 0.5])),
        neutral_sections=(Zone(start_m=100.0, length_m=80.0),),
        no_regeneration=(Zone(start_m=900.0, length_m=80.5),),
    )
    again = read_back(tmp_path, route, "A remark that is\na little longer.", "x" * 300)
    for key in ("name", "data_source", "licence", "one_way", "altitudes", "neutral_sections", "no_regeneration"):
        assert getattr(again, key) == getattr(route, key), key
    assert again.receptivity_ratio.value.tolist() == [1.0, 0.5]


def test_the_file_keeps_within_120_columns_and_says_what_was_assumed(tmp_path: Path) -> None:
    text = route_toml(ROUTE, ["Altitudes are assumed, and " + "so on " * 40])
    assert max(map(len, text.splitlines())) <= 120
    assert text.splitlines()[1].startswith("# Altitudes are assumed, and so on")
    assert tomllib.loads(text)["route"]["id"] == "example-line"
