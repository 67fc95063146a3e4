"""Real lines imported from ../shared: lengths, limits and gradients that others have counted."""

from __future__ import annotations

import json
import random
import re
from pathlib import Path

import numpy as np
import pytest

from das.domain.files.load import load_route
from das.domain.plausibility import FEW_POINTS, FLAT, NOISY, SMOOTHED
from das.domain.route import Route
from docs.studies import own_lines
from docs.studies.own_lines import REAL_LINES, KnownSection, altitude_table, line_of, line_table
from precompute.route_import import imported
from precompute.route_import.altitudes import climb_and_fall_m
from precompute.route_import.line import ImportOrder, Words, route_toml
from tests.support.kept_figures import not_on_page
from tests.support.made_maps import same_line, written


@pytest.fixture(scope="module")
def lines(shared: Path) -> list[Route]:
    return [line_of(shared, one) for one in REAL_LINES]


def test_goerlitz_dresden_has_the_figures_of_its_table(lines: list[Route]) -> None:
    route = lines[1]
    gradients = route.gradients_ratio.value * 1000
    assert (route.length_m, len(route.limits_mps.value), len(gradients)) == (101_800, 69, 286)
    assert (gradients.max(), gradients.min()) == (pytest.approx(20), pytest.approx(-14))
    assert climb_and_fall_m(route) == pytest.approx((296.0, 202.7), abs=0.05)


def test_st_poelten_melk_has_its_length_and_limits_everywhere(lines: list[Route], shared: Path) -> None:
    route = lines[0]
    assert route.length_m == pytest.approx(22_200, rel=0.02)
    assert (route.limits_mps.value * 3.6).round().tolist() == [80, 60, 80, 100, 160, 200, 100, 140, 160, 110]
    assert route.credit == "© OpenStreetMap contributors, ODbL 1.0"


def test_paris_lyon_is_as_long_as_the_kilometre_posts_say(lines: list[Route]) -> None:
    """SNCF's line 830000 from km 0.047 to the end of its piece at km 511.411 (a little is cut at Lyon)."""
    assert lines[2].length_m == pytest.approx(511_364, abs=600)


@pytest.mark.nightly
def test_a_real_map_drawn_otherwise_gives_the_same_line(lines: list[Route], shared: Path, tmp_path: Path) -> None:
    """Ways cut and shuffled; their numbers of nodes stay."""
    source = REAL_LINES[0]
    answer = json.loads((shared / "lines" / source.files[0]).read_text(encoding="utf-8"))
    for seed in range(5):
        chance = random.Random(seed)
        elements = []
        for one in answer["elements"]:
            nodes = one.get("nodes", [])
            cut = chance.randrange(1, len(nodes) - 1) if len(nodes) > 3 else 0
            parts = (nodes[: cut + 1], nodes[cut:]) if cut else (nodes,)
            elements += [{**one, "nodes": part} for part in parts] if nodes else [one]
        chance.shuffle(elements)
        path = written(tmp_path / "map.json", {**answer, "elements": elements})
        order = ImportOrder(start=source.start, end=source.end, flat=True)
        assert same_line(imported([path], order, Words()).route, lines[0])


def test_the_page_says_what_the_import_finds(lines: list[Route]) -> None:
    page = own_lines.PAGE.read_text(encoding="utf-8")
    assert [row for row in line_table(lines) if row not in page] == []


@pytest.mark.slow
def test_the_page_says_what_altitudes_mean_on_a_bundled_section() -> None:
    """The probe of the results of 0.2."""
    *_, row = altitude_table([KnownSection(load_route("zurich-luzern"), 0, 1)])
    assert not_on_page(own_lines.PAGE.read_text(encoding="utf-8"), [row]) == []


def test_what_commands_say_of_altitudes_are_the_figures_of_the_page() -> None:
    table = own_lines.PAGE.read_text(encoding="utf-8").split("<!-- altitudes: begin -->")[1].split("<!--")[0]
    cells = [row.split("|")[3:7] for row in table.strip().splitlines()[2:]]
    flat, few, raw, smooth = (
        [float(x) for x in re.findall(r"[-+]\d+\.\d", " ".join(one))] for one in zip(*cells, strict=True)
    )
    assert f"{-max(flat):.0f} to {-min(flat):.0f} % too low" in FLAT
    assert f"up to {-min(few):.0f} % too low" in FEW_POINTS
    assert f"by {min(raw):+.0f} to {max(raw):+.0f} %" in NOISY
    assert f"by {min(smooth):+.0f} to {max(smooth):+.0f} %" in SMOOTHED


def test_a_freight_line_of_330_km_is_imported_and_written(tmp_path: Path) -> None:
    """Made up like ALTRIOS' Minneapolis–Hibbing: 3300 altitudes with a spike, limits in miles an hour."""
    at_km = np.arange(0.0, 330.01, 0.1)
    altitude_m = 250 + 60 * np.sin(at_km / 30) + 2 * np.random.default_rng(3).standard_normal(len(at_km))
    altitude_m[1000] += 25.0
    heights = "\n".join(f"{x:.1f},{z:.1f}" for x, z in zip(at_km, altitude_m, strict=True))
    (tmp_path / "heights.csv").write_text(f"position_km,altitude_m\n{heights}\n")
    rows = "\n".join(f"{x:.1f},{30 + 10 * (i % 4)}" for i, x in enumerate(at_km[::30]))
    (tmp_path / "limits.csv").write_text(f"position_km,limit_mph\n{rows}\n")
    order = ImportOrder(start="A", end="B", altitudes=tmp_path / "heights.csv", length_km=330.0)
    line = imported([tmp_path / "limits.csv"], order, Words())
    assert len(route_toml(line.route, line.remarks)) < 100_000
    assert climb_and_fall_m(line.route)[0] == pytest.approx(180, rel=0.12)
