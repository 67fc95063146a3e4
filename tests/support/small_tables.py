"""A small section with its table, for tests that read, write and damage both."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from das.domain.losses import EfficiencyLoss
from das.domain.route import Route
from das.domain.vehicle import Vehicle
from das.solver.guide.policies import DEFAULT
from das.table import SEAL, seal_of
from precompute.tables import writing
from precompute.tables.writing import TableSettings
from tests.support.making import make_route, make_train

BUFFERS = (0.0, 2.0, 7.0, 20.0)
SETTINGS = TableSettings(buffers_percent=BUFFERS, refined=False, proven=0)
LENGTH_M = 5000.0
LIMITS = [(0.0, 25.0), (1500.0, 35.0), (3800.0, 20.0)]
GRADES = [(0.0, 0.0), (1000.0, 0.008), (2500.0, -0.006), (4000.0, 0.0)]


def line(length_m: float = LENGTH_M) -> Route:
    return make_route(length_m, LIMITS, GRADES)


def train() -> Vehicle:
    """100 t with a power limit, resistance and losses with an idle part; 60 m long."""
    made = make_train(
        resistance=(1500.0, 20.0, 5.0),
        power_w=1.5e6,
        loss=EfficiencyLoss(traction_ratio=0.15, brake_ratio=0.2, idle_w=30e3),
    )
    return replace(made, train_length_m=60.0)


@contextmanager
def quick_references() -> Iterator[None]:
    """Tables with a few references, as coarse as a cab's, for tests of reading, writing and storage."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(writing, "FINE", DEFAULT)
        patch.setattr(writing, "EVERY_RATIO", 0.05)
        yield


def seal_anew(path: Path, change: Callable[[dict[str, Any]], object]) -> None:
    """Change the content of a table and reseal it, as an attacker who knows the format could."""
    body = json.loads(path.read_text(encoding="utf-8"))
    change(body)
    body[SEAL] = seal_of(body)
    path.write_text(json.dumps(body), encoding="utf-8")
