"""The files of `das-sim example`, and the driver of the bundled recording."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path


def example_files() -> dict[str, bytes]:
    """Every file of the example by its name; `tests/support/example_trip.py` makes its recorded trip and its posts."""
    folder = Path(str(files("sim.bundled") / "example_files"))
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}
