"""How processes start and end: imports that Ctrl-C ends, signals, bytecode that is kept."""

from __future__ import annotations

import py_compile
import signal
import subprocess
import sys
import textwrap
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from das.command_line.process import STOP_SIGNALS, interrupted_by_termination
from tests.support.copies import copy_of, run_copy
from tests.support.making import wait_until


@pytest.fixture(autouse=True)
def interrupts() -> Iterator[None]:
    """Ctrl-C interrupts, as in a process that was just started."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def handlers() -> list[object]:
    return [signal.getsignal(number) for number in STOP_SIGNALS]


@pytest.mark.parametrize("number", STOP_SIGNALS)
def test_termination_interrupts_a_block_and_leaves_no_handler(number: signal.Signals) -> None:
    before = handlers()
    with pytest.raises(KeyboardInterrupt), interrupted_by_termination():
        signal.raise_signal(number)
    assert handlers() == before


def test_in_another_thread_termination_is_handled_as_before() -> None:
    before, seen = handlers(), []

    def block() -> None:
        with interrupted_by_termination():
            seen.append(handlers())

    other = threading.Thread(target=block)
    other.start()
    other.join()
    assert seen == [before]


def test_ctrl_c_while_the_program_is_being_imported_ends_cleanly(tmp_path: Path) -> None:
    (tmp_path / "slow.py").write_text("import time\nprint('importing', flush=True)\ntime.sleep(60)\n")
    command = [sys.executable, "-c", "from das.command_line.process import start\nstart('slow')"]
    child = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert child.stdout is not None
    assert child.stdout.readline() == "importing\n"
    child.send_signal(signal.SIGINT)
    _, said = child.communicate(timeout=20)
    assert (child.returncode, said) == (130, "stopped\n")


STARTED = """
import sys
from das.command_line.process import keep_bytecode
keep_bytecode()
import das.domain.units
print(sys.dont_write_bytecode)
"""
PLACE = Path("das/__pycache__/das-bytecode")


def copy_without_bytecode(folder: Path) -> Path:
    """The folder, with a copy of das and a numba without bytecode: the tests' own numba may have some or none."""
    (copy_of(folder, "das") / "numba.py").write_text("")
    return folder


def started(folder: Path, **env: str) -> tuple[str, list[Path]]:
    """Whether a program that was told to write no bytecode heeds it, and the bytecode that is then in the folder."""
    surroundings = {"PYTHONPYCACHEPREFIX": "", **env}
    done = run_copy(folder, "-c", STARTED, env=surroundings)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip(), [path.relative_to(folder) for path in folder.rglob("units.*.pyc")]


@pytest.mark.nightly
def test_bytecode_is_kept_apart_where_none_may_be_written_beside_the_sources(tmp_path: Path) -> None:
    heeds, (kept,) = started(copy_without_bytecode(tmp_path))
    assert heeds == "False"
    assert kept.is_relative_to(PLACE)


@pytest.mark.nightly
def test_python_does_as_told_where_the_user_says_where_bytecode_belongs(tmp_path: Path) -> None:
    assert started(copy_without_bytecode(tmp_path), PYTHONPYCACHEPREFIX=str(tmp_path / "mine")) == ("True", [])


@pytest.mark.nightly
def test_python_does_as_told_where_bytecode_was_installed_or_cannot_be_kept(tmp_path: Path) -> None:
    copy_without_bytecode(tmp_path)
    (tmp_path / "das/__pycache__").write_text("a file: no folder can be made here, whoever we are")
    assert started(tmp_path) == ("True", [])
    (tmp_path / "das/__pycache__").unlink()
    # Beside the source, wherever the tests themselves keep their bytecode.
    kept = tmp_path / "__pycache__" / f"numba.{sys.implementation.cache_tag}.pyc"
    py_compile.compile(str(tmp_path / "numba.py"), cfile=str(kept))
    assert started(tmp_path) == ("True", [])


BESIDE = "from pathlib import Path\nimport time\ndef main():\n    Path('begun').touch()\n    time.sleep(60)\n"


def test_a_process_beside_runs_a_main_and_ends_with_the_one_that_started_it(tmp_path: Path) -> None:
    copy_of(tmp_path, "das")
    (tmp_path / "late.py").write_text(BESIDE)
    program = """
        import time
        from pathlib import Path
        from das.command_line import process
        process.available_cores = lambda: CORES
        children = []
        made = process.subprocess.Popen
        process.subprocess.Popen = lambda *words, **how: children.append(made(*words, **how)) or children[0]
        process.start_beside("late")
        until_s = time.monotonic() + 30
        while children and not Path("begun").exists() and time.monotonic() < until_s:
            time.sleep(0.02)
        print(len(children), *(one.pid for one in children))
    """
    for cores, count in ((1, 0), (2, 1)):
        text = textwrap.dedent(program).replace("CORES", str(cores))
        done = run_copy(tmp_path, "-c", text)
        assert (done.returncode, done.stderr) == (0, "")
        started, *pids = map(int, done.stdout.split())
        assert started == count
        assert wait_until(lambda ended=[Path(f"/proc/{pid}") for pid in pids]: not any(map(Path.exists, ended)), 20.0)
    assert (tmp_path / "begun").exists()
