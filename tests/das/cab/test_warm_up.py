"""What a node loads before it is ready: kernels that were kept, and neither the compiler's library nor scipy."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

WARMED = """
import sys
from das.cab.warm_up import warm_up
from das.command_line.compiling import loading_solver
from das.table.warm_up import warm_up as warm_up_tables
with loading_solver():
    warm_up()
    warm_up_tables()
print(*(name for name in ("numba.np.linalg", "numba.np.arraymath", "scipy.linalg") if name in sys.modules))
"""


@pytest.mark.processes
def test_kept_kernels_bring_neither_linear_algebra_nor_scipy_along() -> None:
    # The first start may have to compile the kernels, and the compiler needs it all.
    said = [
        subprocess.run(
            [sys.executable, "-c", WARMED], cwd=Path(__file__).parents[3], capture_output=True, text=True, check=True
        ).stdout
        for _ in range(2)
    ]
    assert said[1].split() == []
