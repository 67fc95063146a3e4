"""The notebook of first steps runs from top to bottom, is short, and is committed with small pictures and nothing of
the machine it ran on.

`uv run jupyter execute --inplace docs/tutorials/first-steps.ipynb` makes its outputs anew.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

from tests.support.making import REPOSITORY

NOTEBOOK = REPOSITORY / "docs" / "tutorials" / "first-steps.ipynb"
MOST_LINES = 20
MOST_BYTES = 200_000


def read() -> Any:
    return nbformat.read(NOTEBOOK, as_version=4)


def code(notebook: Any) -> list[Any]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def kinds(notebook: Any) -> list[list[str]]:
    """What each cell of code puts out: the types of its data, "text" for what it prints."""
    return [
        sorted({kind for output in cell.outputs for kind in output.get("data", ["text"])}) for cell in code(notebook)
    ]


def test_it_is_short_and_has_its_pictures() -> None:
    notebook = read()
    lines = [line for cell in code(notebook) for line in cell.source.splitlines() if line.strip()]
    assert len(lines) < MOST_LINES
    assert NOTEBOOK.stat().st_size < MOST_BYTES
    pictures = [kind for cell in kinds(notebook) for kind in cell if kind == "image/png"]
    assert len(pictures) == 2
    for cell in code(notebook):
        for output in cell.outputs:
            output.get("data", {}).pop("image/png", None)
    texts = json.dumps(notebook)
    assert not re.search(r"/(home|root|work|tmp|Users)/|0x[0-9a-f]{6,}", texts)


@pytest.mark.more
@pytest.mark.slow
@pytest.mark.processes
def test_it_runs_and_puts_out_what_it_was_committed_with(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("JUPYTER_RUNTIME_DIR", str(tmp_path / "runtime"))
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    monkeypatch.setenv("PYTHONPATH", str(REPOSITORY))
    committed, notebook = read(), read()
    for cell in code(notebook):
        cell.outputs = []
    # An exception in a cell is raised here.
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    assert kinds(notebook) == kinds(committed)
    assert all(kinds(notebook)[1:])
