"""The design of an experiment: factors, participants, order and measures, read from a TOML file, and frozen.

The format: docs/reference/experiments.md. A design is frozen as JSON with every default written out. Its hash shows
whether anything in it was changed afterwards.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, Final

from das.domain.errors import MISSING, DasError
from das.domain.files.load import bundled_files, locate
from das.domain.files.reading import Fields, number, read_json, read_text, read_toml
from das.domain.files.writing import make_folder, write_whole
from sim.drivers.parameters import DEFAULT, load_population
from sim.experiment.factors import DEFAULTS, FACTORS, FactorLevel, Setting, setting_files
from sim.experiment.measures import MEASURES
from sim.experiment.plan import (
    CORRECTIONS,
    DEFAULT_ALPHA,
    DESIGN_JSON,
    DESIGN_TEXT,
    PlannedComparison,
    as_json,
    read_comparisons,
    read_correction,
)
from sim.recording.inputs import sha256

SCHEMA_VERSION: Final = 1
MOST_PARTICIPANTS: Final = 10_000
MOST_TRIALS_EACH: Final = 1000
LONGEST_BREAK_S: Final = 86_400.0
_NAME = re.compile(r"[a-z0-9][a-z0-9-]{0,63}")


class ConditionOrder(StrEnum):
    """The order in which a participant drives the conditions."""

    WILLIAMS = "williams"
    """Each participant takes a row of a Williams square, in whose rows together conditions follow each other alike."""
    FULL = "full"
    """The participants take all permutations in turn."""
    RANDOM = "random"
    """Each participant has an order of their own, drawn by the seed of the design."""
    LISTED = "listed"
    """All participants drive the conditions in the order of the design."""


class Days(StrEnum):
    """Which simulated days the trials take place on."""

    OWN = "own"
    """Every participant has days of their own, one for each repetition, and drives each under every condition."""
    COMMON = "common"
    """All participants drive the same days, one for each repetition, each under every condition."""
    NEW = "new"
    """Every trial is on a day of its own."""


class Chances(StrEnum):
    """Whether a participant's reaction times, glances, errors and lapses are redrawn for every trial."""

    NEW = "new"
    """Redrawn for every trial, as with people."""
    PAIRED = "paired"
    """The same for all trials of a participant on one day, which takes chance out of comparisons."""


@dataclass(frozen=True, kw_only=True)
class Factor:
    """A factor that varies: its name, its levels, and whether each participant drives all of them (`within`) or one."""

    name: str
    levels: tuple[FactorLevel, ...]
    within: bool


@dataclass(frozen=True, kw_only=True)
class People:
    """The participants: how many, from which number of the population on, and how practised they are.

    With `learning`, a participant has made `trips_before` trips before the first trial, and each trial counts as one
    more.
    """

    count: int
    first: int = 1
    population: str = DEFAULT
    trips_before: float = 0.0
    learning: bool = False


@dataclass(frozen=True, kw_only=True)
class Procedure:
    """The procedure for a participant: order, repetitions of all conditions, practice trials, breaks, days, chances.

    After every `break_after` trials (0: never) there is a break of `break_s`, and another session begins.
    """

    order: ConditionOrder = ConditionOrder.WILLIAMS
    repetitions: int = 1
    practice_trials: int = 0
    break_after: int = 0
    break_s: float = 600.0
    days: Days = Days.OWN
    chances: Chances = Chances.NEW


@dataclass(frozen=True, kw_only=True)
class AnalysisPlan:
    """What is analysed: the measures, the planned comparisons, and how these are corrected for their number."""

    measures: tuple[str, ...] = tuple(MEASURES)
    comparisons: tuple[PlannedComparison, ...] = ()
    alpha: float = DEFAULT_ALPHA
    correction: str = CORRECTIONS[0]


@dataclass(frozen=True, kw_only=True)
class Design:
    """An experiment: its factors, what is the same for all trials, its participants, their procedure, and its analysis.

    `fixed` has the level of each factor that does not vary, by name; a train or loss level that is neither
    fixed nor a factor is the scenario's. `seed` decides everything that is drawn; `source` is the design's file.
    """

    name: str
    title: str
    description: str
    source: Path
    seed: int
    fixed: Mapping[str, FactorLevel]
    factors: tuple[Factor, ...]
    people: People
    procedure: Procedure
    plan: AnalysisPlan

    def conditions(self, *, within: bool) -> list[dict[str, FactorLevel]]:
        """All combinations of levels of the factors within (or between) participants; if none exist, an empty one."""
        some = [factor for factor in self.factors if factor.within is within]
        return [
            {factor.name: level for factor, level in zip(some, levels, strict=True)}
            for levels in product(*(factor.levels for factor in some))
        ]

    def setting(self, condition: Mapping[str, FactorLevel]) -> Setting:
        """How a trial under a condition is driven; a factor that the condition does not name keeps its fixed level."""
        values: dict[str, Any] = {name: level.value for name, level in (dict(self.fixed) | dict(condition)).items()}
        return Setting(**values)

    def settings(self) -> Iterator[Setting]:
        """The settings of all combinations of levels."""
        for between in self.conditions(within=False):
            yield from (self.setting(between | inside) for inside in self.conditions(within=True))


