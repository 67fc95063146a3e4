"""Runs notebooks of the documentation in an empty folder, and keeps what they put out.

`python -m docs.studies.notebooks` runs all of them (some minutes), with names only those:
`python -m docs.studies.notebooks first-steps`.
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
"""A cell that takes longer is given up."""


def executed(path: Path, folder: Path) -> Any:
    """A notebook with what its cells put out when they are run in a folder; the exception of a cell is raised."""
    notebook = nbformat.read(path, as_version=4)  # type: ignore[no-untyped-call]
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs = []
    resources = {"metadata": {"path": str(folder)}}
    NotebookClient(notebook, timeout=LONGEST_S, resources=resources, record_timing=False).execute()
    for cell in notebook.cells:
        if cell.cell_type == "code":  # what is told of the progress differs from run to run
            cell.outputs = [one for one in cell.outputs if one.get("name") != "stderr"]
    notebook.metadata.language_info = {"name": "python"}  # without the version of this Python
    return notebook


def main(names: list[str]) -> None:
    """Run the notebooks with these names, or all, and write them with their new outputs."""
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
