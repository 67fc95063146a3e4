"""The files that commands of das-precompute make: they are named and have a name that can be read."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.making import refused

MAKING = (
    ("route", "import", "tracks.geojson"),
    ("journey", "import", "feed.zip"),
    ("vehicle", "import", "stock.json", "--losses", "lossless"),
)
"""The commands that make a file of a route, journey or vehicle."""


@pytest.mark.parametrize("words", MAKING, ids=lambda words: "-".join(words[:2]))
def test_a_command_that_makes_a_file_needs_a_name_under_which_it_is_found_again(
    words: tuple[str, ...], tmp_path: Path
) -> None:
    assert "Missing option '--out' / '-o'" in refused(tmp_path, *words)
    for name in ("made.json", "made"):
        assert f"{name}: expected a file name that ends in .toml" in refused(tmp_path, *words, "-o", name)
    assert not list(tmp_path.iterdir())
