"""A table on disk (one JSON file): finished references of a section for the cab, and its front for people.

Every value is checked before it is used. A table can be used only for the section for which it was made.
"""

from __future__ import annotations

import hashlib
import json
import re
import unicodedata
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from das.domain.braking import ServiceBraking
from das.domain.errors import MISSING, DasError
from das.domain.files.reading import Fields, read_json
from das.domain.levels import Level
from das.domain.route import Route
from das.domain.vehicle import Vehicle
from das.solver.guide import policies
from das.solver.guide.policies import DEFAULT, PolicySettings
from das.solver.guide.references import Finished, References
from das.solver.guide.schedule import Phase, PhaseKind
from das.solver.section import Section
from das.solver.solution import Fit

SCHEMA_VERSION: Final = 4
MOST_BYTES: Final = 20_000_000
"""Size (bytes) of the largest table that is read; the table of a section of 30 km has about 0.2 MB."""
LARGEST_NUMBER: Final = 1e300
LARGEST_MPS: Final = 200.0
SEAL: Final = "sha256"
OLD: Final = "*/manifest.json"
"""Pattern of the tables of earlier releases in a folder of tables: they were folders."""
KINDS: Final[Mapping[str, PhaseKind]] = {kind.name.lower(): kind for kind in PhaseKind}
PHASE = f"[kind (one of {', '.join(KINDS)}), share of effort from 0 to 1, interval where it begins, speed in m/s]"

Test = tuple[str, Callable[[Any], bool]]


class TableError(DasError):
    """A table cannot be used; the message states why."""


def _is_number(value: Any) -> bool:
    return type(value) in (int, float) and -LARGEST_NUMBER < value < LARGEST_NUMBER


