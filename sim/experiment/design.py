"""The design of an experiment: factors, participants, order, measures and planned comparisons, and its file.

The format: docs/reference/experiments.md. A design is frozen in its study's folder as JSON with the same keys, every
default written out, and with a hash that reveals later changes. The same functions read the frozen form, without other
files.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from itertools import product
from pathlib import Path
from typing import Any, Final

from das.domain.errors import MISSING, DasError
from das.domain.files.load import bundled_files, locate
from das.domain.files.reading import Fields, number, read_json, read_text, read_toml
from das.domain.files.writing import make_folder, write_whole
from sim.drivers.kinds import DESK
from sim.drivers.parameters import DEFAULT, load_population
from sim.experiment.driving import participant_name
from sim.experiment.factors import DEFAULTS, FACTORS, OF_HUMAN, FactorLevel, Setting, setting_files
from sim.experiment.measures import BUNDLED, MEASURES
from sim.experiment.people_plan import PeoplePlan, read_plan
from sim.recording.opening import sha256

DESIGN_TEXT: Final = "design.toml"
"""The frozen design as written by the user, with its comments."""
DESIGN_JSON: Final = "design.json"
"""The frozen design: every default written out, the hashes of its files, and the hash of the whole."""
DEFAULT_ALPHA: Final = 0.05
CORRECTIONS: Final = ("holm", "bonferroni", "none")
"""Corrections of planned comparisons for their number; the first is the default."""
MOST_COMPARISONS: Final = 200
SCHEMA_VERSION: Final = 1
MOST_PARTICIPANTS: Final = 10_000
MOST_TRIALS_EACH: Final = 100_000
LONGEST_BREAK_S: Final = 86_400.0
_NAME = re.compile(r"[a-z0-9][a-z0-9-]{0,63}")
_NAME_WORDS: Final = "1 to 64 small letters, digits and '-', not beginning with '-'"
_COLUMN = re.compile(r"[a-z][a-z0-9_]{0,63}")
COLUMNS: Final = ("trial", "participant", "session", "position", "practice", "braked", "condition", "seed")
"""The columns of the table of trials that are neither factors nor measures."""


class ConditionOrder(StrEnum):
    """The order in which a participant drives the conditions."""

    WILLIAMS = "williams"
    """Each participant is assigned a row of a Williams square, in which every condition follows every other condition
    equally often."""
    RANDOM = "random"
    """Each participant has an individual order, drawn with the seed of the design."""
    LISTED = "listed"
    """All participants drive the conditions in the order of the design."""


class Days(StrEnum):
    """The assignment of simulated days (seeds) to trials."""

    OWN = "own"
    """Every participant has individual days, one for each repetition, and drives each day under every condition."""
    COMMON = "common"
    """All participants drive the same days, one for each repetition, and each day under every condition."""


class Chances(StrEnum):
    """The choice whether a participant's reaction times, glances, errors and lapses are redrawn for every trial."""

    NEW = "new"
    """Redrawn for every trial: people too vary from trial to trial."""
    PAIRED = "paired"
    """The same for all trials of a participant on one day, so that chance does not affect comparisons."""


@dataclass(frozen=True, kw_only=True)
class PlannedComparison:
    """A planned comparison: `measure` at level `a` of `factor` minus `measure` at level `b`.

    `where` fixes the levels of other factors. A factor that is not named enters with all its levels.
    """

    name: str
    measure: str
    factor: str
    a: str
    b: str
    where: Mapping[str, str] = field(default_factory=dict)

    @property
    def title(self) -> str:
        """The name of the comparison; its contrast if the design states no name."""
        return self.contrast() if self.name.startswith(f"{self.measure}: ") else self.name

    def contrast(self, between: str = ", ") -> str:
        """The difference in words: a minus b, and the fixed levels, with the text `between` before each level."""
        return f"{self.a} minus {self.b}" + "".join(f"{between}{name}: {level}" for name, level in self.where.items())


@dataclass(frozen=True, kw_only=True)
class Factor:
    """A factor of the design: its name, its levels, and whether each participant drives all of them (`within`) or one.

    The name is one of `FACTORS`, or chosen by the user. In the latter case the levels have names, and each level fixes
    one or more `FACTORS`.
    """

    name: str
    levels: tuple[FactorLevel, ...]
    within: bool

    @property
    def texts(self) -> tuple[str, ...]:
        """The texts of the levels in tables."""
        return tuple(level.text for level in self.levels)

    @property
    def varied(self) -> tuple[str, ...]:
        """The names of the settings of a trial that this factor decides."""
        return tuple(self.levels[0].settings) or (self.name,)


