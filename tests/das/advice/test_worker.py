"""The executors: they work at once or in a background thread, and the future holds the exception if the work fails."""

from __future__ import annotations

import threading

import pytest

from das.advice.worker import AT_ONCE, worker


def fail() -> int:
    raise ValueError("broken")


def test_at_once_means_before_submit_returns() -> None:
    answer = AT_ONCE.submit(threading.get_ident)
    assert answer.done()
    assert answer.result() == threading.get_ident()
    assert worker("test", background=False) is AT_ONCE
    with pytest.raises(ValueError, match="broken"):
        AT_ONCE.submit(fail).result()
    AT_ONCE.shutdown()
    assert AT_ONCE.submit(int).done()


def test_in_the_background_nobody_waits() -> None:
    one, go = worker("test", background=True), threading.Event()
    first, failed = one.submit(go.wait), one.submit(fail)
    assert not first.done()
    go.set()
    assert first.result(timeout=30)
    with pytest.raises(ValueError, match="broken"):
        failed.result(timeout=30)
    one.shutdown()
