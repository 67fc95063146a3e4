"""Questionnaires of an experiment with people: their items in three languages, the check of answers, and scores.

A questionnaire is a TOML file, bundled or the laboratory's own (docs/how-to/run-people-at-the-desk.md). Answers are
texts: a whole number for a scale, the number of the option (from 1) for a choice, else free text. Scores do not depend
on the language.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

from das.advice.wording import Language
from das.domain.errors import MISSING, is_seen
from das.domain.files.load import locate
from das.domain.files.reading import Fields, number, read_toml
from sim.experiment.people_plan import bundled_forms

MOST_ITEMS, MOST_OPTIONS, MOST_STEPS = 60, 20, 100
LONGEST_TEXT: Final = 600
"""Longest text (characters) of a questionnaire."""
LONGEST_ANSWER: Final = 500
"""Longest free answer (characters)."""
SCALE_ENDS: Final = (-1000, 1000)
_ID = re.compile(r"[a-z][a-z0-9_]{0,31}")
Texts = Mapping[str, str]
"""A text by language."""


class ItemKind(StrEnum):
    """The kinds of items."""

    SCALE = "scale"
    CHOICE = "choice"
    TEXT = "text"


def text_for(texts: Texts, language: str) -> str:
    """The text in a language; without it the English one, else the first; empty without any text."""
    return texts.get(language, texts.get(Language.EN, next(iter(texts.values()), "")))


@dataclass(frozen=True, kw_only=True)
class Item:
    """An item of a questionnaire: a scale from `least` to `most` in steps, a choice of options, or a free text.

    The numbers of a choice are those of its options, from 1. `low` and `high` are the words at the ends of a scale. A
    `reversed` item enters a score from its other end.
    """

    id: str
    kind: ItemKind
    text: Texts
    low: Texts
    high: Texts
    options: tuple[Texts, ...]
    least: int
    most: int
    step: int
    reversed: bool
    needed: bool

    def accepts(self, value: str) -> bool:
        """Whether an answer is valid."""
        if self.kind is ItemKind.TEXT:
            seen = is_seen(value.replace("\n", " ")) and len(value) <= LONGEST_ANSWER
            return seen and (bool(value.strip()) or not self.needed)
        whole = re.fullmatch(r"-?\d{1,4}", value, re.ASCII) is not None
        return whole and self.least <= int(value) <= self.most and (int(value) - self.least) % self.step == 0

    def share(self, value: str) -> float:
        """The place of a valid answer between the ends of the scale (0 … 1), from the other end if it is reversed."""
        share = (int(value) - self.least) / (self.most - self.least)
        return 1.0 - share if self.reversed else share

    def words(self, language: str) -> dict[str, Any]:
        """The item as the page receives it."""
        numbers = {"least": self.least, "most": self.most, "step": self.step}
        ends = {"low": text_for(self.low, language), "high": text_for(self.high, language)}
        options = [text_for(one, language) for one in self.options]
        told = {"id": self.id, "text": text_for(self.text, language), "kind": str(self.kind), "needed": self.needed}
        return told | numbers | ends | {"options": options}


@dataclass(frozen=True, kw_only=True)
class Score:
    """A score of a questionnaire: the mean of its items' places on their scales, from `low` to `high`."""

    name: str
    items: tuple[Item, ...]
    low: float
    high: float

    def of(self, answers: Mapping[str, str]) -> float | None:
        """The score; None unless all of its items have a valid answer."""
        given = [(item, answers.get(item.id, "")) for item in self.items]
        if not all(item.accepts(value) for item, value in given):
            return None
        share = sum(item.share(value) for item, value in given) / len(given)
        return round(self.low + share * (self.high - self.low), 9)


@dataclass(frozen=True, kw_only=True)
class Form:
    """A questionnaire: its file, title, introduction, items and scores."""

    source: Path
    title: Texts
    intro: Texts
    items: tuple[Item, ...]
    score_rules: tuple[Score, ...]

    def accepts(self, item: str, value: str) -> bool:
        """Whether an answer is to an item of this questionnaire, and valid."""
        return any(one.id == item and one.accepts(value) for one in self.items)

    def is_complete(self, answers: Mapping[str, str]) -> bool:
        """Whether every item that must be answered is answered."""
        return all(item.accepts(answers.get(item.id, "")) for item in self.items if item.needed)

    def scores(self, answers: Mapping[str, str]) -> dict[str, float]:
        """The scores whose items are all answered, by name."""
        found = {rule.name: rule.of(answers) for rule in self.score_rules}
        return {name: value for name, value in found.items() if value is not None}


def load_form(name: str, folder: Path) -> Form:
    """The questionnaire with a bundled name, or from a TOML file in a folder.

    Raises DasError for an unknown name or file, and InputError for anything unusable in it.
    """
    bundled = bundled_forms()
    return read_form(bundled[name] if name in bundled else locate(str(folder / name), "questionnaire", bundled))


