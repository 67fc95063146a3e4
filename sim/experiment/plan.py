"""The names of the files of a study, and the plan of its analysis, which is part of its frozen design.

The plan has the factors, the measures, and the planned comparisons with their correction.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, Final

from das.domain.errors import MISSING, DasError
from das.domain.files.reading import Fields, number, read_json

DESIGN_TEXT: Final = "design.toml"
"""The frozen design as the user wrote it, with its comments."""
DESIGN_JSON: Final = "design.json"
"""The resolved design: every default written out, and the hash that freezes it."""
TRIALS_TABLE: Final = "trials.csv"
"""The tidy table (UTF-8, comma, decimal point): one row for each finished trial, sorted by participant and trial order.

A value that is missing is empty. No column depends on the wall clock: the same design gives the same bytes.
"""
TRIALS_SIDECAR: Final = "trials.json"
"""File with the meaning of every column of the table: column → {LongName, Description, Units}, as in BIDS."""

FAILED_TABLE: Final = "failed.csv"
"""The table of the trials that failed, each with the reason; written only if there are any."""

PEOPLE_TABLE: Final = "participants.tsv"
"""The participants: number in the population, group, and the parameters that were drawn."""
PERSON_ID: Final = "participant_id"
"""Column of the participants' table: the name of the participant in the table of trials."""
PERSON_NUMBER: Final = "person"
"""Column of the participants' table: the number of the participant in the population."""

CHECKSUMS: Final = "checksums.json"
"""The SHA-256 of each table that is analysed: name of the file → hash."""
CHECKED_TABLES: Final = (TRIALS_TABLE, PEOPLE_TABLE)
"""The tables whose hashes are kept."""

CHECK_RESULT: Final = "check.json"
"""Name of the file with the findings of the check of the frozen design."""

PROVENANCE: Final = "provenance.json"
"""Name of the file with the program and the files that made the data, when and how."""

DEFAULT_ALPHA: Final = 0.05
CORRECTIONS: Final = ("holm", "bonferroni", "none")
"""Corrections of planned comparisons for their number; the first is the default."""
LEAST_PARTICIPANTS: Final = 6
"""With fewer participants no difference of pairs can have a p below 0.05, and no spread has an interval."""
MOST_COMPARISONS: Final = 200
FIXED: Final = "not varied"
"""Name of the row that says what was the same on all trials."""
PROCEDURE: Final = {
    "order": "order of the conditions, as designed", "repetitions": "repetitions of all conditions",
    "practice_trials": "practice trials for each driver", "break_after": "trials between breaks",
    "days": "days", "chances": "random numbers",
}  # fmt: skip
"""The settings of the procedure that the report lists, and its name for each."""
PROCEDURE_WORDS: Final = {
    "order williams": "Williams squares, a row for each driver and repetition",
    "order full": "the possible orders in turn, one for each driver and repetition",
    "order random": "drawn at random for each driver",
    "order listed": "the same for all, as the design lists them",
    "days own": "each driver has their own days, and meets the same day under every condition",
    "days common": "all drivers meet the same days, under every condition",
    "days new": "every trial has a day of its own",
    "chances new": "reactions, errors and lapses are redrawn on every trial",
    "chances paired": "reactions, errors and lapses are the same for all trials of a driver on one day",
}


def as_json(content: Any) -> bytes:
    """JSON as the files of a study hold it: indented, UTF-8."""
    return json.dumps(content, indent=2, ensure_ascii=False).encode() + b"\n"


@dataclass(frozen=True, kw_only=True)
class VariedFactor:
    """A factor of the study and its levels as texts; `within` says whether each participant drives every level."""

    name: str
    levels: tuple[str, ...]
    within: bool


@dataclass(frozen=True, kw_only=True)
class PlannedComparison:
    """A comparison that was planned before the run: `measure` at level `a` of `factor` minus `measure` at level `b`.

    `where` fixes the levels of other factors. A factor that it does not name enters with all its levels.
    """

    name: str
    measure: str
    factor: str
    a: str
    b: str
    where: Mapping[str, str] = field(default_factory=dict)

    @property
    def title(self) -> str:
        """The name of the comparison; its contrast where the design gave it no name of its own."""
        return self.contrast() if self.name.startswith(f"{self.measure}: ") else self.name

    def contrast(self, between: str = ", ") -> str:
        """The difference in words: a minus b, and the levels that are fixed, each after `between`."""
        return f"{self.a} minus {self.b}" + "".join(f"{between}{name}: {level}" for name, level in self.where.items())