def bundled_studies() -> dict[str, Path]:
    """The design of each study that comes with the program, by name."""
    return bundled_files("sim.experiment", "studies")


def load_design(name_or_path: str) -> Design:
    """Read a bundled study or a TOML file; raises DasError or InputError for anything unusable."""
    return read_design(locate(name_or_path, "study", bundled_studies()))


def read_design(path: Path) -> Design:
    """Read a design; raises DasError or InputError (file, key, value, expectation) for anything unusable."""
    fields = read_toml(path)
    fields.check_schema_version(SCHEMA_VERSION)
    tables = ("experiment", "participants", "procedure", "fixed", "factors", "analysis", "comparisons")
    fields.check_keys(["schema_version", *tables])
    main = fields.table("experiment")
    main.check_keys(["name", "title", "description", "seed"])
    name, factors = main.text("name"), _factors(fields)
    if not _NAME.fullmatch(name):
        raise main.error("name", name, "1 to 64 small letters, digits and '-', not beginning with '-'")
    return Design(
        name=name,
        title=main.name("title"),
        description=main.text("description", ""),
        source=path,
        seed=main.whole("seed", (0, 2**31), 1),
        fixed=_fixed(fields.optional_table("fixed"), factors),
        factors=factors,
        people=_people(fields.table("participants")),
        procedure=_procedure(fields.optional_table("procedure"), factors),
        plan=_plan(fields, factors),
    )


def _real(table: Fields, key: str, ends: tuple[float, float], default: float) -> float:
    value = number(table.source, f"{table.prefix}{key}", table.data.get(key, default))
    if not ends[0] <= value <= ends[1]:
        raise table.error(key, value, f"a number from {ends[0]:g} to {ends[1]:g}")
    return value


def _factors(fields: Fields) -> tuple[Factor, ...]:
    found: dict[str, Factor] = {}
    for i, row in enumerate(fields.rows("factors", "a list of [[factors]], at least one")):
        table = Fields.of(fields.source, row, f"factors[{i}].")
        table.check_keys(["name", "levels", "within"])
        name = table.text("name")
        if name not in FACTORS:
            raise table.error("name", name, f"one of {', '.join(FACTORS)}")
        if name in found:
            raise table.error("name", name, "each factor once")
        values = table.rows("levels", "a list of at least 2 levels")
        levels = tuple(FACTORS[name].read(table, "levels", value) for value in values)
        if len(levels) < 2 or len({level.text for level in levels}) < len(levels):
            raise table.error("levels", values, "at least 2 levels, each once")
        found[name] = Factor(name=name, levels=levels, within=table.flag("within", True))
    return tuple(found.values())


def _fixed(table: Fields, factors: tuple[Factor, ...]) -> dict[str, FactorLevel]:
    """What is the same for all trials, defaults included; InputError for a factor that varies as well."""
    table.check_keys(list(FACTORS))
    for factor in factors:
        if table.has(factor.name):
            raise table.error(factor.name, table.data[factor.name], "nothing, because it is a factor of the design")
    varied = {factor.name for factor in factors}
    given = {name: value for name, value in DEFAULTS.items() if name not in varied} | dict(table.data)
    return {name: FACTORS[name].read(table, name, value) for name, value in given.items()}


def _people(table: Fields) -> People:
    table.check_keys(list(People.__dataclass_fields__))
    text = table.text("population", DEFAULT)
    population = str((table.source.parent / text).resolve()) if text.endswith(".toml") else text
    load_population(population)
    return People(
        count=table.whole("count", (1, MOST_PARTICIPANTS)),
        first=table.whole("first", (0, 10**9), People.first),
        population=population,
        trips_before=_real(table, "trips_before", (0.0, 1e5), People.trips_before),
        learning=table.flag("learning", People.learning),
    )


