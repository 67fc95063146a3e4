"""Vehicle files with effort curves, and trains to import, with mutations: refused in one line, or used."""

from __future__ import annotations

import json
import random
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from das.domain.errors import DasError
from das.domain.files.load import load_vehicle
from precompute.vehicle_import import import_train
from tests.das.domain.files.test_efforts import EFFORT, HEAD, MODES
from tests.precompute.test_vehicle_import import BR642, CSV, FIGURES, stock
from tests.property.test_mutated_files import bounded, mutated_text


class Kind(NamedTuple):
    """A kind of file: its name, an example, and what is done with a mutated one."""

    file: str
    example: str
    use: Callable[[Path], object]


KINDS = {
    "vehicle with modes": Kind("train.toml", HEAD.format(more="") + MODES, load_vehicle),
    "effort curve": Kind("effort.csv", EFFORT, lambda path: load_vehicle(path.with_name("with-curve.toml"))),
    "stock of OSRD": Kind("stock.json", json.dumps(stock(), indent=1), lambda path: import_train(path, "0.85")),
    "stock of railtoolkit": Kind("stock.yaml", BR642.read_text("utf-8"), lambda path: import_train(path, "0.85")),
    "table of efforts": Kind("table.csv", CSV, lambda path: import_train(path, "0.85", FIGURES)),
}


@pytest.mark.parametrize(("name", "count"), [(name, 50) for name in KINDS] + [
    pytest.param(name, 10_000, marks=pytest.mark.nightly) for name in KINDS
])  # fmt: skip
def test_mutated_trains_are_refused_in_one_line_or_used(name: str, count: int, tmp_path: Path) -> None:
    """No other error, no warning of a computation, and nothing that takes 10 s."""
    kind, counts, wrong = KINDS[name], Counter[str](), []
    (tmp_path / "effort.csv").write_text(EFFORT)
    (tmp_path / "with-curve.toml").write_text(HEAD.format(more="") + '[traction]\ncurve = "effort.csv"\n')
    path = tmp_path / kind.file
    for number in range(count):
        path.write_bytes(mutated_text(kind.example.encode(), random.Random(number)))
        try:
            with bounded(), warnings.catch_warnings():
                warnings.simplefilter("error")
                kind.use(path)
            counts["used"] += 1
        except DasError as error:
            counts["refused"] += 1
            if not str(error) or "\n" in str(error) or "\x1b" in str(error):
                wrong.append(f"{number}: {str(error)[:200]!r}")
        except Exception as error:  # Whatever is not for the user.
            wrong.append(f"{number}: {type(error).__name__}: {error}"[:300])
    assert not wrong, "\n".join(wrong[:20])
    assert counts["used"]
    assert counts["refused"]
