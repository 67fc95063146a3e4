"""Copies of the packages that can be edited, and Python run with a copy in place of what is installed."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from tests.support.making import REPOSITORY


def copy_of(folder: Path, *packages: str) -> Path:
    """Copy packages of ours, without anything compiled; returns the folder they are in."""
    for package in packages:
        shutil.copytree(REPOSITORY / package, folder / package, ignore=shutil.ignore_patterns("__pycache__"))
    return folder


def edit(path: Path, old: str, new: str) -> None:
    """Replace a text that a file holds once."""
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1, f"{path} holds {old!r} {text.count(old)} times"
    path.write_text(text.replace(old, new), encoding="utf-8")


def run_copy(
    folder: Path, *words: str, env: Mapping[str, str] | None = None, timeout_s: float = 300.0
) -> subprocess.CompletedProcess[str]:
    """Run Python in a folder of copies, which come before what is installed; it may write no `.pyc` files."""
    surroundings = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    return subprocess.run(
        [sys.executable, "-B", *words],
        cwd=folder,
        env={**surroundings, "PYTHONPATH": str(folder), **(env or {})},
        check=False,
        capture_output=True,
        encoding="utf-8",
        timeout=timeout_s,
    )
