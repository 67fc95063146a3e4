"""Every colour of the pictures means one thing, and people can tell the colours apart."""

from __future__ import annotations

import re
from itertools import combinations

import numpy as np
import pytest
from numpy.typing import NDArray

from das.drawing.colors import MODES
from sim.drive.series import STYLES
from sim.drivers.kinds import Presentation
from sim.drivers.presentations.presenter import presenter_of
from sim.meanings import COMPARED, DARK, LIGHT, VIEWER, Meaning, Theme, rgba
from tests.support.making import REPOSITORY

Floats = NDArray[np.float64]
THEMES = (DARK, LIGHT, VIEWER)

TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
"""Linear sRGB to XYZ (IEC 61966-2-1)."""
TO_LMS = np.array([[17.8824, 43.5161, 4.11935], [3.45565, 27.1554, 3.86714], [0.0299566, 0.184309, 1.46709]])
WITHOUT_L = np.array([[0.0, 2.02344, -2.52581], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
WITHOUT_M = np.array([[1.0, 0.0, 0.0], [0.494207, 0.0, 1.24827], [0.0, 0.0, 1.0]])
"""Dichromats' vision after Viénot, Brettel and Mollon (1999): protanopia and deuteranopia."""
EYES = {"usual": np.eye(3), "protanopia": WITHOUT_L, "deuteranopia": WITHOUT_M}


def linear(color: str) -> Floats:
    rgb = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def lab(color: str, eye: str = "usual") -> Floats:
    """CIELAB (D65) of a colour as an eye sees it."""
    seen = np.linalg.inv(TO_LMS) @ EYES[eye] @ TO_LMS @ linear(color)
    xyz = TO_XYZ @ np.clip(seen, 0.0, 1.0) / np.array([0.9505, 1.0, 1.089])
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def apart(one: str, other: str, eye: str = "usual") -> float:
    return float(np.linalg.norm(lab(one, eye) - lab(other, eye)))


def contrast(one: str, other: str) -> float:
    """The ratio of luminances of WCAG 2."""
    low, high = sorted(float(TO_XYZ[1] @ linear(color)) for color in (one, other))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("theme", THEMES, ids=lambda theme: theme.name)
def test_a_colour_means_one_thing(theme: Theme) -> None:
    assert set(theme.of) == set(Meaning)
    lane = presenter_of(Presentation.TOP_SPEED).lane
    assert lane is not None
    named = {**theme.of, **MODES, lane.text: lane.color}
    near = {(a, b): round(apart(named[a], named[b]), 1) for a, b in combinations(named, 2)}
    assert {pair: much for pair, much in near.items() if much < 12.0} == {}


@pytest.mark.parametrize("theme", THEMES, ids=lambda theme: theme.name)
@pytest.mark.parametrize("eye", EYES)
def test_lines_on_one_axis_differ_for_any_colour_vision(theme: Theme, eye: str) -> None:
    for panel in {name.split("/")[0] for name in STYLES}:
        lines = {style.meaning for name, style in STYLES.items() if name.startswith(f"{panel}/")}
        for one, other in combinations(lines, 2):
            assert apart(theme.of[one], theme.of[other], eye) > 12.0, (panel, one, other)


@pytest.mark.parametrize("eye", EYES)
def test_drives_that_are_compared_differ_for_any_colour_vision_and_borrow_no_other_meaning(eye: str) -> None:
    assert COMPARED[:2] == (LIGHT.of[Meaning.OTHER_DRIVE], LIGHT.of[Meaning.DRIVEN])
    assert min(apart(own, other) for own in COMPARED[2:] for other in (*LIGHT.of.values(), *MODES.values())) > 12.0
    together = combinations([*COMPARED, LIGHT.of[Meaning.LIMIT]], 2)
    assert min(apart(one, other, eye) for one, other in together) > 12.0


@pytest.mark.parametrize("theme", [DARK, LIGHT], ids=lambda theme: theme.name)
def test_every_colour_stands_out_from_its_background(theme: Theme) -> None:
    faint = {meaning: contrast(color, theme.background) for meaning, color in theme.of.items()}
    assert {meaning: ratio for meaning, ratio in faint.items() if ratio < 3.0} == {}
    assert contrast(theme.ink, theme.background) > 7.0


@pytest.mark.parametrize("ground", [VIEWER.background, "#f2f2f2"])
def test_colours_of_the_viewer_are_readable_on_its_dark_and_its_light_ground(ground: str) -> None:
    faint = {color: contrast(color, ground) for color in (VIEWER.ink, *VIEWER.of.values())}
    assert {color: ratio for color, ratio in faint.items() if ratio < 2.5} == {}


@pytest.mark.parametrize(
    ("least", "ground", "drawn"),
    [
        (4.5, "panel", "text soft quiet limit air over"),
        (4.5, "slope", "soft"),
        (4.5, "grey", "ground"),
        (4.5, "over", "onred"),
        (4.5, "text", "ground"),
        (3.0, "panel", "advice band grey uphill downhill"),
        (3.0, "faint", "advice over pull electric air limit text"),
        (3.0, "band", "limit"),
        (3.0, "slope", "uphill downhill"),
        (3.0, "housing", "over"),
    ],
)
def test_what_the_cab_desk_draws_stands_out_by_wcag_aa(least: float, ground: str, drawn: str) -> None:
    """On its canvases, which a browser cannot measure: 4.5 : 1 for words, 3 : 1 for all else that means something."""
    sheet = (REPOSITORY / "sim/desk/page/desk.css").read_text(encoding="utf-8")
    colors = dict(re.findall(r"--(\w+): (#[0-9a-f]{6})", sheet))
    faint = {name: round(contrast(colors[name], colors[ground]), 2) for name in drawn.split()}
    assert {name: ratio for name, ratio in faint.items() if ratio < least} == {}


@pytest.mark.parametrize("folder", ["sim/review", "sim/trips", "precompute/cli"])
def test_no_picture_or_page_has_colours_of_its_own(folder: str) -> None:
    """All colours are in das/drawing, each once."""
    for path in (REPOSITORY / folder).iterdir():
        if path.suffix in (".py", ".css", ".j2"):
            assert not re.search(r"#[0-9a-fA-F]{3}(?:[0-9a-fA-F]{3})?\b|\btab:|\"C\d\"", path.read_text()), path


def test_the_number_for_rerun() -> None:
    assert rgba("#4aa3ff") == 0x4AA3FFFF