def read_form(path: Path) -> Form:
    """The questionnaire in a file; InputError (file, key, value, expectation) for anything unusable in it."""
    fields = read_toml(path)
    fields.check_keys(["schema_version", "source", "title", "intro", "items", "scores"])
    fields.check_schema_version(1)
    rows = fields.rows("items", "a list of items", MOST_ITEMS)
    items = [_item(Fields.of(path, row, f"items[{i}].")) for i, row in enumerate(rows)]
    _check_once(fields, "items", [item.id for item in items])
    rules = fields.rows("scores", "a list of scores", MOST_ITEMS) if fields.has("scores") else []
    scores = [_score(Fields.of(path, row, f"scores[{i}]."), items) for i, row in enumerate(rules)]
    _check_once(fields, "scores", [score.name for score in scores])
    return Form(
        source=path, title=_texts(fields, "title"), intro=_texts(fields, "intro", {}),
        items=tuple(items), score_rules=tuple(scores),
    )  # fmt: skip


def _item(fields: Fields) -> Item:
    kind = fields.choice("kind", ItemKind, ItemKind.SCALE)
    allowed = {
        ItemKind.SCALE: ["least", "most", "step", "low", "high", "reversed"],
        ItemKind.CHOICE: ["options", "reversed"],
        ItemKind.TEXT: [],
    }
    fields.check_keys(["id", "kind", "text", "needed", *allowed[kind]])
    options: tuple[Texts, ...] = ()
    least, most, step = 0, 0, 1
    if kind is ItemKind.CHOICE:
        rows = fields.rows("options", "a list of at least 2 options", MOST_OPTIONS)
        options = tuple(_texts(Fields(fields.source, f"{fields.prefix}options", {f"[{i}]": row}), f"[{i}]")
                        for i, row in enumerate(rows))  # fmt: skip
        least, most = 1, len(options)
        if most < 2:
            raise fields.error("options", rows, "a list of at least 2 options")
    elif kind is ItemKind.SCALE:
        least = fields.whole("least", SCALE_ENDS)
        most = fields.whole("most", (least + 1, SCALE_ENDS[1]))
        step = fields.whole("step", (1, most - least), 1)
        if (most - least) % step or (most - least) // step > MOST_STEPS:
            raise fields.error(
                "step", step, f"a step by which {most - least} can be divided, at most {MOST_STEPS} times"
            )
    return Item(
        id=_id(fields, "id"), kind=kind, text=_texts(fields, "text"),
        low=_texts(fields, "low", {}), high=_texts(fields, "high", {}), options=options,
        least=least, most=most, step=step,
        reversed=fields.flag("reversed", False), needed=fields.flag("needed", True),
    )  # fmt: skip


def _score(fields: Fields, items: Sequence[Item]) -> Score:
    fields.check_keys(["name", "items", "low", "high"])
    counted = {item.id: item for item in items if item.kind is not ItemKind.TEXT}
    names = fields.names("items", list(counted)) or list(counted)
    chosen = tuple(counted[name] for name in names)
    ends = {(item.least, item.most) for item in chosen}
    if not chosen or (len(ends) > 1 and not (fields.has("low") and fields.has("high"))):
        raise fields.error("items", names, "items of one scale, or the keys low and high")
    low, high = (number(fields.source, f"{fields.prefix}{key}", fields.data.get(key, own))
                 for key, own in zip(("low", "high"), min(ends), strict=True))  # fmt: skip
    return Score(name=_id(fields, "name"), items=chosen, low=low, high=high)


def _id(fields: Fields, key: str) -> str:
    value = fields.text(key)
    if not _ID.fullmatch(value):
        raise fields.error(key, value, "a letter, then at most 31 small letters, digits and _")
    return value


def _check_once(fields: Fields, key: str, names: Sequence[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise fields.error(key, name, "each name once")


def _texts(fields: Fields, key: str, default: Texts | None = None) -> Texts:
    """A text: a string for all languages, or a table of strings by language."""
    value = fields.data.get(key, MISSING if default is None else default)
    texts = {str(Language.EN): value} if isinstance(value, str) else value
    expected = f"a string of at most {LONGEST_TEXT} characters, or such strings by language ({', '.join(Language)})"
    if not isinstance(texts, Mapping) or (not texts and default is None):
        raise fields.error(key, value, expected)
    for language, text in texts.items():
        fits = isinstance(text, str) and text.strip() and is_seen(text) and len(text) <= LONGEST_TEXT
        if not fits or language not in list(Language):
            raise fields.error(f"{key}.{language}", text, expected)
    return dict(texts)
