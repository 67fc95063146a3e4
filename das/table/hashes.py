"""Hashes of everything that determines a solved section: a table is used only for its own section and code."""

from __future__ import annotations

import hashlib
import os
import struct
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from das.compiling import cache_root, code_sha256, sources_of, text_sha256
from das.domain.braking import ServiceBraking
from das.domain.errors import DasError
from das.domain.files.writing import write_whole
from das.domain.levels import Level
from das.domain.losses import LossMap
from das.domain.route import Route, Stretches, Zone
from das.domain.vehicle import Vehicle
from das.solver import tolerances as tol
from das.solver.section import Section, build_section
from das.solver.solution import trajectory_on
from das.solver.solve import solve_front

Floats = NDArray[np.float64]

CODE: Final = "code"
"""Name of the hash of the solver's code among the hashes of a table."""
REFINEMENT: Final = "refinement"
"""Name of the hash of the code that refined the trajectories of a table, if they were refined."""
_REFINING: Final = "das.solver.refinement"
_WORDS: Final = {CODE: "solver code", "solver": "solver settings"}
_WITHOUT_PART: Final = frozenset({"das", "das.domain.errors", "das.compiling"})
"""Modules that the solver imports although its results do not depend on them."""
_KEPT_CODES: Final = 20
_KEPT_BITS = 30
"""Bits of a number that count (about nine digits): the last ones of a computed loss map differ between processors."""
_LINE_IGNORES = frozenset({
    *("id", "name", "source", "illustrative", "length_m", "stops", "altitude_at_start_m"),
    *("restrictions", "time_zone"),  # `limits_mps` has the restrictions already
    *("data_source", "licence", "one_way", "altitudes"),
    *("geometry_position_m", "geometry_latitude_deg", "geometry_longitude_deg"),
})  # fmt: skip
_TRAIN_IGNORES = frozenset(
    {
        *("id", "name", "source", "train_length_m", "comfort_power_w", "default_level", "losses", "loads"),
        *("modes", "mode", "service_brake"),
    }
)
_SOLVER_IGNORES = frozenset({
    *("LADDER_IDLE_RATIOS", "JOURNEY_FRONTS_BYTES", "JOURNEY_TIME_TOLERANCE_S"),
    *("PASSING_SPEED_STEP_MPS", "PASSING_BAND_RATIO"),
})  # fmt: skip
"""Settings on which a section's grid, policies and trajectories do not depend; every other one counts."""
_LOSSES_IGNORE = frozenset({"name", "filled_w", "force_low_n", "force_high_n"})


@dataclass(frozen=True, kw_only=True)
class Course:
    """The part of a line that a section covers, and how it is driven.

    `length_m` is the length of the train (m), 0 for a point mass; None: that of the vehicle.
    """

    level: Level
    start_m: float
    end_m: float
    start_speed_mps: float = 0.0
    end_speed_mps: float = 0.0
    length_m: float | None = None
    decision_m: Floats | None = None
    """Positions of the decision nodes (m); None: those of the solver's settings."""
    braking: ServiceBraking | None = None
    """The braking for limits and stops; None: full brakes."""


def section_hashes(route: Route, vehicle: Vehicle, course: Course) -> dict[str, str]:
    """SHA-256 of each part of what determines a section: line, train, losses, ends, braking, solver's settings.

    Names, geometry and what lies outside the section do not count. Raises DasError where the vehicle has no such level.
    """
    length_m = vehicle.train_length_m if course.length_m is None else course.length_m
    line = {
        field.name: _part(getattr(route, field.name), course.start_m - length_m, course.end_m)
        for field in fields(route)
        if field.name not in _LINE_IGNORES
    }
    train = {field.name: getattr(vehicle, field.name) for field in fields(vehicle) if field.name not in _TRAIN_IGNORES}
    grid = {} if course.decision_m is None else {"decision_m": course.decision_m}
    settings = {name: value for name, value in vars(tol).items() if name.isupper() and name not in _SOLVER_IGNORES}
    parts = {
        "line": line,
        "train": {**train, "length_m": length_m, "brakes": vehicle.brakes_at(course.level)},
        "losses": vehicle.loss_model(course.level),
        "ends": (course.start_m, course.end_m, course.start_speed_mps, course.end_speed_mps),
        "braking": course.braking,
        "solver": {**settings, **grid},
    }
    return {name: _sha256(part) for name, part in parts.items()}


def hashes_of(section: Section) -> dict[str, str]:
    """Hashes of what determines a section (see `section_hashes`)."""
    course = Course(
        level=section.level,
        start_m=section.start_m,
        end_m=section.end_m,
        start_speed_mps=section.start_speed_mps,
        end_speed_mps=section.end_speed_mps,
        length_m=section.train_length_m,
        decision_m=section.asked_decision_m,
        braking=section.braking,
    )
    return section_hashes(section.route, section.vehicle, course)


def with_code(hashes: Mapping[str, str]) -> dict[str, str]:
    """A section's hashes together with that of the code that solves it: everything that determines a table.

    Raises SourcesMissingError as `solver_code_sha256` does.
    """
    return {**hashes, CODE: solver_code_sha256()}


