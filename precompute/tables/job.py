"""One section to be solved into a table: what a worker needs, and the work itself."""

from __future__ import annotations

import copyreg
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Any

from das.domain.route import Route
from das.domain.vehicle import Vehicle
from das.solver.section import SectionOptions, build_section
from das.solver.warm_up import warm_up as compile_solver
from das.table.hashes import Course, section_hashes
from precompute.tables.writing import TableSettings, make_table, table_hashes, table_key

HASH_DIGITS = 8
"""Digits of the hash in a table's name."""


def _read_only(mapping: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(mapping)


# Vehicles hold their losses in read-only mappings, which pickle does not know.
copyreg.pickle(MappingProxyType, lambda mapping: (_read_only, (dict(mapping),)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Job:
    """A section of a line for a train, with the hash of everything that determines its table."""

    label: str
    key: str
    route: Route
    vehicle: Vehicle
    course: Course
    settings: TableSettings

    @classmethod
    def of(cls, label: str, route: Route, vehicle: Vehicle, course: Course, settings: TableSettings) -> Job:
        """A job with its hash; raises DasError where the vehicle has no such level or our source is not installed."""
        hashes = table_hashes(section_hashes(route, vehicle, course), settings)
        return cls(
            label=label,
            key=table_key(hashes, settings),
            route=route,
            vehicle=vehicle,
            course=course,
            settings=settings,
        )

    @property
    def name(self) -> str:
        """Name of the table's folder: readable, and with the beginning of the hash."""
        return f"{self.label}_{self.key[:HASH_DIGITS]}"

    def solve(self) -> dict[str, bytes]:
        """The files of the table; raises DasError with the reason where the section cannot be solved."""
        warm_up()
        course = self.course
        section = build_section(
            self.route,
            self.vehicle,
            level=course.level,
            start_m=course.start_m,
            end_m=course.end_m,
            options=SectionOptions(braking=course.braking),
        )
        return make_table(section, self.settings, threads=1)


@cache
def warm_up() -> None:
    """Compile the solver, once in a process."""
    compile_solver()
