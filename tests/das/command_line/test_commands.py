"""What the commands share: signals that wait."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from das.command_line.printing import say
from das.command_line.running import signals_held


@pytest.fixture(autouse=True)
def interrupts() -> Iterator[None]:
    """Ctrl-C interrupts, as in a process that was just started."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_a_signal_waits_for_the_end_of_the_block() -> None:
    heard_at: list[str] = []

    def interrupted() -> None:
        with signals_held([signal.SIGINT]):
            signal.raise_signal(signal.SIGINT)
            heard_at.append("the end")

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert heard_at == ["the end"]


def test_a_signal_that_another_thread_hears_waits_as_well() -> None:
    """That thread does not block it; Python would interrupt the main thread at once."""
    over = threading.Event()
    other = threading.Thread(target=over.wait)
    heard_at: list[str] = []

    def interrupted() -> None:
        with signals_held([signal.SIGINT]):
            assert other.ident is not None
            signal.pthread_kill(other.ident, signal.SIGINT)
            time.sleep(0.05)
            heard_at.append("the end")

    other.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            interrupted()
    finally:
        over.set()
        other.join()
    assert heard_at == ["the end"]


def test_what_nobody_reads_is_not_said_and_holds_nobody_up() -> None:
    """Standard error is a pipe: full, then closed at the other end."""
    pipe, log = os.pipe()
    own = os.dup(2)
    os.dup2(log, 2)
    try:
        for _ in range(100_000):
            say("x")
        os.close(pipe)
        say("x")
    finally:
        os.dup2(own, 2)
        os.close(own)
        os.close(log)


def test_without_a_signal_all_is_as_before() -> None:
    handler, mask = signal.getsignal(signal.SIGINT), signal.pthread_sigmask(signal.SIG_BLOCK, [])
    with signals_held([signal.SIGINT]):
        pass
    assert signal.getsignal(signal.SIGINT) is handler
    assert signal.pthread_sigmask(signal.SIG_BLOCK, []) == mask


def test_a_process_started_meanwhile_is_born_deaf() -> None:
    asks = "import signal; print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))"
    with signals_held([signal.SIGINT]):
        said = subprocess.run([sys.executable, "-c", asks], capture_output=True, text=True, check=True).stdout
    assert said.strip() == "True"


def test_ctrl_c_while_the_program_is_being_imported_ends_cleanly(tmp_path: Path) -> None:
    (tmp_path / "slow.py").write_text("import time\nprint('importing', flush=True)\ntime.sleep(60)\n")
    command = [sys.executable, "-c", "from das.command_line.entry import start\nstart('slow')"]
    child = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert child.stdout is not None
    assert child.stdout.readline() == "importing\n"
    child.send_signal(signal.SIGINT)
    _, said = child.communicate(timeout=20)
    assert (child.returncode, said) == (130, "stopped\n")
