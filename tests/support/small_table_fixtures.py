"""Fixtures of the small section with its front and its table, made once, for tests of reading and writing."""

from __future__ import annotations

from pathlib import Path

import pytest

from das.solver.front import Front
from das.solver.section import Section, build_section
from das.solver.solve import solve_front
from precompute.tables.writing import make_table
from tests.support.small_tables import SETTINGS, line, quick_references, train


@pytest.fixture(scope="session")
def section() -> Section:
    return build_section(line(), train())


@pytest.fixture(scope="session")
def front(section: Section) -> Front:
    return solve_front(section)


@pytest.fixture(scope="session")
def made(section: Section, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The table, with a few references; tests do not change it."""
    path = tmp_path_factory.mktemp("tables") / "table.json"
    with quick_references():
        path.write_bytes(make_table(section, SETTINGS))
    return path


@pytest.fixture(scope="session")
def whole(section: Section, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The table with all its references; tests do not change it."""
    path = tmp_path_factory.mktemp("tables") / "whole.json"
    path.write_bytes(make_table(section, SETTINGS))
    return path
