"""The page of the cab desk in Chromium: every presentation, language and size, and every way to move the lever.

With `DAS_DESK_PICTURES=FOLDER` it writes what it looks at as pictures; those of `docs/results/0.2/screens` are made so.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from das.bus import das_pb2
from das.domain.route import Stop
from sim.drivers.cab import CabView
from sim.drivers.kinds import DriverKind, Presentation
from sim.drivers.messages import CabLook, cab_message
from sim.drivers.presentations.presenter import presenter_of
from sim.plant.kernels import Command
from sim.plant.plant import COAST
from sim.world.in_process import InProcess
from sim.world.loop import World
from sim.world.scenario import read_scenario
from sim.world.service import Day, lay_out, make_day
from tests.support.desk_page import CONTRASTS, DeskPage, chromium, picture
from tests.support.desk_server import TOKEN, MadeUpBus, Visitor, desk_server, until
from tests.support.flat_days import service_of
from tests.support.making import REPOSITORY

pytestmark = pytest.mark.nightly

HILLS = (
    (REPOSITORY / "sim" / "experiment" / "studies" / "days" / "zug-luzern.toml").read_text(encoding="utf-8")
    + """
[[disturbances]]
kind = "restriction"
from_m = 35000
to_m = 36000
speed_kmh = 80
announced_m = 3000
[[disturbances]]
kind = "signal-stop"
at_m = 40000
seen_m = 1500
clears_after_s = 60
"""
)
SIZES = {"desk": (1280, 720), "large": (1920, 1080), "tablet": (1024, 768), "upright": (820, 1180)}
LANGUAGES = ("en", "de", "fr")
MARKUP = '<img src=x onerror="alert(1)"><b>Zürich & Löwenstrasse</b>'
OVERFLOWING = """() => {
  const beyond = (one) => {
    const own = one.getBoundingClientRect();
    const box = one.closest("section, header, #veil > div, footer").getBoundingClientRect();
    const wide = one.scrollWidth > one.clientWidth + 1 && getComputedStyle(one).display === "block";
    return own.right > box.right + 1 || own.bottom > box.bottom + 1 || own.left < box.left - 1 || own.top < box.top - 1
      || wide;
  };
  const all = "header b, header span, main b, main span, main i, #veil h1, #veil p, button";
  return [...document.querySelectorAll(all)].filter((one) => one.offsetParent && one.textContent && beyond(one))
    .map((one) => `${one.id || one.tagName}: ${one.textContent}`);
}"""
"""The texts that are larger than their place on the page."""


Served = tuple[Visitor, MadeUpBus]
Cabs = Callable[[Presentation], list[Any]]
"""A function that drives the day with a presentation, and returns the cabs."""


class Watched:
    """A driver who remembers the cabs that another one saw, as the messages that a desk would be sent."""

    def __init__(self, day: Day) -> None:
        self._day, self._driver = day, day.driver(DriverKind.HUMAN)
        self._command: Command = COAST
        self.cabs: list[Any] = []

    def command(self, cab: CabView) -> Command:
        """What the other driver does."""
        look = CabLook(self._day.service.moment_ns(cab.time_s), cab, self._command, len(self.cabs) + 1)
        self.cabs.append(cab_message(look, self._day.service.line))
        self._command = self._driver.command(cab)
        return self._command


@pytest.fixture(scope="module")
def day(tmp_path_factory: pytest.TempPathFactory) -> Day:
    path = tmp_path_factory.mktemp("desk") / "hills.toml"
    path.write_text(HILLS, encoding="utf-8")
    return make_day(service_of(path), 1)


@pytest.fixture(scope="module")
def cabs(day: Day) -> Cabs:
    kept: dict[Presentation, list[Any]] = {}

    def driven(shown: Presentation) -> list[Any]:
        if shown not in kept:
            driver, guide = Watched(day), presenter_of(shown).needs_guide if shown is not Presentation.NONE else False
            World(day, driver, shown, InProcess(day.service, guide=guide)).run()
            kept[shown] = driver.cabs
        return kept[shown]

    return driven


@pytest.fixture
def desk(day: Day) -> Iterator[Served]:
    with desk_server((day.service.route, day.service.vehicle, day.service.stops)) as found:
        yield found


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as found:
        yield found


def opened(browser: Any, visitor: Visitor, size: tuple[int, int] = SIZES["desk"], **options: Any) -> DeskPage:
    context = browser.new_context(viewport={"width": size[0], "height": size[1]}, **options)
    page = DeskPage(context, f"http://{visitor.host}/?token={TOKEN}")
    page.until(lambda state: state["link"] == "up", "the link")
    return page


def show(page: DeskPage, bus: MadeUpBus, cab: Any, **changed: Any) -> None:
    """Let the page show a cab, with some fields changed, and wait until it does."""
    copy = das_pb2.Cab()
    copy.CopyFrom(cab)
    for name, value in changed.items():
        setattr(copy, name, value)
    look = bus.cab(copy)
    page.until(lambda state: state.get("look") == f"{look}", "the cab")
    page.page.wait_for_timeout(80)


def first(cabs: list[Any], fits: Callable[[Any], bool]) -> Any:
    return next(cab for cab in cabs if fits(cab))


def set_to(bus: MadeUpBus, ratio: float, device: Any = None) -> None:
    """Wait until the last setting on the bus is this one, by this device if one is given."""

    last: list[Any] = []

    def done() -> bool:
        last[:] = bus.of("action")[-1:]
        return any(one.lever_ratio == ratio and device in (None, one.device) for one in last)

    try:
        until(done, f"the setting {ratio}")
    except AssertionError as error:
        raise AssertionError(f"{error}; the last on the bus: {last}") from None


PAD = """
window.axis = window.polls = 0;
navigator.getGamepads = () => { window.polls++; return [{ connected: true, axes: [0, window.axis] }]; };
"""

MOMENTS: dict[str, Callable[[Any], bool]] = {
    "waiting": lambda cab: not cab.may_depart and cab.clock_s > -4,
    "accelerating": lambda cab: cab.speed_mps > 14 and cab.mode in (1, 2),
    "restriction": lambda cab: bool(cab.restrictions) and cab.restrictions[0].start_m - cab.s_m < 1500,
    "signal": lambda cab: cab.signal_m - cab.s_m < 900 and cab.speed_mps > 5,
    "coasting": lambda cab: cab.mode == 4 and cab.speed_mps > 20,
    "arriving": lambda cab: cab.stop_m - cab.s_m < 140 and cab.speed_mps > 3,
}


@pytest.mark.parametrize("size", SIZES)
def test_the_words_of_every_moment_and_language_fit(browser: Any, desk: Served, cabs: Cabs, size: str) -> None:
    visitor, bus = desk
    page, found = opened(browser, visitor, SIZES[size]), {}
    for language in LANGUAGES:
        while page.page.evaluate("document.documentElement.lang") != language:
            page.page.keyboard.press("l")
        for moment, fits in MOMENTS.items():
            show(page, bus, first(cabs(Presentation.GUIDE), fits), interlock=0)
            found[language, moment] = page.page.evaluate(OVERFLOWING)
            picture(page, f"{size}-{language}-{moment}")
        gone = first(cabs(Presentation.GUIDE), MOMENTS["accelerating"])
        show(page, bus, gone, interlock=1, presentation=0, lever_ratio=-1)
        found[language, "braked"] = page.page.evaluate(OVERFLOWING)
        picture(page, f"{size}-{language}-braked")
        page.page.keyboard.press("ArrowUp")  # who moves the lever has read that the desk was away
        page.page.keyboard.press("ArrowDown")
    assert {key: words for key, words in found.items() if words} == {}
    assert page.errors == []


def test_an_acceleration_that_only_changes_its_effort_is_announced_with_the_new_one(
    browser: Any, desk: Served, cabs: Cabs
) -> None:
    visitor, bus = desk
    page, cab = opened(browser, visitor), first(cabs(Presentation.GUIDE), MOMENTS["accelerating"])
    coming = {"next_mode": 2, "next_effort_ratio": 0.4, "next_change_s": 9.0, "next_change_m": 90.0}
    for faster_mps, with_effort in ((0.0, True), (5.0, False)):
        show(page, bus, cab, **coming, next_speed_mps=cab.display_speed_mps + faster_mps)
        assert ("· 40 %" in page.text("coming")) is with_effort


def test_what_the_card_and_the_order_say_never_contradicts_speed_limit_and_place(
    browser: Any, desk: Served, cabs: Cabs
) -> None:
    visitor, bus = desk
    page, cab, drive = opened(browser, visitor), das_pb2.Cab(), cabs(Presentation.GUIDE)
    cab.CopyFrom(first(drive, lambda cab: cab.mode == das_pb2.MODE_CRUISE))
    for code, said in ((das_pb2.REASON_NONE, "Hold"), (das_pb2.REASON_TOO_FAST, "Slow down to")):
        cab.reason.code = code
        show(page, bus, cab)
        assert page.text("do") == said
    for over_mps, said in ((0.4, "Line clear"), (0.6, "Too fast"), (0.3, "Too fast"), (0.1, "Line clear")):
        show(page, bus, cab, speed_mps=cab.limit_mps + over_mps)
        assert (page.text("may"), page.state["over"]) == (said, f"{said == 'Too fast'}".lower())
    show(page, bus, cab, speed_mps=cab.limit_mps + 5.0, signal_m=cab.s_m + 300.0)
    assert (page.text("may"), page.state["over"]) == ("Signal at danger", "true")
    from_m = drive[0].s_m
    for s_m, said in ((cab.s_m, "Line clear"), (cab.stop_m, "Stopped"), (from_m, "Depart"), (from_m + 25.0, "Depart")):
        show(page, bus, cab, speed_mps=0.0, s_m=s_m)
        assert page.text("may") == said


def test_a_change_at_a_limit_has_its_distance(browser: Any, desk: Served, cabs: Cabs) -> None:
    visitor, bus = desk
    page, cab = opened(browser, visitor), first(cabs(Presentation.GUIDE), MOMENTS["accelerating"])
    limit_m = next(one.s_m for one in cab.limits_ahead if one.s_m > cab.s_m and one.limit_mps != cab.limit_mps)
    told = "[...document.querySelectorAll('#coming li')].map((one) => one.children[1].textContent)"
    for beside_m, places in ((20.0, 1), (200.0, 2)):
        change_m = limit_m - cab.s_m + beside_m
        show(page, bus, cab, advice_s=cab.clock_s, second_mode=0, next_change_m=change_m, next_change_s=30.0)
        assert len(set(page.page.evaluate(told)[:2])) == places


@pytest.mark.parametrize("shown", list(Presentation))
def test_every_presentation_is_shown_as_its_cab_says(
    browser: Any, desk: Served, cabs: Cabs, shown: Presentation
) -> None:
    visitor, bus = desk
    page = opened(browser, visitor)
    cab = first(cabs(shown), lambda cab: cab.speed_mps > 18 and cab.clock_s > 60)
    show(page, bus, cab)
    assert page.page.evaluate(OVERFLOWING) == []
    state, said = page.state, page.text("do")
    blank = shown in (Presentation.NONE, Presentation.SHEET)  # a sheet is on paper
    if blank:
        assert (said, state["advice"], state["effort"]) == ("No advice", "", "")
    elif shown is Presentation.DEVIATION:
        late = round(abs(cab.deviation_s))
        assert said == (f"{late} s {'late' if cab.deviation_s > 0 else 'early'}" if late else "on time")
        assert page.text("late") == ""  # the header must not say what this presentation is about
    else:
        assert state["advice"] == (
            "" if shown is Presentation.FOUR_MODE and cab.mode != 3 else f"{round(cab.display_speed_mps * 3.6)}"
        )
        assert said == ("Drive at most" if shown is Presentation.TOP_SPEED else said)
    show(page, bus, cab, clock_s=(cab.clock_s if blank else cab.valid_until_s) + 1)
    assert page.text("do") == "No advice"  # it is valid no longer
    show(page, bus, cab)
    picture(page, f"shown-{shown}")
    assert page.errors == []


def test_contrast_is_at_least_that_of_wcag_aa(browser: Any, desk: Served, cabs: Cabs) -> None:
    """4.5 : 1 for every text, measured on the page."""
    visitor, bus = desk
    page = opened(browser, visitor)
    measured: dict[str, float] = {}
    for moment in ("waiting", "accelerating", "signal"):
        show(page, bus, first(cabs(Presentation.GUIDE), MOMENTS[moment]), interlock=0)
        measured |= page.page.evaluate(CONTRASTS, "header *, main *, #veil *")
    assert len(measured) > 15
    assert {words: round(ratio, 1) for words, ratio in measured.items() if ratio < 4.5} == {}


def test_the_keyboard_alone_is_enough_and_a_screen_reader_is_told(browser: Any, desk: Served, cabs: Cabs) -> None:
    visitor, bus = desk
    page = opened(browser, visitor, reduced_motion="reduce")
    drive = cabs(Presentation.GUIDE)
    show(page, bus, first(drive, MOMENTS["accelerating"]), interlock=0)
    focused = "document.activeElement.id"
    assert page.page.evaluate(focused) == "leverbox"
    page.page.keyboard.press("ArrowUp")
    page.page.keyboard.press("ArrowUp")
    assert page.page.get_attribute("#leverbox", "aria-valuenow") == "20"
    set_to(bus, 0.2)
    page.page.keyboard.press("End")
    set_to(bus, -1.0)
    page.page.keyboard.press("0")
    set_to(bus, 0.0)
    reached = set()
    for _ in range(4):
        page.page.keyboard.press("Tab")
        reached.add(page.page.evaluate(focused))
    assert {"sound", "language"} <= reached
    assert page.page.get_attribute("#sound", "aria-pressed") == "false"
    page.page.keyboard.press("m")
    assert page.page.get_attribute("#sound", "aria-pressed") == "true"
    page.page.keyboard.press("b")
    until(lambda: [one for one in bus.of("mark") if one.kind == das_pb2.Mark.KIND_MARK], "the mark")
    show(page, bus, first(drive, MOMENTS["coasting"]), interlock=0)
    assert page.text("say").startswith(page.text("do"))
    assert page.page.get_attribute("#say", "aria-live") == "polite"
    assert page.page.evaluate("getComputedStyle(document.getElementById('advice')).transitionProperty") == "none"
    assert "km/h" in str(page.page.get_attribute("#dial", "aria-label"))


def test_mouse_touch_wheel_and_gamepad_move_the_same_lever(browser: Any, desk: Served, cabs: Cabs) -> None:
    visitor, bus = desk
    page = opened(browser, visitor, has_touch=True)
    show(page, bus, first(cabs(Presentation.GUIDE), MOMENTS["accelerating"]), interlock=0)
    box = page.page.locator("#leverbox").bounding_box()
    x, y = box["x"] + box["width"] / 2, lambda ratio: box["y"] + 56 + (1 - ratio) / 2 * (box["height"] - 112)

    page.page.mouse.move(x, y(0.5))
    page.page.mouse.down()
    set_to(bus, 0.5, das_pb2.Action.DEVICE_MOUSE)
    page.page.mouse.move(x, y(-0.3))
    set_to(bus, -0.3, das_pb2.Action.DEVICE_MOUSE)
    page.page.mouse.up()
    page.page.mouse.wheel(0, -100)
    set_to(bus, -0.2, das_pb2.Action.DEVICE_WHEEL)
    page.page.touchscreen.tap(x, y(0.8))
    set_to(bus, 0.8, das_pb2.Action.DEVICE_TOUCH)
    page.page.evaluate(PAD)
    until(lambda: page.page.evaluate("window.polls > 1"), "the resting stick")
    page.page.evaluate("window.axis = 0.05")  # a tremble
    page.page.keyboard.press("ArrowUp")
    set_to(bus, 0.9, das_pb2.Action.DEVICE_KEY)  # a stick at rest leaves the keys in charge
    page.page.evaluate("window.axis = -0.52")
    set_to(bus, 0.5, das_pb2.Action.DEVICE_GAMEPAD)
    page.page.keyboard.press("ArrowDown")
    set_to(bus, 0.4, das_pb2.Action.DEVICE_KEY)
    page.page.evaluate("window.axis = 0")
    set_to(bus, 0.0, das_pb2.Action.DEVICE_GAMEPAD)
    assert page.errors == []


def test_markup_in_names_is_text_and_is_clipped(day: Day, browser: Any, cabs: Cabs) -> None:
    stops = tuple(Stop(name=MARKUP * 2, position_m=one.position_m) for one in day.service.stops)
    cab = first(cabs(Presentation.GUIDE), MOMENTS["arriving"])
    with desk_server((day.service.route, day.service.vehicle, stops)) as (visitor, bus):
        page = opened(browser, visitor)
        page.phase("welcome")
        assert page.text("title") == "Cab desk"  # not the title of the scenario, which says what will happen
        show(page, bus, cab)
        assert page.text("stop") == MARKUP * 2
        assert page.page.evaluate("document.querySelectorAll('img').length") == 0
        clipped = ("stop:", "B:")  # by design, with an ellipsis
        assert [words for words in page.page.evaluate(OVERFLOWING) if not words.startswith(clipped)] == []
        picture(page, "markup")
        assert page.errors == []


def test_a_page_without_its_server_says_so_and_shows_no_advice(browser: Any, cabs: Cabs) -> None:
    """Stalled: lost, and found again. A newer page: taken. Told to stop: ended."""
    cab = first(cabs(Presentation.GUIDE), MOMENTS["accelerating"])
    with desk_server() as (visitor, bus):
        page = opened(browser, visitor)
        page.phase("welcome")
        picture(page, "welcome")
        show(page, bus, cab)
        visitor.stall(8.0)
        page.until(lambda state: state["link"] == "down", "the stall")
        assert (page.text("title"), page.state["advice"]) == ("Connection lost", "")
        picture(page, "lost")
        page.until(lambda state: state["link"] == "up", "the end of the stall")
        newer = opened(browser, visitor)
        page.phase("taken")
        picture(page, "taken")
    newer.phase("broken")
    assert newer.text("title") == "The drive was ended"


def test_the_line_is_read_without_solving_anything(day: Day, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim.world.service.solve_front", None)
    assert lay_out(read_scenario(day.service.scenario.source))
