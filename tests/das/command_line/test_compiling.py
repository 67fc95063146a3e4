"""Loading the solver: compiling is said only when something is compiled, and a signal ends it in one line."""

from __future__ import annotations

import os
import pty
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from das.command_line.loading import COMPILING, LOADING

PROGRAM = """
import sys
from das.command_line.loading import loading_solver
with loading_solver():
    import numpy as np
    from kernel import twice
    twice(np.ones(3))
print("scipy.linalg" in sys.modules)
"""
KERNEL = "from numba import njit\n@njit(cache=True)\ndef twice(x):\n    return 2.0 * x.sum()\n"
ROOT = Path(__file__).parents[3]


def on_a_terminal(command: list[str], folder: Path) -> tuple[int, str]:
    """Run a command whose standard error is a terminal; exit code and what it showed there."""
    ours, theirs = pty.openpty()
    environment = {
        **os.environ,
        "NUMBA_CACHE_DIR": str(folder / "cache"),
        "PYTHONPATH": f"{ROOT}:{folder}",
        "TERM": "xterm",
    }
    child = subprocess.Popen(command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=theirs)
    os.close(theirs)
    shown = b""
    while True:
        try:
            ready = select.select([ours], [], [], 60)[0]
            part = os.read(ours, 4096) if ready else b""
        except OSError:  # Linux: the other end is closed
            part = b""
        if not part:
            break
        shown += part
    os.close(ours)
    return child.wait(timeout=60), shown.decode(errors="replace")


@pytest.mark.processes
def test_compiling_is_said_only_when_something_is_compiled(tmp_path: Path) -> None:
    (tmp_path / "kernel.py").write_text(KERNEL)
    command = [sys.executable, "-c", PROGRAM]
    code, first = on_a_terminal(command, tmp_path)
    assert code == 0
    assert LOADING in first
    assert COMPILING[:40] in first
    code, again = on_a_terminal(command, tmp_path)
    assert code == 0
    assert LOADING in again
    assert "compiling" not in again


@pytest.mark.more
@pytest.mark.processes
def test_elsewhere_nothing_is_printed_and_scipy_is_not_loaded(tmp_path: Path) -> None:
    (tmp_path / "kernel.py").write_text(KERNEL)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": f"{ROOT}:{tmp_path}"}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, timeout=120, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "False\n", "")


SOLVE = ("solve", "flat-6km", "re460-ic", "--buffer", "7")


@pytest.mark.more
@pytest.mark.processes
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("after_s", [0.3, 1.5, 4.0, 8.0])
def test_a_signal_during_the_first_compilation_ends_in_one_line(tmp_path: Path, after_s: float, number: int) -> None:
    """With an empty cache, from the imports to the depths of the compiler."""
    begin = "from precompute.cli.__main__ import main\nfrom das.command_line.running import interrupt_on_termination\n"
    begin += "interrupt_on_termination()\nprint('started', flush=True)\nmain()"
    child = subprocess.Popen(
        [sys.executable, "-c", begin, *SOLVE],
        cwd=tmp_path,
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert child.stdout is not None
    assert child.stdout.readline() == "started\n"
    time.sleep(after_s)
    child.send_signal(number)
    said, errors = child.communicate(timeout=60)
    assert (child.returncode, said, errors) == (130, "", "stopped\n")