def differing_parts(table: Mapping[str, str], wanted: Mapping[str, str]) -> list[str]:
    """The parts in which a table differs from what is wanted, in words: line, train, losses, ends, solver code, ….

    Both arguments are hashes by name, as `with_code` returns them.
    """
    return [_WORDS.get(name, name) for name, value in wanted.items() if table.get(name) != value]


def is_other_code(differing: Sequence[str]) -> bool:
    """Whether only the solver's code differs (see `differing_parts`)."""
    return list(differing) == [_WORDS[CODE]]


@lru_cache(maxsize=1)
def refinement_code_sha256() -> str:
    """SHA-256 of the code that refines the trajectories of a table; raises as `solver_code_sha256` does.

    Only the stored trajectories depend on it. The policies, which are all that a node uses, do not.
    """
    # Not imported but named, so that a node that only compares hashes does not load compiled code.
    sources = {name: text for name, text in sources_of([_REFINING]).items() if name not in _WITHOUT_PART}
    return _known_code_sha256(text_sha256({**sources, **sources_of([code_sha256.__module__])}), sources)


@lru_cache(maxsize=1)
def solver_code_sha256() -> str:
    """SHA-256 of the code that makes a front: of the solver and of the domain modules that it imports.

    Comments, docstrings and formatting do not count. Raises SourcesMissingError where the source files are not
    installed, because then nobody can tell whether this code made a table.
    """
    makers = {make.__module__ for make in (build_section, solve_front, trajectory_on)}
    sources = {name: text for name, text in sources_of(makers).items() if name not in _WITHOUT_PART}
    return _known_code_sha256(text_sha256({**sources, **sources_of([code_sha256.__module__])}), sources)


def _known_code_sha256(key: str, sources: Mapping[str, bytes]) -> str:
    """The hash of code: the kept one if these very bytes (`key`) were hashed before, else computed now (0.1 s)."""
    root = cache_root()
    known = root / "code" / key if root is not None else None
    if known is not None:
        with suppress(OSError, ValueError):
            found = known.read_text(encoding="ascii")
            if len(found) == len(key) and set(found) <= set("0123456789abcdef"):
                os.utime(known)
                return found
    found = code_sha256(sources)
    if known is not None:
        with suppress(OSError, DasError):
            known.parent.mkdir(exist_ok=True)
            write_whole(known, found.encode())
            _remove_oldest(known.parent)
    return found


def _remove_oldest(folder: Path) -> None:
    for path in sorted(folder.iterdir(), key=lambda path: path.stat().st_mtime_ns)[:-_KEPT_CODES]:
        path.unlink(missing_ok=True)


def combined(hashes: Mapping[str, str]) -> str:
    """One SHA-256 of several named hashes."""
    return _sha256(hashes)


def _part(thing: Any, from_m: float, to_m: float) -> Any:
    """The part of one property of the line that lies between two positions (m)."""
    if isinstance(thing, Stretches):
        first = max(int(np.searchsorted(thing.start_m, from_m, side="right")) - 1, 0)
        last = int(np.searchsorted(thing.start_m, to_m, side="left"))
        return np.maximum(thing.start_m[first:last], from_m), thing.value[first:last]
    if isinstance(thing, tuple) and all(isinstance(zone, Zone) for zone in thing):
        return [zone for zone in thing if zone.start_m < to_m and zone.start_m + zone.length_m > from_m]
    return thing


def _sha256(thing: Any) -> str:
    digest = hashlib.sha256()
    for token in _tokens(thing):
        digest.update(token)
    return digest.hexdigest()


def _tokens(thing: Any) -> Iterator[bytes]:
    """A canonical form of a value: parts with their kinds, numbers rounded, mappings and dataclasses sorted by name."""
    if isinstance(thing, np.ndarray):
        yield f"array{thing.shape}".encode()
        yield _rounded(thing).tobytes()
    elif isinstance(thing, bool | int | float | np.number) and not isinstance(thing, str):
        yield b"number" + struct.pack("<d", float(_rounded(np.array(float(thing)))))
    elif isinstance(thing, str) or thing is None:
        yield f"text{len(str(thing))}:{thing}".encode()
    elif isinstance(thing, list | tuple):
        yield f"list{len(thing)}".encode()
        for item in thing:
            yield from _tokens(item)
    elif isinstance(thing, Mapping):
        yield f"mapping{len(thing)}".encode()
        for key in sorted(thing):
            yield from _tokens(str(key))
            yield from _tokens(thing[key])
    elif is_dataclass(thing):
        ignored = _LOSSES_IGNORE if isinstance(thing, LossMap) else frozenset()
        yield from _tokens({f.name: getattr(thing, f.name) for f in fields(thing) if f.name not in ignored})
    else:
        raise TypeError(f"no canonical form of a {type(thing).__name__}")


def _rounded(values: NDArray[Any]) -> Floats:
    """Float64 (little-endian) with the mantissa rounded to `_KEPT_BITS` bits; all NaN are alike, −0 becomes 0."""
    values = np.asarray(values, dtype="<f8")
    mantissa, exponent = np.frexp(np.where(np.isfinite(values), values, 0.0))
    rounded = np.ldexp(np.round(np.ldexp(mantissa, _KEPT_BITS)), exponent - _KEPT_BITS) + 0.0
    return np.where(np.isnan(values), np.nan, np.where(np.isinf(values), values, rounded))
