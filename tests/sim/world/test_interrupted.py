"""A run that is asked to end, by Ctrl-C or by the system, ends cleanly, and what it recorded is whole."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from das.bus.recording import read_recording
from das.bus.topics import ADVICE
from sim.cli import run
from tests.support.crossing import few
from tests.support.making import das_sim


@pytest.mark.parametrize("number", few([signal.SIGINT, signal.SIGTERM], (signal.SIGINT,), pytest.mark.slow))
def test_a_run_that_is_asked_to_end_leaves_a_whole_recording(
    flat: Callable[..., Path], number: signal.Signals, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At the 20th second of the day, with a node and a recorder as processes."""
    ticks: list[float] = []
    tick = run._Pace.tick

    def asked_to_end(pace: run._Pace, done_m: float, all_m: float) -> None:
        tick(pace, done_m, all_m)
        ticks.append(done_m)
        if len(ticks) == 20:
            signal.raise_signal(number)

    monkeypatch.setattr(run._Pace, "tick", asked_to_end)
    scenario = flat("")
    with pytest.raises(KeyboardInterrupt):  # the exit code 130
        das_sim("run", scenario.name, "--driver", "perfect", "--out", f"cut-{number}.mcap", cwd=scenario.parent)
    assert len(ticks) == 20
    found = read_recording(scenario.parent / f"cut-{number}.mcap")
    assert found.complete
    assert 15 <= len(found.of(ADVICE)) <= 21
