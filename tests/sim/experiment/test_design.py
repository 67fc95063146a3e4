"""Design files: what is read, what is refused with which words, and when two designs have the same hash."""

from __future__ import annotations

import copy
import json
import math
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from das.domain.errors import DasError
from das.domain.files.reading import Fields
from das.domain.levels import Level
from sim.drivers.kinds import Presentation
from sim.experiment import design as design_module
from sim.experiment.design import (
    COLUMNS,
    DESIGN_JSON,
    Chances,
    ConditionOrder,
    Days,
    bundled_studies,
    freeze,
    load_design,
    read_design,
    read_frozen,
    resolved,
)
from sim.experiment.study_files import TRIAL_COLUMNS, level_meaning, level_words
from sim.experiment.trials import trials_of

FACTORS = """
schema_version = 1
[experiment]
name = "try"
title = "A try"
[participants]
count = 4
[fixed]
scenario = "flat-6km"
[[factors]]
name = "presentation"
levels = ["none", "speed-and-effort"]
[[factors]]
name = "hold_s"
levels = [0, 5.5]
"""
COMPARISON = """[[comparisons]]
measure = "energy_kwh"
factor = "presentation"
a = "none"
b = "speed-and-effort"
where = { hold_s = 5.5 }
"""
DESIGN = FACTORS + COMPARISON
LEVELS, B = 'levels = ["none", "speed-and-effort"]', 'b = "speed-and-effort"'


NAMED = (
    DESIGN.replace('= "presentation"', '= "display"')
    .replace(
        LEVELS,
        """levels = [
    { name = "none", presentation = "none" },
    { name = "blind", presentation = "guide", preview_s = 0 },
    { name = "mute", presentation = "guide", reason = false },
]""",
    )
    .replace(B, 'b = "blind"')
)


@pytest.fixture
def write(tmp_path: Path) -> Path:
    path = tmp_path / "design.toml"
    path.write_text(DESIGN)
    return path


def test_a_design_has_its_defaults(write: Path) -> None:
    design = read_design(write)
    assert (design.seed, design.people.count, design.people.learning) == (1, 4, False)
    procedure = design.procedure
    assert (procedure.order, procedure.days, procedure.chances) == (ConditionOrder.WILLIAMS, Days.OWN, Chances.NEW)
    assert design.alpha == 0.05
    assert design.correction == "holm"
    assert [level.text for level in design.factors[1].levels] == ["0", "5.5"]
    comparison = design.comparisons[0]
    assert comparison.name == "energy_kwh: none - speed-and-effort, hold_s 5.5"
    assert comparison.where == {"hold_s": "5.5"}
    settings = list(design.settings())
    assert [(one.presentation, one.hold_s) for one in settings] == [
        (shown, hold_s) for shown in (Presentation.NONE, Presentation.SPEED_AND_EFFORT) for hold_s in (0.0, 5.5)
    ]
    assert all(one.scenario == "flat-6km" and math.isinf(one.preview_s) and one.reason for one in settings)


