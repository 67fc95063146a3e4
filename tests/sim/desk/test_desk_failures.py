"""What goes wrong at the cab desk, in Chromium: the train is braked, and the recording is whole."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import psutil
import pytest

from das.bus.recording import read_recording
from das.bus.topics import LOG, MARK
from tests.support.desk_page import FLAT_DAY, DeskPage, chromium, desk_command

pytestmark = pytest.mark.nightly


def renderers() -> list[psutil.Process]:
    """The processes that draw the pages of this test's browser."""
    mine = psutil.Process().children(recursive=True)
    return [one for one in mine if "--type=renderer" in " ".join(one.cmdline())]


def server_of(child: int) -> psutil.Process:
    """The desk's server, a child process of the run."""
    return next(one for one in psutil.Process(child).children() if "sim.desk" in one.cmdline())


def test_whatever_goes_wrong_the_train_is_braked_and_the_recording_is_whole(tmp_path: Path) -> None:
    """Reload, a second page, sleep, a closed page, a killed server, Ctrl-C: one after the other, at real time."""
    with desk_command(tmp_path, str(FLAT_DAY), "--pace", "real", "--out", "f.mcap") as (child, address):
        with chromium() as browser:
            context = browser.new_context(viewport={"width": 1280, "height": 720})
            page = DeskPage(context, address)
            page.begin()
            page.until(lambda state: state["may"] == "true", "the departure")
            page.set(10)
            page.until(lambda state: float(state["speed"]) > 15, "speed")
            page.page.reload()
            state = page.until(
                lambda state: state["phase"] == "driving" and state.get("lever") == "100", "the same lever"
            )
            assert state["braked"] == "false"

            second = DeskPage(context, address)
            second.phase("driving")
            page.phase("taken", 10)
            second.lever = 10
            second.set(9)
            second.until(lambda state: state.get("lever") == "90", "the second page's lever")

            # Asleep: the page's processes stand still, and its socket stays open.
            for one in renderers():
                one.suspend()
            time.sleep(4.0)
            for one in renderers():
                one.resume()
            second.until(lambda state: state.get("braked") == "true", "the dead-man brake")
            assert second.text("do") == "Braked"
            second.until(lambda state: state["braked"] == "false" and state["speed"] == "0", "the release at a stand")
            assert second.text("may") == "The train was braked"
            assert second.state["lever"] == "0"
            second.lever = 0
            second.set(5)
            second.until(lambda state: float(state["speed"]) > 10, "speed after the stand")
            assert second.text("may") != "The train was braked"

            # Covered: a page that is drawn no more still says that it is visible, and hears everything.
            second.page.evaluate("window.requestAnimationFrame = () => 0")
            second.until(lambda state: state.get("braked") == "true", "the dead-man brake of a covered page", 10)
            second.page.reload()
            second.until(lambda state: state.get("braked") == "false", "the release after it")
            second.lever = 0
            second.set(5)
            second.until(lambda state: float(state["speed"]) > 10, "speed after the second stand")

            # Closed, and back.
            page.page.close()
            second.page.close()
            time.sleep(4.0)
            third = DeskPage(context, address)
            third.until(lambda state: state.get("braked") == "true", "the dead-man brake of a closed page", 10)

            # The server is killed: the run goes on, braked, starts it again, and the page finds it.
            server_of(child.pid).kill()
            third.until(lambda state: state["link"] == "down", "the loss of the server", 10)
            third.until(lambda state: state["link"] == "up" and state["phase"] == "driving", "the new server")
            third.until(lambda state: state["braked"] == "false", "the release", 60)
            third.lever = 0
            third.set(3)
            third.until(lambda state: float(state["speed"]) > 5, "speed under the new server")
            child.send_signal(signal.SIGINT)
            third.phase("broken", 20)
            assert third.errors == second.errors == page.errors == []
        _, said = child.communicate(timeout=60)
    assert "recorded so far: f.mcap" in said
    assert "Traceback" not in said
    recording = read_recording(tmp_path / "f.mcap")
    assert recording.complete
    words = [entry.message.message for entry in recording.of(LOG)]
    assert sum("dead-man brake is applied" in text for text in words) >= 3  # asleep, covered, closed
    assert {entry.message.kind for entry in recording.of(MARK)} >= {2, 3, 4, 5}
