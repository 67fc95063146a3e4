"""Attribution with fewer cuts of a drive, for tests of its presentation, not of its computation."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from sim.drive import attribution

CUTS = 60
"""Number of times from which the optimum is computed (the program has one a second); each costs 5 ms."""


@contextmanager
def sparse_cuts() -> Iterator[None]:
    """Search for causes at few times of a drive; their energies still add up."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(attribution, "MOST_CUTS", CUTS)
        yield