@dataclass(frozen=True, kw_only=True)
class StudyPlan:
    """The part of a frozen design that its analysis needs.

    `about` is the study's title and description. `simulated` says whether its drivers are simulated. `setting` has
    pairs of a name and a text: who took part, the procedure, and what was not varied. `size` has the number of
    participants, and how often each was to drive each condition; zeros if the design does not say it.
    """

    name: str
    about: str = ""
    hash: str
    seed: int
    factors: tuple[VariedFactor, ...]
    measures: tuple[str, ...]
    comparisons: tuple[PlannedComparison, ...]
    alpha: float = DEFAULT_ALPHA
    correction: str = CORRECTIONS[0]
    simulated: bool = True
    setting: tuple[tuple[str, str], ...] = ()
    size: tuple[int, int] = (0, 0)

    @property
    def planned(self) -> Counter[tuple[str, str]]:
        """How many trials without practice were planned, by participant and condition; empty if it is not known.

        A condition is the levels of all factors, as `RunStudy.conditions` gives it.
        """
        (participants, repetitions), groups = self.size, self._combined(within=False)
        return Counter(
            {
                (participant_name(who + 1), self._condition(groups[who % len(groups)] | inside)): repetitions
                for who in range(participants)
                for inside in self._combined(within=True)
            }
        )

    def _combined(self, *, within: bool) -> list[dict[str, str]]:
        """All combinations of levels of the factors within (or between) participants; an empty one without factors."""
        some = [one for one in self.factors if one.within is within]
        names = [one.name for one in some]
        return [dict(zip(names, levels, strict=True)) for levels in product(*(one.levels for one in some))]

    def _condition(self, levels: Mapping[str, str]) -> str:
        return " ".join(levels[one.name] for one in self.factors)

    def factor(self, name: str) -> VariedFactor:
        """The factor with this name; KeyError if there is none."""
        return {one.name: one for one in self.factors}[name]

    def chosen(self, name: str | None) -> PlannedComparison:
        """The planned comparison with this name (None: the first one); DasError if there is none."""
        for one in self.comparisons:
            if name in (None, one.name):
                return one
        names = ", ".join(one.name for one in self.comparisons) or "none is planned"
        raise DasError(f"--comparison {name}: expected one of the planned comparisons ({names})")


def participant_name(who: int) -> str:
    """The name of a participant (from 1) in the tables of a study."""
    return f"sub-{who:02d}"


def as_text(level: object) -> str:
    """A level as the table of trials writes it; equal numbers give the same text."""
    if isinstance(level, bool):
        return str(level).lower()
    try:
        return f"{float(level):.12g}" if isinstance(level, int | float | str) else str(level)
    except ValueError:
        return str(level)


def read_plan(path: Path) -> StudyPlan:
    """Read the frozen design of a folder, or a design file (JSON); DasError where it cannot be used."""
    return plan_of(read_json(path / DESIGN_JSON if path.is_dir() else path))


def plan_of(fields: Fields) -> StudyPlan:
    """The plan in a frozen design (the content of its `design.json`); InputError if the content is wrong."""
    factors = _factors(fields.table("factors"))
    measures = tuple(_texts(fields, "measures"))
    participants = _count(fields, "participants", "count")
    repetitions = _count(fields, "procedure", "repetitions")
    return StudyPlan(
        name=fields.name("name"),
        about=_about(fields.text("title", ""), fields.text("description", "")),
        hash=fields.text("hash", ""),
        seed=_seed(fields),
        factors=factors,
        measures=measures,
        comparisons=read_comparisons(fields, {one.name: partial(_level, one.levels) for one in factors}, measures),
        alpha=_alpha(fields),
        correction=read_correction(fields),
        simulated=fields.data.get("drivers", "simulated") != "people",
        setting=tuple(_setting(fields)),
        size=(participants, repetitions) if participants and repetitions else (0, 0),
    )


def _about(title: str, description: str) -> str:
    """Title and description as running text."""
    ended = title if not title or title.endswith((".", "?", "!")) else f"{title}."
    return f"{ended} {description}".strip()


def _count(fields: Fields, table: str, key: str) -> int:
    """A number of the design; 0 if it does not say it."""
    found = fields.data.get(table)
    value = found.get(key, 0) if isinstance(found, Mapping) else 0
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise fields.error(f"{table}.{key}", value, "a whole number of at least 0")
    return value


def _seed(fields: Fields) -> int:
    value = fields.data.get("seed", 0)
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise fields.error("seed", value, "a whole number of at least 0")
    return value


