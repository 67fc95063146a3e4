"""Fixtures of all tests."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings

from tests.support.flat_days import FLAT

settings.register_profile("untimed", deadline=None)  # a busy machine is not a failure
settings.load_profile("untimed")


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of third-party data beside the checkout: needed in CI, skipped with a reason elsewhere."""
    path = Path(__file__).parents[2] / "shared" / "data"
    if not path.is_dir():
        if os.environ.get("CI"):
            pytest.fail(f"{path} is missing, and CI is set")
        pytest.skip(f"{path} is not here (third-party data, not part of the project)")
    return path


@pytest.fixture(scope="module")
def flat(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Writes a scenario of the flat line, with more behind it or another head; a new file each time."""
    folder = tmp_path_factory.mktemp("scenarios")
    count = iter(range(1000))

    def write(more: str = "", base: str = FLAT) -> Path:
        path = folder / f"s{next(count)}.toml"
        path.write_text(base + more, encoding="utf-8")
        return path

    return write
