"""A recorded drive on the page of the desk: every cab as it was recorded, with the bookmarks of the review."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache

import pytest

pytest.importorskip("starlette", reason="the extra desk is not installed")

from das.bus.recording import Recording
from das.domain.errors import DasError
from sim.desk.host import listening
from sim.desk.messages import SETTINGS_KEY, PageSettings, encoded, recorded_settings
from sim.desk.replay import Replay
from sim.desk.server import server_of
from sim.drive.drive import Drive
from sim.drive.events import bookmarks
from sim.drivers.kinds import DriverKind
from tests.support.desk_page import DeskPage, chromium, picture
from tests.support.desk_server import TOKEN, Visitor, serving
from tests.support.flat_days import flat_day, signal_at
from tests.support.hand_recorded import in_memory, truth
from tests.support.making import refusal
from tests.support.recorded_days import inputs_of_day, recorded_day


@cache
def drive() -> Drive:
    """A drive with a signal at danger on the way, and no late driver."""
    day = flat_day(signal_at(3000.0, 900.0))
    return Drive(recording=recorded_day(day, day.driver(DriverKind.HUMAN)), given=inputs_of_day(day))


@contextmanager
def played(**options: str) -> Iterator[Visitor]:
    """The page of the drive at a server in this process."""
    with listening(0) as door:
        server = server_of(Replay(drive(), "en", **options).routes(), door.getsockname()[1], TOKEN)
        with serving(server, lambda: server.run(sockets=[door])):
            yield Visitor(door.getsockname()[1])


def test_every_cab_is_played_as_it_was_recorded_with_the_bookmarks_of_the_review() -> None:
    with played(at="1:00") as visitor:
        assert visitor.ask("/drive.json").status == 403
        told = json.loads(visitor.ask("/drive.json", Cookie=visitor.cookie).read())
    recorded = [entry.message for entry in drive().recording.of("cab")]
    assert [item["cab"]["s_m"] for item in told["cabs"]] == [cab.s_m for cab in recorded]
    marks = bookmarks(drive().events)
    assert [item["text"] for item in told["bookmarks"]] == [one.text for one in marks]
    assert "signal at danger" in {item["mark"] for item in told["bookmarks"]}
    first_ns = recorded[0].time_ns
    assert [item["at_s"] for item in told["bookmarks"]] == pytest.approx([(x.time_ns - first_ns) * 1e-9 for x in marks])
    assert told["start_s"] == pytest.approx(60.0 + 10.0, abs=1.0)  # the first cab is 10 s before the departure


def test_a_recording_without_a_cab_is_refused() -> None:
    with pytest.raises(DasError, match="contains no cab"):
        Replay(Drive(recording=in_memory(truth(0.0, 0.0, 0.0))), "en")


def said(text: str) -> Recording:
    """The recording of the drive, with this text as the settings of a desk's page."""
    return replace(drive().recording, metadata={"run": {SETTINGS_KEY: text}})


def test_the_page_is_set_as_its_driver_had_it() -> None:
    at_desk = said(encoded(PageSettings(notches=5, punctuality=False)))
    hello = Replay(Drive(recording=at_desk, given=drive().given), "en").hello
    assert (hello["notches"], hello["punctuality"]) == (5, False)
    simulated = Replay(drive(), "en").hello
    assert (simulated["notches"], simulated["punctuality"]) == (10, True)


@pytest.mark.parametrize("text", ["", "[]", '{"notches": 1000000}', '{"notches": "5"}', '{"punctuality": 1}'])
def test_other_settings_of_a_page_are_refused(text: str) -> None:
    with pytest.raises(DasError, match="expected the settings of a desk's page"):
        recorded_settings(said(text))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("clear-day", "--pace", "max"), "a person needs a pace"),
        (("clear-day", "--at", "1:00"), "expected a recording"),
        (("none.mcap",), "none.mcap: cannot be read"),
        (("none.mcap", "--out", "x.mcap"), "nothing is recorded"),
        (("none.mcap", "--level", "l2"), "--level l2: none.mcap is a recording to look at; nothing is driven"),
        (("nowhere",), "nowhere: not a bundled scenario"),
    ],
)
def test_what_the_desk_cannot_show_is_refused_in_one_line(
    tmp_path_factory: pytest.TempPathFactory, arguments: tuple[str, ...], said: str
) -> None:
    assert said in refusal("desk", *arguments, "--no-open", cwd=tmp_path_factory.mktemp("refused"))


@pytest.mark.nightly
def test_the_keyboard_plays_stops_and_jumps_from_bookmark_to_bookmark() -> None:
    with played() as visitor, chromium() as browser:
        page = DeskPage(
            browser.new_context(viewport={"width": 1280, "height": 720}), f"http://{visitor.host}/?token={TOKEN}"
        )
        page.phase("replay")
        page.until(lambda state: "speed" in state, "the first cab")
        page.page.keyboard.press("]")
        mark = bookmarks(drive().events)[0]
        page.until(lambda _: mark.text in page.text("event"), "the first bookmark")
        picture(page, "replay")
        for _ in range(3):
            page.page.keyboard.press("p")
        assert page.text("pace") == "10 ×"
        way = float(page.state["way"])
        page.page.keyboard.press("Space")
        page.until(lambda state: float(state["way"]) < way - 50, "ten times real time")
        page.page.keyboard.press("Space")
        still = page.state["way"]
        page.page.wait_for_timeout(500)
        assert page.state["way"] == still
        assert page.errors == []
