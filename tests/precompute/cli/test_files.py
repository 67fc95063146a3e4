"""The files that commands of das-precompute make: they are named, have a name that can be read, and replace nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.making import printed, refused

MAKING = (
    ("route", "import", "tracks.geojson"),
    ("route", "merge", "flat-6km", "--limits", "flat-6km"),
    ("route", "new", "A=0", "B=6", "--limit", "80"),
    ("journey", "import", "feed.zip"),
    ("journey", "new"),
    ("vehicle", "import", "stock.json", "--losses", "lossless"),
    ("vehicle", "new"),
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


@pytest.mark.parametrize("words", [("journey", "new"), ("vehicle", "new")], ids=lambda words: words[0])
def test_a_file_that_is_there_is_replaced_only_if_that_is_asked_for(words: tuple[str, ...], tmp_path: Path) -> None:
    (tmp_path / "MADE.TOML").write_text("mine")
    assert "exists already; --overwrite replaces it" in refused(tmp_path, *words, "-o", "MADE.TOML")
    printed(tmp_path, *words, "-o", "MADE.TOML", "--overwrite")
    assert "schema_version" in (tmp_path / "MADE.TOML").read_text()
