"""Provides the front of a section and the policies of the guide: kept from before, or solved now.

The finished references of a section come from a table on disk, if there is one.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from threading import Lock
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import DasError
from das.solver import tolerances as tol
from das.solver.front import Front
from das.solver.guide.policies import DEFAULT, GuideFront
from das.solver.guide.references import References
from das.solver.section import Section
from das.solver.solve import default_ladder, solve_ahead
from das.table import OLD, Table, TableError, key_of, section_facts, section_sha256, table_name

KEPT_BYTES = 60_000_000
"""Total size (bytes) up to which fronts are kept (30 km take 18 MB); the newest front is always kept."""
EVERY_MULTIPLIER = 3
"""On board only every third of the solver's multipliers is solved. That takes 0.4 of the memory and costs 0.003 to
0.03 % of the energy on average, 0.15 % at worst (buffers of 0.5 to 40 %); the solving time is nearly the same."""

T = TypeVar("T")


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


class FoundGuide(NamedTuple):
    """The policies of the guide on a section, and why a table made for the section cannot be used."""

    front: GuideFront
    notes: tuple[str, ...] = ()


class Fronts:
    """Finds the fronts of sections and the policies of the guide; several threads may use it."""

    def __init__(self, tables: Path | None = None, *, threads: int = 2, kept_bytes: int = KEPT_BYTES) -> None:
        """Look into a folder of tables; `notes` says what is wrong with it. DasError if there is no such folder."""
        self.notes: list[str] = []
        self._threads = threads
        self._known = _Kept(kept_bytes, _size)
        self._guides: _Kept[FoundGuide] = _Kept(kept_bytes, lambda guide: guide.front.nbytes)
        self._folder, self._missed = tables, set[str]()
        if tables is None:
            return
        if not tables.is_dir():
            raise DasError(f"{tables}: no such folder of tables")
        if any(tables.glob(OLD)):
            self.notes.append(f"{tables}: tables of an earlier release, no longer usable; build them again")
        elif not any(tables.glob("*.json")):
            self.notes.append(f"{tables}: no table in this folder")

    def find(self, section: Section, s_m: float | None = None) -> Front:
        """The front of a section: kept, or solved now; raises as `solve_front` does.

        For a train at a position (m), the line behind it is not solved; the answers are the same.
        """
        key = section_sha256(section)
        s_m = section.start_m if s_m is None else s_m
        known = self._known.get(key)
        if known is not None:
            known.cover(s_m)
            return known
        front = solve_ahead(section, s_m, threads=self._threads, lambda_w=onboard_ladder(section))
        return self._known.put(key, front)

    def find_guide(self, section: Section, s_m: float | None = None) -> FoundGuide:
        """The policies of the guide on a section: kept, or begun now, with the finished references of its table.

        For a train at a position (m), the line behind it is not solved; the answers are the same.
        """
        key = key_of(section, DEFAULT)
        known = self._guides.get(key)
        if known is not None:
            known.front.cover(section.start_m if s_m is None else s_m)
            return known
        references, notes = self._references(section)
        front = GuideFront(section, s_m=s_m, threads=self._threads, references=references)
        return self._guides.put(key, FoundGuide(front, notes))

    def _references(self, section: Section) -> tuple[References | None, tuple[str, ...]]:
        """The references of a section's table; without a table that fits, None and why."""
        if self._folder is None:
            return None, ()
        path = self._folder / table_name(section_facts(section))
        try:
            if path.exists():
                return Table.read(path).references_for(section, DEFAULT), ()
        except TableError as error:
            return None, (f"{error}; references are solved instead",)
        if section.name in self._missed:
            return None, ()
        self._missed.add(section.name)  # once is enough, however often restrictions change
        return None, (f"{self._folder}: no table of {section.name}; references are solved instead",)


def _size(front: Front) -> int:
    return front.value_j.nbytes + front.time_to_go_s.nbytes


def onboard_ladder(section: Section) -> NDArray[np.float64]:
    """The multipliers of a front that is solved on board (W)."""
    ladder, lowest = default_ladder(section), len(tol.LADDER_LOWEST_RATIOS)
    return np.unique(np.concatenate((ladder[:lowest], ladder[lowest::EVERY_MULTIPLIER], ladder[-1:])))
