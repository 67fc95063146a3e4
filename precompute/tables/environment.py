"""Whether another machine solves as this one does: versions of packages, and a hash of our own source."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from pathlib import Path

import das

PACKAGES = ("numpy", "numba", "llvmlite", "distributed", "dask")
OURS = ("das", "precompute")


def environment() -> dict[str, str]:
    """Versions of Python, of the packages that count and of ourselves, and the hash of our source tree."""
    return {
        "python": platform.python_version(),
        **{name: _version(name) for name in PACKAGES},
        "driver-advisory-system": das.__version__,
        "source": source_sha256(),
    }


def differences(here: Mapping[str, str], there: Mapping[str, str]) -> str:
    """How another environment differs from this one, in words; empty where it does not."""
    return "; ".join(
        f"{name} {there.get(name, 'missing')}, here {value}" for name, value in here.items() if there.get(name) != value
    )


def source_sha256() -> str:
    """SHA-256 over the names and contents of all Python files of ours that solve (12 digits are enough to tell)."""
    digest = hashlib.sha256()
    for package in OURS:
        root = Path(str(files(package)))
        for path in sorted(root.rglob("*.py")):
            content = path.read_bytes()
            digest.update(f"{package}/{path.relative_to(root).as_posix()} {len(content)}\n".encode())
            digest.update(content)
    return digest.hexdigest()[:12]


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "missing"
