"""The table [desk] of a design: the procedure of an experiment with people at the desk, besides its trials."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

from das.domain.errors import MISSING
from das.domain.files.load import bundled_files
from das.domain.files.reading import Fields, number
from das.domain.units import KMH
from sim.options import MOST_NOTCHES

TEXTS: Final = ("consent", "instructions", "debriefing")
"""The keys of the Markdown texts, in their order."""
FORMS: Final = ("before", "after_trial", "after")
"""The keys of the lists of questionnaires, in their order."""
MOST_FORMS, MOST_PROBES, MOST_PRACTICE = 20, 10, 20
CRITERION_MPS: Final = 3.0 * KMH
_FORM = re.compile(r"(?!probe-)[\w-]{1,40}", re.ASCII)
LONGEST_HOLD_S: Final = 3600.0
FASTEST_PACE: Final = 100.0


class Interrupted(StrEnum):
    """What follows an interrupted trial."""

    REPEAT = "repeat"
    """The participant drives it again."""
    SKIP = "skip"
    """The participant goes on to the next trial."""


class SideTask(StrEnum):
    """The tasks beside driving; the values are those in a design and in messages to the page."""

    PEDAL = "pedal"
    """A request at long intervals, as from a vigilance device, that stays until it is answered or 5 s have passed."""
    DETECTION = "detection"
    """A disc that appears for at most 1 s every 3 to 5 s (intervals of the detection-response task, ISO 17488)."""


@dataclass(frozen=True, kw_only=True)
class PeoplePlan:
    """The procedure with people: texts, questionnaires, practice, interruptions, and the desk's settings.

    `consent`, `instructions` and `debriefing` are Markdown files, empty for none; `before`, `after_trial` and `after`
    are bundled questionnaires or TOML files. `tasks` are those beside driving; `probes` is the number of times that a
    trial stops for the questionnaire `probe`. Paths are relative to `folder`, that of the design's file. The last
    practice trial is repeated, at most `practice_most` drives in all, until the speed stayed within
    ±`practice_criterion_mps` of the advised one (without advice: the limit) for `practice_hold_s`; 0: no criterion.
    """

    consent: str = ""
    instructions: str = ""
    debriefing: str = ""
    before: tuple[str, ...] = ()
    after_trial: tuple[str, ...] = ()
    after: tuple[str, ...] = ()
    practice_criterion_mps: float = CRITERION_MPS
    practice_hold_s: float = 60.0
    practice_most: int = 3
    interrupted: Interrupted = Interrupted.REPEAT
    notches: int = 10
    pace: float = 1.0
    tasks: tuple[SideTask, ...] = ()
    probes: int = 0
    probe: str = ""
    folder: Path = Path()

    @property
    def figures(self) -> dict[str, Any]:
        """The table with every default written out, as in a frozen design, which holds no path of this machine."""
        found = {name: getattr(self, name) for name in self.__dataclass_fields__ if name != "folder"}
        return {name: list(value) if isinstance(value, tuple) else value for name, value in found.items()}

    @property
    def forms(self) -> tuple[str, ...]:
        """All questionnaires, each once."""
        every = [*(name for key in FORMS for name in getattr(self, key)), self.probe]
        return tuple(dict.fromkeys(filter(None, every)))

    @property
    def of_a_trial(self) -> tuple[str, ...]:
        """The questionnaires of a trial, whose scores are its measures."""
        return (*self.after_trial, *filter(None, [self.probe]))

    @property
    def files(self) -> dict[str, Path]:
        """The texts and questionnaires, by their names in the design."""
        texts, bundled = filter(None, (getattr(self, key) for key in TEXTS)), bundled_forms()
        return {name: bundled.get(name, self.folder / name) for name in (*texts, *self.forms)}


def bundled_forms() -> Mapping[str, Path]:
    """The files of the bundled questionnaires, by name."""
    return bundled_files("sim.experiment.people", "forms")


def read_plan(table: Fields, *, frozen: bool) -> PeoplePlan:
    """The procedure in the table [desk] of a design; InputError for anything unusable in it.

    The files of a `frozen` design are not looked for.
    """
    plain = [*TEXTS, *FORMS, "practice_most", "interrupted", "notches", "pace", "tasks", "probes", "probe"]
    table.check_keys([*plain, *table.quantity_keys({"practice_criterion": "speed", "practice_hold": "time"})])
    files: dict[str, Any] = {key: _text_file(table, key, frozen=frozen) for key in TEXTS}
    files |= {key: _forms(table, key, frozen=frozen) for key in FORMS}
    probe = table.text("probe", "")
    probes = table.whole("probes", (0, MOST_PROBES), 1 if probe else 0)
    if (probes > 0) != bool(probe) or (probe and not _is_form(table, probe, frozen=frozen)):
        raise table.error("probe", table.data.get("probe", MISSING), f"{_form_words()}, for a number of probes")
    pace = number(table.source, f"{table.prefix}pace", table.data.get("pace", PeoplePlan.pace))
    if not 0.1 <= pace <= FASTEST_PACE:
        raise table.error("pace", pace, f"a number from 0.1 to {FASTEST_PACE:g}, times real time")
    return PeoplePlan(
        **files,
        practice_criterion_mps=table.within("practice_criterion", "speed", CRITERION_MPS, (0.0, 50.0 * KMH)),
        practice_hold_s=table.within("practice_hold", "time", PeoplePlan.practice_hold_s, (1.0, LONGEST_HOLD_S)),
        practice_most=table.whole("practice_most", (1, MOST_PRACTICE), PeoplePlan.practice_most),
        interrupted=table.choice("interrupted", Interrupted, PeoplePlan.interrupted),
        notches=table.whole("notches", (0, MOST_NOTCHES), PeoplePlan.notches),
        pace=pace,
        tasks=tuple(SideTask(one) for one in table.names("tasks", list(SideTask))),
        probes=probes,
        probe=probe,
        folder=table.source.parent,
    )


def _text_file(table: Fields, key: str, *, frozen: bool) -> str:
    name = table.text(key, "")
    if table.has(key) and not frozen and not _is_beside(table, name, ".md"):
        raise table.error(key, name, "a Markdown file (.md) beside the design file")
    return name


def _forms(table: Fields, key: str, *, frozen: bool) -> tuple[str, ...]:
    names = table.rows(key, "a list of questionnaires", MOST_FORMS) if table.data.get(key) else []
    for name in names:
        if not isinstance(name, str) or not _is_form(table, name, frozen=frozen):
            raise table.error(key, name, f"each once, {_form_words()}")
        if [form_id(one) for one in names if isinstance(one, str)].count(form_id(name)) > 1:
            raise table.error(key, name, "each once, also without folder and .toml")
    return tuple(names)


def form_id(name: str) -> str:
    """The name of a questionnaire in the ids of its steps: that of its file, without folder and suffix."""
    return Path(name).stem


def _is_form(table: Fields, name: str, *, frozen: bool) -> bool:
    return (
        frozen or name in bundled_forms() or (_is_beside(table, name, ".toml") and bool(_FORM.fullmatch(form_id(name))))
    )


def _form_words() -> str:
    return (
        f"of {', '.join(bundled_forms())}, or a TOML file beside the design file, "
        "named with at most 40 letters, digits, - and _, but not probe-…"
    )


def _is_beside(table: Fields, name: str, suffix: str) -> bool:
    """Whether a relative path names a file with a suffix in the folder of the design's file."""
    path = Path(name)
    inside = not path.is_absolute() and ".." not in path.parts
    return path.suffix == suffix and inside and (table.source.parent / path).is_file()