def _setting(fields: Fields) -> Iterator[tuple[str, str]]:
    """Pairs for `StudyPlan.setting`: population, practice, procedure and what was not varied, if the design says it."""
    people = fields.data.get("participants")
    if isinstance(people, Mapping) and people.get("population"):
        yield "drivers drawn from the population", str(people["population"])
        if "learning" in people:
            yield "practice", _practice(people)
    procedure = fields.data.get("procedure")
    if isinstance(procedure, Mapping):
        for key, name in PROCEDURE.items():
            value = procedure.get(key)
            if value not in (None, 0):
                yield name, PROCEDURE_WORDS.get(f"{key} {value}", str(value))
    fixed = fields.data.get("fixed")
    if isinstance(fixed, Mapping) and fixed:
        yield FIXED, ", ".join(f"{name}: {value}" for name, value in fixed.items())


def _practice(people: Mapping[str, Any]) -> str:
    if not people["learning"]:
        return "drivers neither learn nor tire between trials"
    return f"drivers get better with each trip; {people.get('trips_before', 0):g} trips before the first trial"


def _texts(fields: Fields, key: str) -> list[str]:
    listed = fields.rows(key, "a list of strings")
    for one in listed:
        if not isinstance(one, str):
            raise fields.error(key, one, "a string")
    return list(listed)


def _factors(fields: Fields) -> tuple[VariedFactor, ...]:
    found = []
    for name in fields.data:
        table = fields.table(name)
        levels = tuple(as_text(level) for level in table.rows("levels", "a list of levels"))
        found.append(VariedFactor(name=name, levels=levels, within=table.flag("within", True)))
    return tuple(found)


def _level(levels: tuple[str, ...], fields: Fields, key: str) -> str:
    value = fields.data.get(key, MISSING)
    if value is MISSING or as_text(value) not in levels:
        raise fields.error(key, value, f"one of the levels {', '.join(levels)}")
    return as_text(value)


def read_comparisons(
    fields: Fields, levels: Mapping[str, Callable[[Fields, str], str]], measures: Sequence[str]
) -> tuple[PlannedComparison, ...]:
    """The planned comparisons of a design; there are none if the study merely describes its conditions.

    `levels` has, for each factor, the function that reads a level from a table and a key. Raises InputError.
    """
    listed = fields.data.get("comparisons", [])
    if not isinstance(listed, list):
        raise fields.error("comparisons", listed, "a list of tables")
    fields.check_count("comparisons", listed, MOST_COMPARISONS)
    tables = (Fields.of(fields.source, one, f"comparisons[{i}].") for i, one in enumerate(listed))
    found = tuple(_comparison(one, levels, measures) for one in tables)
    names = [one.name for one in found]
    for name in names:
        if names.count(name) > 1:
            raise fields.error("comparisons", name, "a name of its own for each comparison")
    return found


def _comparison(
    table: Fields, levels: Mapping[str, Callable[[Fields, str], str]], measures: Sequence[str]
) -> PlannedComparison:
    table.check_keys(list(PlannedComparison.__dataclass_fields__))
    factor, measure = table.text("factor"), table.text("measure")
    if factor not in levels:
        raise table.error("factor", factor, f"one of the factors {', '.join(levels)}")
    if measure not in measures:
        raise table.error("measure", measure, f"one of the measures {', '.join(measures)}")
    a, b = (levels[factor](table, key) for key in ("a", "b"))
    if a == b:
        raise table.error("b", table.data["b"], "a level other than that of a")
    where = table.optional_table("where")
    where.check_keys([name for name in levels if name != factor])
    fixed = {name: levels[name](where, name) for name in where.data}
    only = "".join(f", {name} {level}" for name, level in fixed.items())
    name = table.name("name", f"{measure}: {a} - {b}{only}")
    return PlannedComparison(name=name, measure=measure, factor=factor, a=a, b=b, where=fixed)


def _alpha(fields: Fields) -> float:
    value = number(fields.source, "alpha", fields.data.get("alpha", DEFAULT_ALPHA))
    if not 0.0 < value < 1.0:
        raise fields.error("alpha", value, "a probability between 0 and 1")
    return value


def read_correction(fields: Fields) -> str:
    """How the p values of a design's comparisons are corrected; InputError for an unknown correction."""
    value = fields.text("correction", CORRECTIONS[0])
    if value not in CORRECTIONS:
        raise fields.error("correction", value, f"one of {', '.join(CORRECTIONS)}")
    return value
