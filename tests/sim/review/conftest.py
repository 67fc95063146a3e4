"""Recordings that several tests of the review look at."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.recordings import write_recording


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