BAD = [
    ("schema_version = 1", "schema_version = 2", "schema_version = 2: expected 1"),
    ('name = "try"', 'name = "A try!"', "experiment.name = 'A try!': expected 1 to 64 small letters"),
    ("count = 4", "count = 0", "participants.count = 0: expected a whole number from 1 to 10000"),
    ("count = 4", "count = true", "participants.count = True: expected a whole number"),
    ("count = 4", 'count = 4\npopulation = "martians"', "martians: not a bundled population"),
    ('scenario = "flat-6km"', 'scenario = "moon.toml"', "moon.toml: no such file"),
    ('scenario = "flat-6km"', "hold_s = 3", "fixed.hold_s = 3: expected nothing, because the factor hold_s of"),
    ('scenario = "flat-6km"', 'weather = "rain"', "fixed.weather = 'rain': expected one of the keys"),
    ('name = "hold_s"', 'name = "mood"', "factors[1].name = 'mood': expected one of presentation, loss_level"),
    ("levels = [0, 5.5]", "levels = [0]", "factors[1].levels = [0]: expected at least 2 levels"),
    ("levels = [0, 5.5]", "levels = [5, 5.0]", "expected at least 2 levels, each once"),
    ("levels = [0, 5.5]", "levels = [0, nan]", "factors[1].levels = nan: expected a number from 0 to 600 (s)"),
    (LEVELS, 'levels = ["none", 3]', "factors[0].levels = 3: expected one of none"),
    ('measure = "energy_kwh"', 'measure = "joy"', "comparisons[0].measure = 'joy': expected one of the measures"),
    (B, 'b = "guide"', "comparisons[0].b = 'guide': expected one of the levels none, speed-and-effort"),
    (B, 'b = "none"', "comparisons[0].b = 'none': expected a level other than that of a"),
    ('factor = "presentation"', 'factor = "colour"', "factor = 'colour': expected one of the factors presentation"),
    ("{ hold_s = 5.5 }", "{ colour = 1 }", "comparisons[0].where.colour = 1: expected one of the keys hold_s"),
    ("[[comparisons]]", f"{COMPARISON}\n[[comparisons]]", "expected a name of its own for each comparison"),
    ("hold_s = 5.5 }", "hold_s = 7 }", "hold_s = 7: expected one of the levels 0, 5.5"),
    ("[fixed]", "[procedure]\norder = 'best'\n[fixed]", "procedure.order = 'best': expected one of williams"),
    ("[fixed]", "[procedure]\nbreak_min = -1\n[fixed]", "procedure.break_min = -1: expected a number from 0 to"),
    ("[fixed]", "[analysis]\nalpha = 2\n[fixed]", "analysis.alpha = 2.0: expected a number from 1e-06 to 0.5"),
    ("[fixed]", "[analysis]\ncorrection = 'wish'\n[fixed]", "analysis.correction = 'wish': expected one of holm"),
    ("[fixed]", "[procedure]\nseeds = [1, 1]\n[fixed]", "seeds = [1, 1]: expected whole numbers from 0 to"),
    ("[fixed]", "[procedure]\nseeds = [1, 2]\ndays = 'own'\n[fixed]", "expected 2 seeds (one for each"),
    ("count = 4", "count = 4\naverage = true", "participants.count = 4: expected 1, because participants.average"),
    ("[fixed]", "[procedure]\nrepetitions = 99_999\n[fixed]", "at most 100000 trials for each participant"),
]  # fmt: skip
BAD_NAMED = [
    ('scenario = "flat-6km"', "preview_s = 3", "fixed.preview_s = 3: expected nothing, because the factor display"),
    ('name = "hold_s"\nlevels = [0, 5.5]', 'name = "reason"\nlevels = [true, false]',
     "factors = 'reason': expected each setting in one factor only"),
    ('name = "display"', 'name = "Display"', "factors[0].name = 'Display': expected small letters"),
    ('name = "display"', 'name = "energy_kwh"', "factors[0].name = 'energy_kwh': expected small letters"),
    ('name = "display"', 'name = "seed"', "no name of a factor, measure or column"),
    ('name = "display"', 'name = "reason"', "no name of a factor, measure or column"),
    ("preview_s = 0", 'driver = "desk"', "factors[0].levels = 'desk': expected simulated drivers"),
    ("preview_s = 0", "colour = 0", "factors[0].levels[1].colour = 0: expected one of the keys"),
    ("preview_s = 0", "preview_s = -1", "factors[0].levels[1].preview_s = -1: expected a number from 0 to 3600"),
    ("preview_s = 0", 'loss_level = "l2"', "levels[0].loss_level is missing: expected a value in every level"),
    ('name = "blind"', 'name = "Blind"', "factors[0].levels[1].name = 'Blind': expected 1 to 64 small letters"),
    ('name = "blind"', 'name = "none"', "expected at least 2 levels, each once"),
    ('{ name = "none", presentation = "none" }', '"none"', "factors[0].name = 'display': expected one of"),
    ('b = "blind"', "b = 0", "comparisons[0].b = 0: expected one of the levels none, blind, mute"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "change"), [*((DESIGN, one) for one in BAD), *((NAMED, one) for one in BAD_NAMED)])
def test_nonsense_is_refused_in_one_line(write: Path, text: str, change: tuple[str, str, str]) -> None:
    old, new, said = change
    assert old in text
    write.write_text(text.replace(old, new, 1))
    with pytest.raises(DasError) as error:
        read_design(write)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_a_named_level_fixes_several_settings_and_leaves_the_others_at_their_defaults(write: Path) -> None:
    write.write_text(NAMED)
    design = read_design(write)
    assert design.factors[0].texts == ("none", "blind", "mute")
    assert design.factors[0].varied == ("presentation", "preview_s", "reason")
    assert not design.fixed.keys() & {"presentation", "preview_s", "reason", "hold_s", "display"}
    shown = [(one.presentation, one.preview_s, one.reason) for one in design.settings() if one.hold_s == 0]
    assert shown == [
        (Presentation.NONE, math.inf, True), (Presentation.GUIDE, 0.0, True), (Presentation.GUIDE, math.inf, False),
    ]  # fmt: skip
    assert {trial.condition for trial in trials_of(design)} == {
        f"{name}_{held}" for name in ("none", "blind", "mute") for held in ("0", "5.5")
    }