def _procedure(table: Fields, factors: tuple[Factor, ...]) -> Procedure:
    keys = [name for name in Procedure.__dataclass_fields__ if name != "break_s"]
    table.check_keys([*keys, *table.quantity_keys({"break": "time"})])
    found = Procedure(
        order=table.choice("order", ConditionOrder, Procedure.order),
        repetitions=table.whole("repetitions", (1, MOST_TRIALS_EACH), Procedure.repetitions),
        practice_trials=table.whole("practice_trials", (0, MOST_TRIALS_EACH), Procedure.practice_trials),
        break_after=table.whole("break_after", (0, MOST_TRIALS_EACH), Procedure.break_after),
        break_s=table.within("break", "time", Procedure.break_s, (0.0, LONGEST_BREAK_S)),
        days=table.choice("days", Days, Procedure.days),
        chances=table.choice("chances", Chances, Procedure.chances),
    )
    each = found.repetitions
    for factor in factors:
        each *= len(factor.levels) if factor.within else 1
    if each + found.practice_trials > MOST_TRIALS_EACH:
        raise table.error("repetitions", found.repetitions, f"at most {MOST_TRIALS_EACH} trials for each participant")
    return found


def _plan(fields: Fields, factors: tuple[Factor, ...]) -> AnalysisPlan:
    table = fields.optional_table("analysis")
    table.check_keys(["measures", "alpha", "correction"])
    names = table.rows("measures", "a list of measures") if table.has("measures") else list(MEASURES)
    for name in names:
        if not isinstance(name, str) or name not in MEASURES or names.count(name) > 1:
            raise table.error("measures", name, f"each once, of {', '.join(MEASURES)}")
    alpha = _real(table, "alpha", (1e-6, 0.5), DEFAULT_ALPHA)
    levels = {factor.name: partial(_level_text, factor) for factor in factors}
    comparisons = read_comparisons(fields, levels, names)
    return AnalysisPlan(measures=tuple(names), comparisons=comparisons, alpha=alpha, correction=read_correction(table))


def _level_text(factor: Factor, table: Fields, key: str) -> str:
    """The text of a level that is given as its text, or as its value in the list of levels."""
    texts = [level.text for level in factor.levels]
    value = table.data.get(key, MISSING)
    if isinstance(value, str) and value in texts:
        return value
    read = None if value is MISSING else FACTORS[factor.name].read(table, key, value).text
    if read not in texts:
        raise table.error(key, value, f"one of the levels {', '.join(texts)}")
    return read


def resolved(design: Design) -> dict[str, Any]:
    """The design with all defaults, the hashes of its files and its own hash; raises DasError for a missing file.

    It holds no path, so that the same design has the same hash on every machine.
    """
    found: dict[str, Any] = {
        "schema_version": SCHEMA_VERSION,
        "name": design.name,
        "title": design.title,
        "description": design.description,
        "seed": design.seed,
        "participants": {**asdict(design.people), "population": load_population(design.people.population).id},
        "procedure": asdict(design.procedure),
        "fixed": {name: level.text for name, level in sorted(design.fixed.items())},
        "factors": {
            factor.name: {"levels": [level.text for level in factor.levels], "within": factor.within}
            for factor in design.factors
        },
        "measures": list(design.plan.measures),
        "comparisons": [asdict(one) for one in design.plan.comparisons],
        "alpha": design.plan.alpha,
        "correction": design.plan.correction,
        "files": design_files(design),
    }
    return {"hash": design_sha256(found), **found}


def design_sha256(found: Mapping[str, Any]) -> str:
    """SHA-256 of a resolved design without its hash, in one canonical form: keys sorted, no white space.

    The order of the factors is part of it, because it decides the names of the conditions.
    """
    content = {key: value for key, value in found.items() if key != "hash"}
    content["factor_order"] = list(found["factors"])
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def design_files(design: Design) -> dict[str, str]:
    """The hash of each file that decides the result, by what the file is; raises DasError for a missing file."""
    found = {"population": sha256(Path(load_population(design.people.population).source))}
    for setting in design.settings():
        found |= setting_files(setting)
    return dict(sorted(found.items()))


def freeze(design: Design, folder: Path) -> dict[str, Any]:
    """Write the design into a study's folder, which is made if needed, and return its resolved form.

    Raises DasError if the folder holds another frozen design.
    """
    found = resolved(design)
    make_folder(folder)
    kept = folder / DESIGN_JSON
    if kept.exists():
        check_frozen(design, folder, found["hash"])
    else:
        write_whole(folder / DESIGN_TEXT, read_text(design.source).encode())
        write_whole(kept, as_json(found))
    return found


def check_frozen(design: Design, folder: Path, own_sha256: str) -> None:
    """Raise DasError if the frozen design of a folder is not this one, or was altered."""
    kept = read_json(folder / DESIGN_JSON)
    text = kept.text("hash")
    if text != design_sha256(kept.data):
        raise DasError(f"{folder / DESIGN_JSON}: hash = {text[:12]}…: the file was altered after it was frozen")
    if text != own_sha256:
        was, now = text[:12], own_sha256[:12]
        how = "expected the same design, or another folder"
        raise DasError(f"{design.source}: its hash is {now}…, but {folder} holds the frozen design {was}…: {how}")
