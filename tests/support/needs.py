"""Optional requirements of tests: if one is missing, a test fails with CI set and is skipped elsewhere."""

from __future__ import annotations

import os
import shutil
from typing import NoReturn

import pytest


def missing(why: str, *, module: bool = False) -> NoReturn:
    """End the test, or its whole file with `module`: it fails with CI set, and is skipped with the reason elsewhere."""
    if os.environ.get("CI"):
        pytest.fail(f"{why}, and CI is set", pytrace=False)
    pytest.skip(why, allow_module_level=module)


def need_r() -> None:
    """End the test without R."""
    if shutil.which("Rscript") is None:
        missing("R is missing: apt-get install r-base-core r-recommended")
