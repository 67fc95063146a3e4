"""Provides the front of a section: from a table on disk, kept from before, or solved now."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from das.advice.advice import Source
from das.advice.coach.settings import CoachSettings
from das.cab import event_wording
from das.compiling import SourcesMissingError
from das.domain.errors import DasError
from das.solver import tolerances as tol
from das.solver.front import Front
from das.solver.guide.policies import GuideFront
from das.solver.section import Section
from das.solver.solve import default_ladder, solve_ahead
from das.table.format import MANIFEST, TableError
from das.table.hashes import combined, differing_parts, hashes_of, solver_code_sha256, with_code
from das.table.reading import Table, read_front, why_not

KEPT_BYTES = 60_000_000
"""Fronts are kept up to this size in all (30 km take 18 MB); the newest front is always kept."""
EVERY_MULTIPLIER = 3
"""On board only every third of the solver's multipliers is solved. That takes 0.4 of the memory and costs 0.003 to
0.03 % of the energy on average, 0.15 % at worst (buffers of 0.5 to 40 %); the solving time is nearly the same."""
SAME_ENDS_M = 1.0
"""A table counts as made for a section if their ends are this near; if it does not fit, the reason is reported."""


T = TypeVar("T")


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """A front, its source, and why tables made for the section could not be used."""

    front: Front
    source: Source
    notes: tuple[str, ...] = ()


class _Kept(Generic[T]):
    """Keeps results by key up to a size in all; the least recently used go first. Several threads may use it."""

    def __init__(self, most_bytes: int, size: Callable[[T], int]) -> None:
        self._most_bytes, self._size = most_bytes, size
        self._lock = Lock()
        self._known: OrderedDict[str, T] = OrderedDict()

    def get(self, key: str) -> T | None:
        with self._lock:
            known = self._known.get(key)
            if known is not None:
                self._known.move_to_end(key)
        return known

    def put(self, key: str, found: T) -> T:
        """Keep a result, drop the least recently used ones where the size is exceeded, and return the result."""
        with self._lock:
            self._known[key] = found
            while len(self._known) > 1 and sum(map(self._size, self._known.values())) > self._most_bytes:
                self._known.popitem(last=False)
        return found


class Fronts:
    """Finds the fronts of sections; several threads may use it."""

    def __init__(self, tables: Path | None = None, *, threads: int = 2, kept_bytes: int = KEPT_BYTES) -> None:
        """List a folder of tables; `notes` says which cannot be used. Raises DasError if there is no such folder."""
        self.notes: list[str] = []
        self._threads = threads
        self._known = _Kept(kept_bytes, _size)
        self._guide: _Kept[GuideFront] = _Kept(kept_bytes, lambda guide: guide.nbytes)
        self._folder, self._missed = tables, set[str]()
        self._tables = self._listed(tables) if tables is not None else ()

    def find(self, section: Section, s_m: float | None = None) -> Found:
        """The front of a section: kept, from a table, or solved now; raises as `solve_front` does.

        For a train at a position (m), the line behind it is not solved; the answers are the same.
        """
        hashes = hashes_of(section)
        key = combined(hashes)
        s_m = section.start_m if s_m is None else s_m
        known = self._known.get(key)
        if known is not None:
            known.front.cover(s_m)
            return known
        return self._known.put(key, self._from_tables(section, hashes, s_m))

    def find_guide(self, section: Section, settings: CoachSettings, s_m: float | None = None) -> GuideFront:
        """The policies of the coach on a section: kept, or begun now.

        For a train at a position (m), the line behind it is not solved; the answers are the same.
        """
        key = f"{combined(hashes_of(section))} {settings.guide}"
        known = self._guide.get(key)
        if known is not None:
            known.cover(section.start_m if s_m is None else s_m)
            return known
        return self._guide.put(key, GuideFront(section, settings.guide, s_m, threads=self._threads))

    def _from_tables(self, section: Section, hashes: Mapping[str, str], s_m: float) -> Found:
        notes, others = [], []
        wanted = with_code(hashes) if self._tables else hashes
        for table in self._tables:
            differing = differing_parts(table.inputs, wanted)
            if not differing:
                try:
                    return Found(front=read_front(table.folder, section), source=Source.TABLE)
                except TableError as error:
                    notes.append(event_wording.table_broken(error))
            elif table.is_meant_for(section):
                others.append((table, differing))
        if others and not notes:
            # One reason is enough: a folder may hold tables of many trains, loads and levels.
            nearest, differing = min(others, key=lambda other: len(other[1]))
            notes.append(event_wording.table_unfit(nearest.folder, why_not(section, differing)))
        elif self._tables and not notes and section.name not in self._missed:
            self._missed.add(section.name)  # once is enough, however often restrictions change
            notes.append(event_wording.no_table(self._folder, section.name))
        front = solve_ahead(section, s_m, threads=self._threads, lambda_w=onboard_ladder(section))
        return Found(front=front, source=Source.SOLVED, notes=tuple(notes))

    def _listed(self, folder: Path) -> tuple[_Listed, ...]:
        if not folder.is_dir():
            raise DasError(f"{folder}: no such folder of tables")
        try:
            solver_code_sha256()
        except SourcesMissingError as error:
            self.notes.append(event_wording.tables_not_used(folder, error))
            return ()
        listed = []
        for manifest in sorted(folder.glob(f"*/{MANIFEST}")):
            try:
                listed.append(_Listed.of(Table.open(manifest.parent)))
            except TableError as error:
                self.notes.append(event_wording.table_not_used(error))
        if not listed and not self.notes:
            self.notes.append(event_wording.no_tables(folder))
        return tuple(listed)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Listed:
    """A table of the folder, of which only the manifest was read."""

    folder: Path
    inputs: Mapping[str, str]
    facts: Mapping[str, Any]

    @classmethod
    def of(cls, table: Table) -> _Listed:
        manifest = table.manifest
        return cls(folder=table.folder, inputs=manifest["inputs_sha256"], facts=manifest["section"])

    def is_meant_for(self, section: Section) -> bool:
        ends = ((self.facts["start_m"], section.start_m), (self.facts["end_m"], section.end_m))
        return self.facts["route"] == section.route.id and all(abs(a - b) <= SAME_ENDS_M for a, b in ends)


def _size(found: Found) -> int:
    front = found.front
    times = front.time_to_go_s
    return front.value_j.nbytes + (times.nbytes if isinstance(times, np.ndarray) else times[0].nbytes)


def onboard_ladder(section: Section) -> NDArray[np.float64]:
    """The multipliers of a front that is solved on board (W)."""
    ladder, lowest = default_ladder(section), len(tol.LADDER_LOWEST_RATIOS)
    return np.unique(np.concatenate((ladder[:lowest], ladder[lowest::EVERY_MULTIPLIER], ladder[-1:])))
