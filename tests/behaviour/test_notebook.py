"""The notebooks run from top to bottom, are short, and are committed with small pictures and nothing of the machine.

`uv run python -m docs.studies.notebooks` makes their outputs anew.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import nbformat
import pytest

from docs.studies.notebooks import NOTEBOOKS, executed
from tests.support.kept_figures import kept_cells, stale_cells
from tests.support.making import REPOSITORY

MOST_LINES = 45
MOST_BYTES = 300_000
PICTURES = {
    "first-steps": 2,
    "notebook-own-experiment": 1,
    "notebook-own-line": 3,
    "notebook-real-trip": 1,
    "notebook-study-statistics": 0,
}


def code(notebook: Any) -> list[Any]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


@pytest.mark.parametrize("name", PICTURES)
def test_it_is_short_and_has_its_pictures(name: str) -> None:
    notebook = nbformat.read(NOTEBOOKS[name], as_version=4)
    lines = [line for cell in code(notebook) for line in cell.source.splitlines() if line.strip()]
    assert len(lines) < MOST_LINES
    assert NOTEBOOKS[name].stat().st_size < MOST_BYTES
    shown = [output for cell in code(notebook) for output in cell.outputs]
    assert sum("image/png" in output.get("data", {}) for output in shown) == PICTURES[name]
    for output in shown:
        output.get("data", {}).pop("image/png", None)
    assert not re.search(r"/(home|root|work|tmp|Users)/|0x[0-9a-f]{6,}", json.dumps(notebook))


def test_no_notebook_is_left_out() -> None:
    assert set(NOTEBOOKS) == set(PICTURES)


@pytest.mark.nightly
@pytest.mark.parametrize("name", PICTURES)
def test_it_runs_and_puts_out_what_it_was_committed_with(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("JUPYTER_RUNTIME_DIR", str(tmp_path / "runtime"))
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    monkeypatch.setenv("PYTHONPATH", str(REPOSITORY))
    committed = json.loads(NOTEBOOKS[name].read_text(encoding="utf-8"))
    made = json.loads(nbformat.writes(executed(NOTEBOOKS[name], tmp_path)))
    assert stale_cells(kept_cells(committed), kept_cells(made)) == []
