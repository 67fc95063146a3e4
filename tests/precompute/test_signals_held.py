"""Signals that wait for the end of a block, in this process and in those that it starts."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator

import pytest

from precompute.workers import signals_held


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
