"""Editable copies of this project's packages, and Python run with a copy instead of the original."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from tests.support.making import REPOSITORY


def copy_of(folder: Path, *packages: str) -> Path:
    """Copy packages of this project, without compiled files; returns the folder that contains them."""
    for package in packages:
        shutil.copytree(REPOSITORY / package, folder / package, ignore=shutil.ignore_patterns("__pycache__"))
    return folder


def edit(path: Path, old: str, new: str) -> None:
    """Replace a text that occurs exactly once in a file."""
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1, f"{path} holds {old!r} {text.count(old)} times"
    path.write_text(text.replace(old, new), encoding="utf-8")


def started_copy(folder: Path, *words: str) -> subprocess.Popen[str]:
    """Start Python in a folder of copies, as `run_copy` does, with pipes to and from it."""
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen([sys.executable, "-B", *words], cwd=folder, env=_environment(folder), text=True, **pipes)


def _environment(folder: Path) -> dict[str, str]:
    """The environment of Python in a folder of copies."""
    surroundings = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    return {**surroundings, "PYTHONPATH": str(folder)}


def run_copy(
    folder: Path, *words: str, env: Mapping[str, str] | None = None, timeout_s: float = 300.0
) -> subprocess.CompletedProcess[str]:
    """Run Python in a folder of copies, which take precedence over installed packages; no `.pyc` files are written."""
    return subprocess.run(
        [sys.executable, "-B", *words],
        cwd=folder,
        env={**_environment(folder), **(env or {})},
        check=False,
        capture_output=True,
        encoding="utf-8",
        timeout=timeout_s,
    )
