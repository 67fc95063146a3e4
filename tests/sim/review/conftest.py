"""Recordings that several tests of the review look at."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.recordings import write_recording
from tests.support.sparse import sparse_cuts


@pytest.fixture(autouse=True, scope="module")
def sparse() -> Iterator[None]:
    """Pages and views say what an attribution is; how it is found is tested in `tests/sim/drive`."""
    with sparse_cuts():
        yield


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of a whole recording."""
    return write_recording(tmp_path_factory.mktemp("recordings") / "whole.mcap")


@pytest.fixture(scope="session")
def cut(whole: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of the same recording, which was cut off."""
    path = tmp_path_factory.mktemp("recordings") / "cut.mcap"
    path.write_bytes(whole.read_bytes()[:100_000])
    return path