def test_named_levels_are_frozen_with_all_their_settings(write: Path, tmp_path: Path) -> None:
    write.write_text(NAMED)
    found = freeze(read_design(write), tmp_path / "study")
    assert found["factors"][0]["levels"][1] == {
        "name": "blind", "presentation": "guide", "preview_s": "0", "reason": "shown",
    }  # fmt: skip
    frozen = read_frozen(tmp_path / "study")
    assert frozen.factors[0].texts == ("none", "blind", "mute")
    assert frozen.planned == read_design(write).planned
    assert level_meaning("display", frozen.factors[0].levels[2]) == (
        f"presentation guide ({level_words('presentation', 'guide')}); preview_s all; reason hidden"
    )
    write.write_text(NAMED.replace("preview_s = 0", "preview_s = 1"))
    assert resolved(read_design(write))["hash"] != found["hash"]
    write.write_text(NAMED.replace('{ name = "none", ', '{ reason = true, preview_s = "all", name = "none", '))
    assert resolved(read_design(write))["hash"] == found["hash"]


def test_the_columns_of_a_design_are_those_of_the_table_of_trials() -> None:
    assert (*TRIAL_COLUMNS, "seed") == COLUMNS


def _paths(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Every place in a parsed document."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield (*path, key)
        yield from _paths(inner, (*path, key))


def test_any_value_in_any_place_is_read_or_refused(write: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    procedure = "[procedure]\norder = 'random'\nbreak_after = 2\ndays = 'common'\n"
    text = f"{DESIGN}{procedure}[analysis]\nmeasures = ['energy_kwh']\n"
    whole, most = tomllib.loads(text), 0
    said: list[str] = []
    for path in _paths(whole):
        for value in (-1, 10**30, math.nan, math.inf, "", "x" * 1000, "\x1b", [], {}, [[]], [{}], True, "../../etc"):
            data = copy.deepcopy(whole)
            place = data
            for key in path[:-1]:
                place = place[key]
            place[path[-1]] = value
            monkeypatch.setattr(design_module, "read_toml", lambda file, data=data: Fields.of(file, data))
            most += 1
            try:
                resolved(read_design(write))
            except DasError as error:
                said.append(str(error))
    assert not any("\n" in one for one in said)
    assert len(said) > 0.8 * most


def test_the_hash_is_of_what_the_design_means(write: Path, tmp_path: Path) -> None:
    digest = resolved(read_design(write))["hash"]
    write.write_text("# A remark\n" + DESIGN.replace("levels = [0, 5.5]", "levels = [ 0.0, 5.5 ]  # another"))
    assert resolved(read_design(write))["hash"] == digest
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "other.toml").write_text(DESIGN)
    assert resolved(read_design(elsewhere / "other.toml"))["hash"] == digest
    write.write_text(DESIGN.replace("levels = [0, 5.5]", "levels = [5.5, 0]"))
    assert resolved(read_design(write))["hash"] != digest


def test_a_frozen_design_cannot_be_changed_in_its_folder(write: Path, tmp_path: Path) -> None:
    folder = tmp_path / "study"
    found = freeze(read_design(write), folder)
    assert freeze(read_design(write), folder) == found
    assert json.loads((folder / DESIGN_JSON).read_text()) == json.loads(json.dumps(found))
    assert (folder / "design.toml").read_text() == DESIGN
    frozen, design = read_frozen(folder), read_design(write)
    assert (frozen.hash, frozen.people, frozen.procedure) == (found["hash"], design.people, design.procedure)
    assert [one.texts for one in frozen.factors] == [one.texts for one in design.factors]
    assert (frozen.comparisons, frozen.measures) == (design.comparisons, design.measures)
    write.write_text(DESIGN.replace("count = 4", "count = 6"))
    with pytest.raises(DasError, match="holds the frozen design"):
        freeze(read_design(write), folder)
    write.write_text(DESIGN)
    altered = (folder / DESIGN_JSON).read_text().replace('"count": 4', '"count": 8')
    (folder / DESIGN_JSON).write_text(altered)
    with pytest.raises(DasError, match="was altered after it was frozen"):
        freeze(read_design(write), folder)


def test_the_bundled_studies_are_sound() -> None:
    names = set(bundled_studies())
    assert names == {"smoke", "presentations", "level-through-a-driver", "pacing", "preview-of-advice"}
    for name in names:
        design = load_design(name)
        assert design.name == name
        assert design.comparisons
    presentations = load_design("presentations")
    assert [len(factor.levels) for factor in presentations.factors] == [6, 3]
    assert presentations.people.count == 24
    levels = load_design("level-through-a-driver")
    assert [level.value for level in levels.factors[0].levels] == [Level.L2, Level.L3]
    assert [level.value for level in levels.factors[1].levels] == [Presentation.SPEED_AND_EFFORT, Presentation.GUIDE]
    where = {tuple(sorted(one.where.items())) for one in levels.comparisons}
    assert len(where) == 6, "each display with a perfect follower and with people of either brakes"
