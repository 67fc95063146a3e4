"""`python -m tests.support.desk_soak [MINUTES]`: an hour at the cab desk by keyboard, at real time, in Chromium.

Prints a line after one minute and then every ten: the heap of the page after its garbage was collected, the nodes and
listeners of its document, the memory of all processes of the desk, and the times that the page measured. The last lines
have those of the recording: from one `Cab` to the next, and from a key to the bus.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from das.bus.recording import read_recording
from das.bus.topics import ACTION, CAB
from das.domain.units import MS, NS
from tests.support.desk_page import DeskPage, chromium, desk_command

LOOKED_AT_MIN: Final = (1, *range(10, 601, 10))
MINUTES: Final = 60.0
SLOW_DAY: Final = """
schema_version = 1
[scenario]
id = "slow-day"
title = "A day with much time"
route = "zurich-luzern"
vehicle = "re460-ic"
[timetable]
buffer_percent = 75
"""
"""A drive of more than an hour."""


def main() -> None:
    """Drive, and print what was measured."""
    lasts_s = 60.0 * float(sys.argv[1]) if len(sys.argv) > 1 else 60.0 * MINUTES
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "day.toml").write_text(SLOW_DAY, encoding="utf-8")
        with desk_command(folder, "day.toml", "--advice", "coach", "--out", "d.mcap") as (child, address):
            with chromium() as browser:
                _drive(browser, address, child.pid, lasts_s)
            child.terminate()
            child.communicate(timeout=60)
        _recorded(folder / "d.mcap")


def _drive(browser: Any, address: str, pid: int, lasts_s: float) -> None:
    context = browser.new_context(viewport={"width": 1280, "height": 720})
    page = DeskPage(context, address)
    tool = context.new_cdp_session(page.page)
    tool.send("Performance.enable")
    page.begin()
    began, due_min = time.monotonic(), list(LOOKED_AT_MIN)

    def look(_: dict[str, str]) -> None:
        since_s = time.monotonic() - began
        if since_s >= 60.0 * due_min[0]:
            _print(page, tool, pid, since_s)
            del due_min[0]
        if since_s >= lasts_s:
            raise TimeoutError

    try:
        page.drive(look, 2.0 * lasts_s)
    except TimeoutError:
        print(f"{page.errors or 'no'} errors on the page after {lasts_s / 60.0:.0f} min", flush=True)


def _print(page: DeskPage, tool: Any, pid: int, since_s: float) -> None:
    tool.send("HeapProfiler.collectGarbage")
    told = {one["name"]: one["value"] for one in tool.send("Performance.getMetrics")["metrics"]}
    measured = page.page.evaluate("deskMeasured")
    print(
        f"{since_s / 60.0:4.0f} min  heap {told['JSHeapUsedSize'] / 1e6:.2f} MB  nodes {told['Nodes']:.0f}  "
        f"listeners {told['JSEventListeners']:.0f}  processes {_resident_mb(pid):.0f} MB  "
        f"Cab sent to drawn {_spread(measured['drawn'])} ms  frame to frame {_spread(measured['frames'])} ms",
        flush=True,
    )


def _spread(times_ms: Sequence[float]) -> str:
    """Median, 99 % and longest."""
    return " / ".join(f"{one:.0f}" for one in (*np.percentile(times_ms, (50, 99)), max(times_ms)))


def _resident_mb(pid: int) -> float:
    """Resident memory of a process and all its descendants (MB)."""
    listed = subprocess.run(["ps", "-eo", "pid=,ppid=,rss="], capture_output=True, text=True, check=True).stdout
    rows = [tuple(map(int, line.split())) for line in listed.splitlines()]
    family = {pid}
    while more := {own for own, parent, _ in rows if parent in family} - family:
        family |= more
    return sum(kb for own, _, kb in rows if own in family) / 1e3


def _recorded(path: Path) -> None:
    recording = read_recording(path)
    cabs_ms = np.diff([entry.message.wall_ns for entry in recording.of(CAB)]) * NS / MS
    actions = [entry.message for entry in recording.of(ACTION)]
    keys_ms = [(one.bus_ns - one.browser_ns) * NS / MS for one in actions]
    halves = np.array_split(cabs_ms, 2)
    print(f"Cab to Cab {_spread(cabs_ms)} ms (first half {_spread(halves[0])}, second {_spread(halves[1])})")
    print(f"key to bus {_spread(keys_ms)} ms, {len(keys_ms)} actions")


if __name__ == "__main__":
    main()