_NUMBER: Test = ("a finite number", _is_number)
_POSITIVE: Test = ("a finite number > 0", lambda x: _is_number(x) and x > 0)
_TEXT: Test = ("a string", lambda x: isinstance(x, str))
_NUMBER_OR_NULL: Test = ("a finite number or null", lambda x: x is None or _is_number(x))
_FIT: Test = ("one of " + ", ".join(Fit), lambda x: x in list(Fit))
_LIST: Test = ("a list that is not empty", lambda x: isinstance(x, list) and len(x) > 0)
_TABLE: Test = ("an object", lambda x: isinstance(x, dict))
_TOP: Mapping[str, Test] = {
    "key": _TEXT,
    **dict.fromkeys(("front", "references"), _LIST),
    **dict.fromkeys(("section", "settings"), _TABLE),
    "least_time_s": _POSITIVE,
}
_SECTION: Mapping[str, Test] = {
    **dict.fromkeys(("route", "from", "to", "train", "level"), _TEXT),
    **dict.fromkeys(("start_m", "end_m", "mass_kg", "length_m"), _NUMBER),
    "braking": ("an object or null", lambda x: x is None or isinstance(x, dict)),
}
_POINT: Mapping[str, Test] = {
    "buffer_percent": _NUMBER_OR_NULL,
    "time_s": _POSITIVE,
    "fit": _FIT,
    **dict.fromkeys(("energy_input_j", "energy_irreversible_j", "refinement_saved_j"), _NUMBER),
    **dict.fromkeys(("lambda_w", "bound_j", "gap_ratio"), _NUMBER_OR_NULL),
    "gap_reason": _TEXT,
}
_REFERENCE: Mapping[str, Test] = {
    "time_s": _POSITIVE,
    "energy_j": _NUMBER,
    "lambda_w": ("a finite number >= 0", lambda x: _is_number(x) and x >= 0),
    "phases": _LIST,
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """A table that was read: the facts of its section, the front, and the finished references.

    `front` has a row for each buffer: time, energies (J), price of time λ (W; None: the fastest run), the saving by
    refinement (J), and the proven gap.
    """

    path: Path
    facts: Mapping[str, Any]
    key: str
    settings: Mapping[str, Any]
    least_time_s: float
    front: tuple[Mapping[str, Any], ...]
    references: References

    @classmethod
    def read(cls, path: Path) -> Table:
        """Read a table; TableError names the file, the key, the value and what was expected."""
        try:
            fields = read_json(path, MOST_BYTES)
            _check_origin(fields)
            _check_values(fields, _TOP)
            _check_values(fields.table("section"), _SECTION)
            _check_values(fields.table("settings"), {"refine": _TEXT})
            front = [_entry(fields, "front", i, _POINT).data for i in range(len(fields.data["front"]))]
            references = References(_references(fields))
        except DasError as error:
            raise TableError(str(error)) from None
        return cls(
            path=path,
            facts=fields.data["section"],
            key=fields.data["key"],
            settings=fields.data["settings"],
            least_time_s=fields.data["least_time_s"],
            front=tuple(front),
            references=references,
        )

    def columns(self) -> dict[str, NDArray[np.float64]]:
        """The numbers of the front by name, with a value for each buffer; NaN where there is none."""
        names = [name for name, test in _POINT.items() if test not in (_TEXT, _FIT)]
        return {name: np.array([one[name] for one in self.front], dtype=float) for name in names}

    def references_for(self, section: Section, guide: PolicySettings) -> References:
        """The references, if the table was made for this very section; else TableError names what differs."""
        begins = max(one.phases[-1].begin for one in self.references.finished)
        if self.key == key_of(section, guide) and begins < len(section.step_m):
            return self.references
        wanted = section_facts(section)
        named = [f"{key} {self.facts[key]!r}, not {wanted[key]!r}" for key in wanted if self.facts[key] != wanted[key]]
        why = "; ".join(named) or "line, losses, brakes or settings have changed"
        raise TableError(f"{self.path}: not the table of {section.name}: {why}")


def table_content(section: Section, found: Mapping[str, Any], references: References) -> bytes:
    """The content of the file of a section's table; `found` holds its settings, the least time, and the front."""
    finished = [
        {**one._asdict(), "phases": [[phase.kind.name.lower(), *phase[1:]] for phase in one.phases]}
        for one in references.finished
    ]
    body = {
        "schema_version": SCHEMA_VERSION, "method": METHOD, "units": "SI: m, s, m/s, J, W",
        "section": section_facts(section), "key": key_of(section, DEFAULT), **found, "references": finished,
    }  # fmt: skip
    return json.dumps({**body, SEAL: seal_of(body)}, ensure_ascii=False, allow_nan=False).encode() + b"\n"


def seal_of(body: Mapping[str, Any]) -> str:
    """SHA-256 of the content of a table, except the seal itself."""
    return _sha256({key: value for key, value in body.items() if key != SEAL})


def _check_origin(fields: Fields) -> None:
    """Raise InputError for a table of another format or method, or one that was altered."""
    for key, wanted in (("schema_version", SCHEMA_VERSION), ("method", METHOD)):
        value = fields.data.get(key, MISSING)
        if type(value) is not int or value != wanted:
            raise fields.error(key, value, f"{wanted}; build the table again")
    if fields.data.get(SEAL) != seal_of(fields.data):
        raise DasError(f"{fields.source}: was altered since it was written")


def _check_values(fields: Fields, tests: Mapping[str, Test]) -> None:
    for key, (expected, is_right) in tests.items():
        value = fields.data.get(key, MISSING)
        if value is MISSING or not is_right(value):
            raise fields.error(key, value, expected)


def _entry(fields: Fields, key: str, number: int, tests: Mapping[str, Test]) -> Fields:
    """An entry of a list of tables, checked."""
    entry = Fields.of(fields.source, fields.data[key][number], f"{key}[{number}].")
    _check_values(entry, tests)
    return entry


def _references(fields: Fields) -> list[Finished]:
    found: list[Finished] = []
    for i in range(len(fields.data["references"])):
        entry = _entry(fields, "references", i, _REFERENCE)
        time_s, energy_j, lambda_w, rows = (entry.data[key] for key in Finished._fields)
        if found and time_s <= found[-1].time_s:
            raise entry.error("time_s", time_s, "a time above the one before")
        found.append(Finished(time_s, energy_j, lambda_w, _phases(entry, rows)))
    return found


def _phases(entry: Fields, rows: list[Any]) -> tuple[Phase, ...]:
    """The phases of a reference, in the order of the line; the first begins with the section."""
    phases: list[Phase] = []
    for i, row in enumerate(rows):
        least = phases[-1].begin + 1 if phases else 0
        if not _is_phase(row) or row[2] < least or (not phases and row[2] > 0):
            raise entry.error(f"phases[{i}]", row, f"{PHASE}, in the order of the line")
        phases.append(Phase(KINDS[row[0]], float(row[1]), row[2], float(row[3])))
    return tuple(phases)


def _is_phase(row: Any) -> bool:
    if not isinstance(row, list) or len(row) != 4 or not isinstance(row[0], str) or row[0] not in KINDS:
        return False
    _, share, begin, target_mps = row
    return (
        _is_number(share) and 0 <= share <= 1 and type(begin) is int
        and _is_number(target_mps) and 0 <= target_mps < LARGEST_MPS
    )  # fmt: skip


METHOD: Final = 4
"""The version of the planner of references, to be raised when its references change: a test shows when."""
SOLVED_BY: Final = ("STEP_MPS", "LEAST_MPS", "CHANGE_TIME_S", "LOW_RATIO", "HIGH_RATIO", "BACK_SHARE")
"""The constants of `das.solver.guide.policies` that are part of a key."""
_KEPT_BITS = 20
"""Significant bits of a number in a key (six digits): the last bits of computed arrays differ between processors."""
_NAME_LENGTH = 48
"""Largest number of characters in a table's name that come from one input."""


def facts_of(
    route: Route,
    vehicle: Vehicle,
    level: Level,
    ends_m: tuple[float, float],
    *,
    length_m: float,
    braking: ServiceBraking | None,
) -> dict[str, Any]:
    """The facts that show people what a table is for."""
    start_m, end_m = ends_m
    return {
        "route": route.id,
        "from": route.stop_name_at(start_m),
        "to": route.stop_name_at(end_m),
        "start_m": start_m,
        "end_m": end_m,
        "train": vehicle.id,
        "mass_kg": vehicle.mass_kg,
        "length_m": length_m,
        "level": str(level),
        "braking": None if braking is None else asdict(braking),
    }


def section_facts(section: Section) -> dict[str, Any]:
    """The facts of a section (see `facts_of`)."""
    return facts_of(
        section.route, section.vehicle, section.level, (section.start_m, section.end_m),
        length_m=section.train_length_m, braking=section.braking,
    )  # fmt: skip


def table_name(facts: dict[str, Any]) -> str:
    """The name of a table's file: readable, with a few digits of the hash of all facts but the mass."""
    places = [facts[key] or f"{facts[metres]:.0f} m" for key, metres in (("from", "start_m"), ("to", "end_m"))]
    words = (_slug(facts["route"]), "-".join(map(_slug, places)), _slug(facts["train"]), facts["level"])
    digits = _sha256({key: value for key, value in facts.items() if key != "mass_kg"})[:8]
    return f"{'_'.join(words)}_{digits}.json"


def section_sha256(section: Section) -> str:
    """SHA-256 of all that the solver uses of a section: line, train, losses, braking, ends and grid."""
    digest = hashlib.sha256()
    ends = (section.start_speed_mps, section.end_speed_mps, section.train_length_m)
    brakes = section.vehicle.friction_brake_force_n
    for numbers in (
        *(section.node_m, section.limit_mps, section.allowed_mps, section.decision, ends, brakes),
        *(*section.for_kernels, *section.bounds, *section.train, *section.loss_params),
    ):
        rounded = _rounded(numbers)
        digest.update(f"{rounded.shape}{section.braking}".encode() + rounded.tobytes())
    return digest.hexdigest()


def key_of(section: Section, guide: PolicySettings) -> str:
    """SHA-256 of everything that the references of a section depend on: the section, settings, and the method."""
    counts = asdict(guide) | {name.lower(): getattr(policies, name) for name in SOLVED_BY}
    del counts["kept_bytes"]
    return _sha256({"section": section_sha256(section), "guide": counts, "method": METHOD})


def _sha256(thing: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(thing, sort_keys=True).encode()).hexdigest()


def _rounded(numbers: ArrayLike) -> np.ndarray:
    """The numbers as float64 (little-endian), each rounded to `_KEPT_BITS` bits; −0 becomes 0."""
    mantissa, exponent = np.frexp(np.atleast_1d(np.asarray(numbers, dtype="<f8")))
    return np.asarray(np.ldexp(np.round(np.ldexp(mantissa, _KEPT_BITS)), exponent - _KEPT_BITS) + 0.0)


def _slug(text: str) -> str:
    """A text as a part of a file's name: plain letters, digits and hyphens."""
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode().lower()
    return re.sub(r"[^a-z0-9]+", "-", plain).strip("-")[:_NAME_LENGTH] or "x"
