"""Execution of the documentation's notebooks in an empty folder, with their outputs stored.

`python -m docs.studies.notebooks` runs all of them (some minutes), or only the named ones: `python -m
docs.studies.notebooks first-steps`.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

import nbformat
from nbclient import NotebookClient

from das.domain.errors import DasError
from das.domain.files.writing import write_whole
from docs.studies.output import DOCS

NOTEBOOKS: Final = {path.stem: path for path in sorted((DOCS / "tutorials").glob("*.ipynb"))}
LONGEST_S: Final = 300
"""Longest time (s) of a cell; a longer one is aborted."""


def executed(path: Path, folder: Path) -> Any:
    """A notebook with the outputs of its cells, run in a folder; raises the exception of a cell."""
    notebook = nbformat.read(path, as_version=4)  # type: ignore[no-untyped-call]
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs = []
    resources = {"metadata": {"path": str(folder)}}
    NotebookClient(notebook, timeout=LONGEST_S, resources=resources, record_timing=False).execute()
    for cell in notebook.cells:
        if cell.cell_type == "code":  # progress messages differ from run to run
            cell.outputs = [one for one in cell.outputs if one.get("name") != "stderr"]
    notebook.metadata.language_info = {"name": "python"}  # without the Python version
    return notebook


def main(names: list[str]) -> None:
    """Run the notebooks with these names, or all notebooks, and write them with their new outputs."""
    unknown = [name for name in names if name not in NOTEBOOKS]
    if unknown:
        raise DasError(f"{unknown[0]}: expected one of {', '.join(NOTEBOOKS)}")
    os.environ["PYTHONPATH"] = os.pathsep.join([str(DOCS.parent), os.environ.get("PYTHONPATH", "")])
    for path in [NOTEBOOKS[name] for name in names] or NOTEBOOKS.values():
        with tempfile.TemporaryDirectory() as folder:
            text: str = nbformat.writes(executed(path, Path(folder)))  # type: ignore[no-untyped-call]
            write_whole(path, text.encode() + b"\n")
        print(f"written: {path}")


if __name__ == "__main__":
    main(sys.argv[1:])