@dataclass(frozen=True, kw_only=True)
class People:
    """The participants: their number, the first number in the population, and their practice.

    With `average`, the only participant is not drawn, but has the default of every parameter, as in `das-sim run`. With
    `learning`, a participant has made `trips_before` trips before the first trial, and each trial counts as one more.
    """

    count: int
    first: int = 1
    population: str = DEFAULT
    trips_before: float = 0.0
    learning: bool = False
    average: bool = False


@dataclass(frozen=True, kw_only=True)
class Procedure:
    """The procedure for a participant: order, repetitions of all conditions, practice trials, breaks, days, chances.

    After every `break_after` trials (0: never) there is a break of `break_s`, and another session begins. `seeds` are
    the seeds of common days, one for each repetition; if empty, the seeds are drawn.
    """

    order: ConditionOrder = ConditionOrder.WILLIAMS
    repetitions: int = 1
    practice_trials: int = 0
    break_after: int = 0
    break_s: float = 600.0
    days: Days = Days.OWN
    chances: Chances = Chances.NEW
    seeds: tuple[int, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Design:
    """An experiment: factors, the fixed settings of all trials, participants, the procedure for a participant, and
    the analysis.

    `fixed` has the level of each factor that does not vary, by name; a train or loss level that is neither fixed nor a
    factor is the scenario's. `seed` determines all random draws; `source` is the design's file. `measures` are
    analysed; `comparisons` were planned, and `correction` corrects p for the number of comparisons. `desk` is the
    procedure with people at the desk; None if the design has no table `[desk]`. `hash` is the hash of a frozen design,
    and empty for a design that was read from the user's file.
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
    measures: tuple[str, ...] = BUNDLED
    comparisons: tuple[PlannedComparison, ...] = ()
    alpha: float = DEFAULT_ALPHA
    correction: str = CORRECTIONS[0]
    desk: PeoplePlan | None = None
    hash: str = ""

    def conditions(self, *, within: bool) -> list[dict[str, FactorLevel]]:
        """All combinations of the levels of the factors within (or between) participants; one empty one without any."""
        some = [factor for factor in self.factors if factor.within is within]
        return [
            {factor.name: level for factor, level in zip(some, levels, strict=True)}
            for levels in product(*(factor.levels for factor in some))
        ]

    def factor(self, name: str) -> Factor:
        """The factor with this name; KeyError if there is none."""
        return {one.name: one for one in self.factors}[name]

    @property
    def driven_by_people(self) -> bool:
        """Whether people drive the trials of this design; such a design must not contain simulated drivers."""
        return any(setting.driver is DESK for setting in self.settings())

    @property
    def planned(self) -> Counter[tuple[str, str]]:
        """The number of planned trials without practice, by participant and condition.

        A condition consists of the texts of all factors' levels, in the order of the design, separated by spaces.
        """
        groups = self.conditions(within=False)
        found = Counter[tuple[str, str]]()
        for who in range(self.people.count):
            for inside in self.conditions(within=True):
                condition = groups[who % len(groups)] | inside
                texts = " ".join(condition[one.name].text for one in self.factors)
                found[participant_name(who + 1), texts] = self.procedure.repetitions
        return found

    def setting(self, condition: Mapping[str, FactorLevel]) -> Setting:
        """The setting of a trial under a condition; a factor that the condition does not name keeps its fixed
        level."""
        each = dict(self.fixed) | dict(condition)
        levels = {name: one for key, level in each.items() for name, one in (level.settings or {key: level}).items()}
        values: dict[str, Any] = {name: level.value for name, level in levels.items()}
        of_human = sorted(name for name in values if name.startswith(OF_HUMAN))
        human = tuple((name.removeprefix(OF_HUMAN), values.pop(name)) for name in of_human)
        return Setting(**values, human=human)

    def settings(self) -> Iterator[Setting]:
        """The settings of all combinations of levels."""
        for between in self.conditions(within=False):
            yield from (self.setting(between | inside) for inside in self.conditions(within=True))


def bundled_studies() -> dict[str, Path]:
    """The designs of the bundled studies, by name."""
    return bundled_files("sim.experiment", "studies")


def load_design(name_or_path: str) -> Design:
    """Read a bundled study or a TOML file; raises DasError or InputError for anything unusable."""
    return read_design(locate(name_or_path, "study", bundled_studies()))


TABLES: Final = ("experiment", "participants", "procedure", "fixed", "factors", "analysis", "comparisons", "desk")


def read_design(path: Path) -> Design:
    """Read a design; raises DasError or InputError (file, key, value, expectation) for anything unusable."""
    return _design(read_toml(path), frozen=False)


def read_frozen(path: Path) -> Design:
    """Read the frozen design of a study's folder, whose factors and measures another program may have provided.

    Raises DasError or InputError for anything unusable.
    """
    fields = read_json(path / DESIGN_JSON if path.is_dir() else path)
    if "experiment" not in fields.data and "name" in fields.data:
        raise DasError(f"{fields.source}: frozen by an earlier version: run the design again in a new folder")
    return _design(fields, frozen=True)


def _level(factor: str, table: Fields, key: str, value: Any, *, frozen: bool) -> FactorLevel:
    """A level of a factor; raises InputError for a value that is not allowed. A `frozen` design may have any value."""
    return FactorLevel(text=as_text(value), value=None) if frozen else FACTORS[factor].read(table, key, value)


def as_text(level: object) -> str:
    """The text of a level in the table of trials; equal numbers give the same text."""
    if isinstance(level, bool):
        return str(level).lower()
    try:
        return f"{float(level):.12g}" if isinstance(level, int | float | str) else str(level)
    except ValueError:
        return str(level)


def _design(fields: Fields, *, frozen: bool) -> Design:
    """The design in a file; factors, levels and measures of a `frozen` design may come from another program."""
    fields.check_schema_version(SCHEMA_VERSION)
    fields.check_keys(["schema_version", *TABLES, *(("hash", "files") if frozen else ())])
    main = fields.table("experiment")
    main.check_keys(["name", "title", "description", "seed"])
    name, factors = study_name(main), _factors(fields, frozen=frozen)
    analysis = fields.optional_table("analysis")
    analysis.check_keys(["measures", "alpha", "correction"])
    desk = read_plan(fields.table("desk"), frozen=frozen) if fields.has("desk") else None
    measures = _measures(analysis, desk, frozen=frozen)
    correction = analysis.text("correction", CORRECTIONS[0])
    if correction not in CORRECTIONS:
        raise analysis.error("correction", correction, f"one of {', '.join(CORRECTIONS)}")
    return Design(
        name=name,
        title=main.name("title"),
        description=main.text("description", ""),
        source=fields.source,
        seed=main.whole("seed", (0, 2**31), 1),
        fixed=_fixed(fields.optional_table("fixed"), factors, frozen=frozen),
        factors=factors,
        people=_people(fields.table("participants"), frozen=frozen),
        procedure=_procedure(fields.optional_table("procedure"), factors),
        measures=measures,
        comparisons=_comparisons(fields, factors, measures, frozen=frozen),
        alpha=real(analysis, "alpha", (1e-6, 0.5), DEFAULT_ALPHA),
        correction=correction,
        desk=desk,
        hash=fields.text("hash", ""),
    )


def study_name(table: Fields) -> str:
    """The name of a study, which may become that of a folder; InputError for any other text."""
    name = table.text("name")
    if not _NAME.fullmatch(name):
        raise table.error("name", name, _NAME_WORDS)
    return name


def real(table: Fields, key: str, ends: tuple[float, float], default: object = MISSING, unit: str = "") -> float:
    """The number under a key, between the two ends (inclusive) in the unit; InputError for anything else."""
    value = number(table.source, f"{table.prefix}{key}", table.data.get(key, default))
    if not ends[0] <= value <= ends[1]:
        raise table.error(key, value, f"a number from {ends[0]:g} to {ends[1]:g} {unit}".rstrip())
    return value


def _factors(fields: Fields, *, frozen: bool) -> tuple[Factor, ...]:
    found: dict[str, Factor] = {}
    for i, row in enumerate(fields.rows("factors", "a list of [[factors]], at least one")):
        table = Fields.of(fields.source, row, f"factors[{i}].")
        table.check_keys(["name", "levels", "within"])
        name = table.text("name")
        if name in found:
            raise table.error("name", name, "each factor only once")
        values = table.rows("levels", "a list of at least 2 levels")
        if all(isinstance(value, dict) for value in values):
            levels = _named_levels(name, table, values, frozen=frozen)
        elif not frozen and name not in FACTORS:
            raise table.error("name", name, f"one of {', '.join(FACTORS)}, or a name of your own with named levels")
        else:
            levels = tuple(_level(name, table, "levels", value, frozen=frozen) for value in values)
        if len(levels) < (1 if frozen else 2) or len({level.text for level in levels}) < len(levels):
            raise table.error("levels", values, "at least 2 levels, each once")
        if any(one.value is DESK for level in levels for one in (level, *level.settings.values())):
            raise table.error("levels", str(DESK), "simulated drivers; for people fixed.driver = 'desk'")
        found[name] = Factor(name=name, levels=levels, within=table.flag("within", True))
    times = Counter(setting for factor in found.values() for setting in factor.varied)
    if twice := [setting for setting, count in times.items() if count > 1]:
        raise fields.error("factors", twice[0], "each setting in one factor only")
    return tuple(found.values())


def _named_levels(factor: str, table: Fields, values: Sequence[Any], *, frozen: bool) -> tuple[FactorLevel, ...]:
    """The named levels of a factor; a setting stated by only some levels has its default in the others."""
    rows = [Fields.of(table.source, value, f"{table.prefix}levels[{i}].") for i, value in enumerate(values)]
    stated = dict.fromkeys(name for row in rows for name in row.data if name != "name")
    if not stated:
        raise table.error("levels", list(values), "levels with at least one setting")
    if not frozen and (not _COLUMN.fullmatch(factor) or factor in (*FACTORS, *MEASURES, *COLUMNS)):
        raise table.error("name", factor, "small letters, digits and _, but no name of a factor, measure or column")
    for row in [] if frozen else rows:
        row.check_keys(["name", *FACTORS])
        if not _NAME.fullmatch(row.text("name")):
            raise row.error("name", row.text("name"), _NAME_WORDS)
    usual = {} if frozen else defaults(FACTORS.keys() - stated)

    def setting(row: Fields, name: str) -> FactorLevel:
        if row.has(name):
            return _level(name, row, name, row.data[name], frozen=frozen)
        if name not in usual:
            raise row.error(name, MISSING, "a value in every level, because there is no default")
        return usual[name]

    return tuple(
        FactorLevel(text=row.text("name"), settings={name: setting(row, name) for name in stated}) for row in rows
    )


def _fixed(table: Fields, factors: tuple[Factor, ...], *, frozen: bool) -> dict[str, FactorLevel]:
    """The fixed settings of all trials, defaults included; InputError for a factor that also varies."""
    if not frozen:
        table.check_keys(list(FACTORS))
    varied = {name: factor.name for factor in factors for name in factor.varied}
    for name in table.data:
        if name in varied:
            expected = f"nothing, because the factor {varied[name]} of the design decides it"
            raise table.error(name, table.data[name], expected)
    given = {name: _level(name, table, name, value, frozen=frozen) for name, value in table.data.items()}
    return given if frozen else {**defaults(varied.keys() | given.keys()), **given}


def defaults(but: Collection[str]) -> dict[str, FactorLevel]:
    """The default levels of all factors except those in `but`."""
    nowhere = Fields.of(Path(), {})
    return {name: FACTORS[name].read(nowhere, name, value) for name, value in DEFAULTS.items() if name not in but}


def _measures(table: Fields, desk: PeoplePlan | None, *, frozen: bool) -> tuple[str, ...]:
    """The measures of a design. Scores of questionnaires may be among them; they are checked with the whole design."""
    frozen = frozen or (desk is not None and bool(desk.of_a_trial or desk.tasks))
    names = table.rows("measures", "a list of measures") if table.has("measures") else list(BUNDLED)
    for name in names:
        if not isinstance(name, str) or names.count(name) > 1 or (not frozen and name not in MEASURES):
            raise table.error(
                "measures", name, f"each only once, one of {'the columns' if frozen else ', '.join(MEASURES)}"
            )
    return tuple(names)


def _comparisons(
    fields: Fields, factors: Sequence[Factor], measures: Sequence[str], *, frozen: bool
) -> tuple[PlannedComparison, ...]:
    """The planned comparisons of a design; none if the study only describes conditions."""
    by_name, tables = {factor.name: factor for factor in factors}, fields.tables("comparisons", MOST_COMPARISONS)
    found = tuple(_comparison(one, by_name, measures, frozen=frozen) for one in tables)
    names = [one.name for one in found]
    for name in names:
        if names.count(name) > 1:
            raise fields.error("comparisons", name, "a name of its own for each comparison")
    return found


def _comparison(
    table: Fields, factors: Mapping[str, Factor], measures: Sequence[str], *, frozen: bool
) -> PlannedComparison:
    table.check_keys(list(PlannedComparison.__dataclass_fields__))
    factor, measure = table.text("factor"), table.text("measure")
    if factor not in factors:
        raise table.error("factor", factor, f"one of the factors {', '.join(factors)}")
    if measure not in measures:
        raise table.error("measure", measure, f"one of the measures {', '.join(measures)}")
    a, b = (_level_text(factors[factor], table, key, frozen=frozen) for key in ("a", "b"))
    if a == b:
        raise table.error("b", table.data["b"], "a level other than that of a")
    where = table.optional_table("where")
    where.check_keys([name for name in factors if name != factor])
    fixed = {name: _level_text(factors[name], where, name, frozen=frozen) for name in where.data}
    only = "".join(f", {name} {level}" for name, level in fixed.items())
    name = table.name("name", f"{measure}: {a} - {b}{only}")
    return PlannedComparison(name=name, measure=measure, factor=factor, a=a, b=b, where=fixed)


def _level_text(factor: Factor, table: Fields, key: str, *, frozen: bool) -> str:
    """The text of a level that the file gives by text or, as in the list of levels, by value."""
    value = table.data.get(key, MISSING)
    if isinstance(value, str) and value in factor.texts:
        return value
    named = factor.name not in factor.varied
    read = None if value is MISSING or named else _level(factor.name, table, key, value, frozen=frozen).text
    if read not in factor.texts:
        raise table.error(key, value, f"one of the levels {', '.join(factor.texts)}")
    return read


def _people(table: Fields, *, frozen: bool) -> People:
    table.check_keys(list(People.__dataclass_fields__))
    population = table.text("population", DEFAULT) if frozen else population_of(table)
    found = People(
        count=table.whole("count", (1, MOST_PARTICIPANTS)),
        first=table.whole("first", (0, 10**9), People.first),
        population=population,
        trips_before=real(table, "trips_before", (0.0, 1e5), People.trips_before),
        learning=table.flag("learning", People.learning),
        average=table.flag("average", People.average),
    )
    if found.average and found.count > 1:
        raise table.error("count", found.count, "1, because participants.average = true")
    return found


def population_of(table: Fields) -> str:
    """The population of a table, by its bundled name or its path; DasError for one that cannot be used."""
    name = table.text("population", DEFAULT)
    population = str((table.source.parent / name).resolve()) if name.endswith(".toml") else name
    load_population(population)
    return population


def _procedure(table: Fields, factors: tuple[Factor, ...]) -> Procedure:
    keys = [name for name in Procedure.__dataclass_fields__ if name != "break_s"]
    table.check_keys([*keys, *table.quantity_keys({"break": "time"})])
    seeds = _seeds(table)
    found = Procedure(
        order=table.choice("order", ConditionOrder, Procedure.order),
        repetitions=table.whole("repetitions", (1, MOST_TRIALS_EACH), len(seeds) or Procedure.repetitions),
        practice_trials=table.whole("practice_trials", (0, MOST_TRIALS_EACH), Procedure.practice_trials),
        break_after=table.whole("break_after", (0, MOST_TRIALS_EACH), Procedure.break_after),
        break_s=table.within("break", "time", Procedure.break_s, (0.0, LONGEST_BREAK_S)),
        days=table.choice("days", Days, Days.COMMON if seeds else Procedure.days),
        chances=table.choice("chances", Chances, Procedure.chances),
        seeds=seeds,
    )
    if seeds and (found.repetitions, found.days) != (len(seeds), Days.COMMON):
        raise table.error(
            "seeds", list(seeds), f"{found.repetitions} seeds (one for each repetition), with days = 'common'"
        )
    each = found.repetitions
    for factor in factors:
        each *= len(factor.levels) if factor.within else 1
    if each + found.practice_trials > MOST_TRIALS_EACH:
        raise table.error("repetitions", found.repetitions, f"at most {MOST_TRIALS_EACH} trials for each participant")
    return found


def _seeds(table: Fields) -> tuple[int, ...]:
    listed = table.data.get("seeds", [])
    if not isinstance(listed, list) or any(isinstance(one, bool) or not isinstance(one, int) for one in listed):
        raise table.error("seeds", listed, "a list of whole numbers")
    if any(not 0 <= one < 2**31 for one in listed) or len(set(listed)) < len(listed):
        raise table.error("seeds", listed, "whole numbers from 0 to 2147483647, each once")
    return tuple(listed)


def resolved(design: Design) -> dict[str, Any]:
    """The design with all defaults, the hashes of its files and its own hash; raises DasError for a missing file.

    The keys are those of a design file. There is no path in it, so that a design has the same hash on every machine.
    """
    found: dict[str, Any] = {
        "schema_version": SCHEMA_VERSION,
        "experiment": {
            "name": design.name,
            "title": design.title,
            "description": design.description,
            "seed": design.seed,
        },
        "participants": {**asdict(design.people), "population": load_population(design.people.population).id},
        "procedure": asdict(design.procedure),
        "fixed": {name: level.text for name, level in sorted(design.fixed.items())},
        "factors": [
            {"name": factor.name, "levels": list(map(_frozen_level, factor.levels)), "within": factor.within}
            for factor in design.factors
        ],
        "analysis": {
            "measures": list(design.measures),
            "alpha": design.alpha,
            "correction": design.correction,
        },
        "comparisons": [asdict(one) for one in design.comparisons],
        **({} if design.desk is None else {"desk": design.desk.figures}),
        "files": design_files(design),
    }
    return {"hash": design_sha256(found), **found}


def _frozen_level(level: FactorLevel) -> str | dict[str, str]:
    """A level as in a frozen design: the text; for a named level, the texts of all its settings as well."""
    settings = {name: one.text for name, one in sorted(level.settings.items())}
    return {"name": level.text, **settings} if settings else level.text


def design_sha256(found: Mapping[str, Any]) -> str:
    """SHA-256 of a resolved design without its hash, in one canonical form: keys sorted, no white space."""
    content = {key: value for key, value in found.items() if key != "hash"}
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def design_files(design: Design) -> dict[str, str]:
    """The hash of each file that decides the result, by what the file is; raises DasError for a missing file."""
    found = {"population": sha256(Path(load_population(design.people.population).source))}
    for setting in design.settings():
        found |= setting_files(setting)
    found |= {f"desk: {name}": sha256(path) for name, path in (design.desk or PeoplePlan()).files.items()}
    return dict(sorted(found.items()))


def freeze(design: Design, folder: Path) -> dict[str, Any]:
    """Write the design into a study's folder, which is made if needed, and return its resolved form.

    Raises DasError if the folder holds another frozen design; a design without a file replaces a frozen design.
    """
    found = resolved(design)
    make_folder(folder)
    kept = folder / DESIGN_JSON
    if design.source.is_file():
        if kept.exists():
            check_frozen(design, folder)
            return found
        _keep_texts(design.desk or PeoplePlan(), folder)
        write_whole(folder / DESIGN_TEXT, read_text(design.source).encode())
    write_whole(kept, json.dumps(found, indent=2, ensure_ascii=False).encode() + b"\n")
    return found


def _keep_texts(plan: PeoplePlan, folder: Path) -> None:
    """Copy the laboratory's texts and questionnaires into a study's folder, so that its design can be read there.

    Raises DasError if another file is in the place of one of them.
    """
    own = {folder / name: path for name, path in plan.files.items() if Path(name).suffix}  # bundled ones have no suffix
    for kept, path in own.items():
        if kept.exists() and sha256(kept) != sha256(path):
            raise DasError(f"{kept}: exists and differs from {path}: expected another folder")
    for kept, path in own.items():
        if not kept.exists():
            make_folder(kept.parent)
            write_whole(kept, path.read_bytes())


def check_frozen(design: Design, folder: Path) -> None:
    """Raise DasError if the frozen design of a folder is another than the given one, or was altered."""
    own, kept = resolved(design), read_json(folder / DESIGN_JSON)
    text = kept.text("hash")
    if text != design_sha256(kept.data):
        raise DasError(f"{folder / DESIGN_JSON}: hash = {text[:12]}…: the file was altered after it was frozen")
    if text != own["hash"]:
        now = json.loads(json.dumps(own))  # with lists for tuples, as in the file
        keys = [key for key in {**now, **kept.data} if now.get(key) != kept.data.get(key) and key != "hash"]
        how = "expected the same design, or another folder"
        raise DasError(f"{design.source}: {', '.join(keys)}: {folder} holds the frozen design of other values: {how}")
