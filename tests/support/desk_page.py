"""The cab desk in Chromium: a page operated by keyboard, using only what it shows, and the command `das-sim desk`."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import pytest

from das.domain.errors import DasError
from precompute.pdf import browser
from tests.support.making import REPOSITORY, started
from tests.support.needs import missing

FLAT_DAY: Final = REPOSITORY / "sim" / "experiment" / "studies" / "days" / "flat-6km.toml"
STRONGEST_MPS2: Final = 1.62
"""Deceleration (m/s²) of the train of `FLAT_DAY` at full brake, which a person learns within a minute."""
STATE: Final = "({...document.body.dataset})"
CONTRASTS: Final = """(all) => {
  const curve = (x) => (x <= 0.03928 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4);
  const light = (text) => {
    const [r, g, b] = text.match(/[\\d.]+/g).map((x) => curve(Number(x) / 255));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const under = (one) => {
    const color = getComputedStyle(one ?? document.documentElement).backgroundColor;
    return one && /, 0\\)$|transparent/.test(color) ? under(one.parentElement) : color;
  };
  const ratio = (one) => {
    const [a, b] = [light(getComputedStyle(one).color), light(under(one))];
    return (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
  };
  const own = (one) => [...one.childNodes].some((part) => part.nodeType === 3 && part.data.trim());
  const seen = (one) => one.offsetParent && own(one) && !one.disabled && !one.closest("[inert]");
  return Object.fromEntries([...document.querySelectorAll(all)].filter(seen)
    .map((one) => [`${one.id || one.tagName} ${one.textContent}`, ratio(one)]));
}"""
"""The contrast of every text of the elements of a selector with what is behind it, by WCAG 2."""


@contextmanager
def chromium(**options: Any) -> Iterator[Any]:
    """A browser; without playwright or Chromium the test ends as described for `missing`."""
    api = pytest.importorskip("playwright.sync_api", reason="needs playwright: pip install playwright")
    try:
        program = browser()
    except DasError as error:
        missing(f"Chromium is missing: apt-get install chromium ({error})")
    with api.sync_playwright() as tool:
        opened = tool.chromium.launch(executable_path=program, args=["--no-sandbox"], **options)
        try:
            yield opened
        finally:
            opened.close()


class DeskPage:
    """A page at the desk: its reported state, and the keys that a person presses. `errors` must stay empty."""

    def __init__(self, context: Any, address: str) -> None:
        self.page = context.new_page()
        self.errors: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("dialog", lambda dialog: self.errors.append(dialog.message))
        self.page.goto(address)
        self.lever = 0

    @property
    def state(self) -> dict[str, str]:
        """The state reported by the page: look, speed, limit, advice, mode, way, lever, …"""
        found: dict[str, str] = self.page.evaluate(STATE)
        return found

    def text(self, node: str) -> str:
        """The text of an element by its id."""
        return str(self.page.evaluate(f"document.getElementById('{node}').textContent"))

    def until(self, done: Callable[[dict[str, str]], bool], what: str, for_s: float = 60.0) -> dict[str, str]:
        """Wait until the page's state meets a condition."""
        end = time.monotonic() + for_s
        while time.monotonic() < end:
            state = self.state
            if done(state):
                return state
            self.page.wait_for_timeout(40)
        raise AssertionError(f"waited {for_s:.0f} s for {what}: {self.state}")

    def phase(self, name: str, for_s: float = 120.0) -> dict[str, str]:
        """Wait for a phase."""
        return self.until(lambda state: state["phase"] == name, f"the phase {name}", for_s)

    def begin(self) -> None:
        """Press the key for ready, and wait until the run has begun."""
        self.phase("welcome")
        self.page.keyboard.press("Enter")
        self.phase("driving")
        self.until(lambda state: "speed" in state, "the first cab")

    def set(self, notch: int) -> None:
        """Press keys until the lever is at a notch (−10 … 10)."""
        while self.lever != max(min(notch, 10), -10):
            way = 1 if notch > self.lever else -1
            self.page.keyboard.press("ArrowUp" if way > 0 else "ArrowDown")
            self.lever += way

    def drive(self, look: Callable[[dict[str, str]], None], for_s: float = 600.0) -> None:
        """Drive to the end of the run with only the information on the page; `look` is called with every state."""
        end, last = time.monotonic() + for_s, ""
        while time.monotonic() < end:
            state = self.state
            if state["phase"] != "driving":
                return
            if state["look"] != last:
                last = state["look"]
                look(state)
                self.set(_wanted(state, self.lever))
            self.page.wait_for_timeout(30)
        raise AssertionError(f"did not arrive in {for_s:.0f} s: {self.state}")


def picture(page: DeskPage, name: str) -> None:
    """Write the picture of a page if requested."""
    if folder := os.environ.get("DAS_DESK_PICTURES"):
        page.page.wait_for_timeout(350)
        page.page.screenshot(path=Path(folder) / f"{name}.png")


def _wanted(state: dict[str, str], lever: int) -> int:
    """The setting of the lever by a person: by the advice, by the limit, and by eye for the last metres."""
    speed, limit, way, due = (float(state[name]) for name in ("speed", "limit", "way", "due"))
    mode = state["mode"]
    advised = float(state["advice"]) if state["advice"] else None
    effort = round(float(state["effort"]) * 10) if state["effort"] else None
    if state["may"] != "true" or mode == "braked":
        return 0
    if speed == 0:
        return (10 if way > 3000 else 2) if way > 10 else 0
    if way <= 0.5:
        return -10
    want = lever
    if mode == "traction" and due < 0.6:
        want = 10 if effort is None else max(effort, 1)
    elif mode == "brake" and due < 0.6:
        want = -3 if effort is None else effort
    elif mode == "coast" and due < 0.6:
        want = 0
    elif mode == "hold" and advised is not None:
        want = round(min(max((advised - speed) * 0.8, -5), 8))
    elif mode == "none":
        want = 5 if speed < min(limit, 100) - 5 and way > 1500 else 0
    if way < 700 and (advised is None or advised < 1):
        need = (speed / 3.6) ** 2 / (2 * max(way - 4, 1)) / STRONGEST_MPS2 * 10
        stopped_short = mode == "none" and need < 0.8  # by the dead-man brake
        want = 5 if stopped_short else -round(need) if need > 3 else min(lever, 0)
    return min(want, -2) if speed > limit - 1 else want


@contextmanager
def desk_command(
    folder: Path, *arguments: str, command: tuple[str, ...] = ("desk",)
) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """`das-sim desk`, or another command with a page, started as by a user, and the address that it prints."""
    child = started("-m", "sim.cli", *command, *arguments, "--no-open", cwd=folder, stdout=subprocess.PIPE)
    try:
        assert child.stdout is not None
        address = child.stdout.readline().strip()
        assert address.startswith("http://127.0.0.1:"), child.communicate()[1]
        yield child, address
    finally:
        if child.poll() is None:
            child.terminate()
        child.communicate(timeout=60)
