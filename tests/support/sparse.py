"""Attribution with fewer moments of a drive: for tests of what is said of it, not of how it is found."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from sim.drive.attribution import committed

CUTS = 60
"""Moments from which the optimum is sought, where the program has one a second; each costs 5 ms."""


@contextmanager
def sparse_cuts() -> Iterator[None]:
    """Look for causes at few moments of a drive; their energies sum as ever."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(committed, "MOST_CUTS", CUTS)
        yield
