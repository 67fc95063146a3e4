"""Questionnaires: scores by hand and by their published rules, languages, answers, and errors in own files."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from das.advice.wording import Language
from das.domain.errors import DasError
from sim.experiment.people.forms import LONGEST_ANSWER, Form, load_form, text_for
from tests.das.domain.files.refusing import refused_with
from tests.support.making import REPOSITORY

NOWHERE = Path("no-folder")
BUNDLED = {"tlx": 6, "sus": 10, "kss": 1, "trust": 12}
OWN = """
schema_version = 1
title = "Own"
[[items]]
id = "signal"
kind = "choice"
text = { en = "Which signal was last?", de = "Welches Signal war das letzte?" }
options = ["clear", "danger"]
[[items]]
id = "speed"
least = 0
most = 10
reversed = true
text = "Were you fast?"
[[items]]
id = "why"
kind = "text"
needed = false
text = "Why?"
[[scores]]
name = "own"
items = ["signal", "speed"]
low = 0
high = 1
"""


def form(text: str, folder: Path) -> Form:
    (folder / "own.toml").write_text(text, encoding="utf-8")
    return load_form("own.toml", folder)


def answered(one: Form, *values: int) -> dict[str, str]:
    return {item.id: str(value) for item, value in zip(one.items, values, strict=True)}


@pytest.mark.parametrize(
    ("name", "values", "score"),
    [
        ("tlx", (55, 10, 40, 25, 60, 35), 37.5),  # 225 / 6
        ("tlx", (0, 0, 0, 0, 0, 0), 0.0),
        ("kss", (7,), 7.0),
        ("sus", (4, 2, 5, 1, 4, 2, 5, 2, 4, 3), 80.0),  # (3+4+3+4+3) odd, (3+4+3+3+2) even: 32 · 2.5
        ("sus", (3,) * 10, 50.0),
        ("sus", (5, 1) * 5, 100.0),
        ("trust", (1,) * 5 + (7,) * 7, 7.0),
        ("trust", (2, 3, 2, 4, 1, 5, 6, 5, 4, 6, 5, 7), 5.5),  # (6+5+6+4+7) + (5+6+5+4+6+5+7) = 66, / 12
    ],
)
def test_a_score_is_that_of_a_hand(name: str, values: tuple[int, ...], score: float) -> None:
    one = load_form(name, NOWHERE)
    assert one.scores(answered(one, *values)) == {name: score}


def test_there_is_no_score_of_half_a_questionnaire() -> None:
    one = load_form("tlx", NOWHERE)
    half = answered(one, 5, 5, 5, 5, 5, 5)
    del half["effort"]
    assert one.scores(half) == {}


@pytest.mark.parametrize("name", BUNDLED)
def test_a_bundled_questionnaire_has_all_its_words_in_every_language_and_names_its_source(name: str) -> None:
    one = load_form(name, NOWHERE)
    assert len(one.items) == BUNDLED[name]
    assert all(item.needed for item in one.items)
    texts = [one.title, *(text for item in one.items for text in (item.text, *item.options))]
    texts += [text for item in one.items for text in (item.low, item.high) if text]
    assert {tuple(text) for text in texts} == {tuple(Language)}
    seen: list[Any] = [text_for(one.title, language) for language in Language]
    seen += [[item.words(language)["text"] for item in one.items] for language in Language]
    assert len({str(x) for x in seen}) == 2 * len(Language)
    assert "source = " in one.source.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("item", "value", "valid"),
    [
        ("signal", "1", True),
        ("signal", "3", False),
        ("speed", "10", True),
        ("speed", "1e1", False),
        ("speed", "", False),
        ("speed", "٣", False),
        ("why", "", True),
        ("why", "I [do not] know\n{yet}", True),
        ("why", "x" * LONGEST_ANSWER, True),
        ("why", "x" * (LONGEST_ANSWER + 1), False),
        ("why", "\x1b[2J", False),
        ("other", "1", False),
    ],
)
def test_answers_are_checked(tmp_path: Path, item: str, value: str, valid: bool) -> None:
    assert form(OWN, tmp_path).accepts(item, value) == valid


def test_steps_are_kept_to() -> None:
    assert load_form("tlx", NOWHERE).accepts("mental", "55")
    assert not load_form("tlx", NOWHERE).accepts("mental", "56")


def test_a_laboratorys_own_questionnaire_has_its_words_and_score(tmp_path: Path) -> None:
    own = form(OWN, tmp_path)
    assert not own.is_complete({"signal": "2", "why": "I do not know"})
    assert own.is_complete({"signal": "2", "speed": "5"})
    assert [own.items[0].words(one)["text"][:5] for one in Language] == ["Which", "Welch", "Which"]
    assert own.items[0].words("de")["options"] == ["clear", "danger"]
    assert own.scores({"signal": "2", "speed": "5"}) == {"own": 0.75}  # (1 + 0.5) / 2


@pytest.mark.parametrize(
    ("old", "new", "error"),
    [
        ("least = 0", "least = 0.5", "items[1].least = 0.5: expected a whole number from -1000 to 1000"),
        ("most = 10", "most = 0", "items[1].most = 0: expected a whole number from 1 to 1000"),
        ("most = 10", "most = 10\nstep = 3", "items[1].step = 3: expected a step by which 10 can be divided"),
        ("most = 10", "most = 200", "items[1].step = 1: expected a step by which 200 can be divided"),
        ('id = "speed"', 'id = "signal"', "items = 'signal': expected each name once"),
        ('id = "speed"', 'id = "Speed"', "items[1].id = 'Speed': expected a letter"),
        ('kind = "text"', 'kind = "star"', "items[2].kind = 'star': expected"),
        ("needed = false", "necessary = false", "items[2].necessary = False: expected"),
        ('options = ["clear", "danger"]', 'options = ["clear"]', "items[0].options = ['clear']: expected a list of at"),
        ('"Why?"', '""', "items[2].text.en = '': expected a string"),
        ('"Why?"', '{ it = "Perché?" }', "items[2].text.it = 'Perché?': expected a string"),
        ('items = ["signal", "speed"]', 'items = ["why"]', "scores[0].items = ['why']: expected"),
        ("low = 0\nhigh = 1\n", "", "scores[0].items = ['signal', 'speed']: expected items of one scale"),
        ("schema_version = 1", "schema_version = 2", "schema_version = 2: expected 1"),
    ],
)
def test_an_error_in_a_questionnaire_names_file_key_value_and_what_was_expected(
    tmp_path: Path, old: str, new: str, error: str
) -> None:
    change = (old, new, f".*{re.escape(error)}")
    refused_with(lambda path: load_form(path.name, path.parent), tmp_path / "own.toml", OWN, change)


def test_an_unknown_questionnaire_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(DasError, match=r"tlxx: not a bundled questionnaire \(kss, sus, tlx, trust\)"):
        load_form("tlxx", tmp_path)
    with pytest.raises(DasError, match=r"own\.toml: no such file"):
        load_form("own.toml", tmp_path)


def test_the_example_of_the_page_is_a_questionnaire(tmp_path: Path) -> None:
    page = (REPOSITORY / "docs" / "how-to" / "run-people-at-the-desk.md").read_text(encoding="utf-8")
    example = next(part for part in page.split("```toml")[1:] if "[[items]]" in part).partition("```")[0]
    assert form(example, tmp_path).scores({"sure": "7"}) == {"sure": 7.0}
