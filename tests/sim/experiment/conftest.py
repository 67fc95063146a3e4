"""Designs of short experiments, written and read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from sim.experiment.design import Design, read_design

HEAD = "schema_version = 1\n[experiment]\nname = 'try'\ntitle = 'T'\nseed = 7\n"


@pytest.fixture
def designed(tmp_path: Path) -> Callable[[str], Design]:
    """A function that reads a design with a name and a seed, and with these tables."""

    def read(tables: str) -> Design:
        path = tmp_path / "design.toml"
        path.write_text(HEAD + tables)
        return read_design(path)

    return read
