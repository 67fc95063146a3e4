"""What a table is for: the facts that name it, and the key of everything that its references depend on."""

from __future__ import annotations

import hashlib
import json
import re
import unicodedata
from dataclasses import asdict
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from das.domain.braking import ServiceBraking
from das.domain.levels import Level
from das.domain.route import Route
from das.domain.vehicle import Vehicle
from das.solver.guide import policies
from das.solver.guide.policies import PolicySettings
from das.solver.section import Section

METHOD: Final = 1
"""The version of the planner of references. Raise it when the planner gives other references: a test tells when."""
SOLVED_BY: Final = (
    *("STEP_MPS", "LEAST_MPS", "CHANGE_TIME_S", "BRAKE_CHANGES"),
    *("LOW_RATIO", "HIGH_RATIO", "BACK_SHARE"),
)
"""The constants of `das.solver.guide.policies` that a key stands for."""
_KEPT_BITS = 20
"""Bits of a number that count (six digits): the last ones of a computed array differ between processors."""
_NAME_LENGTH = 48
"""Longest part of a table's name that comes from one input."""


def facts_of(
    route: Route,
    vehicle: Vehicle,
    level: Level,
    ends_m: tuple[float, float],
    *,
    length_m: float,
    braking: ServiceBraking | None,
) -> dict[str, Any]:
    """The facts by which people tell what a table is for."""
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
    """The name of a table's file: readable, with a few digits for what names do not tell; the mass does not count."""
    places = [facts[key] or f"{facts[metres]:.0f} m" for key, metres in (("from", "start_m"), ("to", "end_m"))]
    words = (_slug(facts["route"]), "-".join(map(_slug, places)), _slug(facts["train"]), facts["level"])
    digits = _sha256({key: value for key, value in facts.items() if key != "mass_kg"})[:8]
    return f"{'_'.join(words)}_{digits}.json"


def section_sha256(section: Section) -> str:
    """SHA-256 of everything that the solver knows of a section: line, train, losses, braking, ends and grid."""
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
