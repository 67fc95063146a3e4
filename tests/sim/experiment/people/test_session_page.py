"""A session in Chromium: every step, by keyboard alone, after a reload and a lost connection; the experimenter's page.

With `DAS_DESK_PICTURES=FOLDER` it writes what it looks at as pictures.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("starlette", reason="the extra desk is not installed")

from das.bus import das_pb2
from sim.desk.line import cab_fields, hello_of
from sim.desk.messages import PageSettings
from sim.experiment.people.forms import load_form, text_for
from sim.experiment.people.watching import Abort, WatcherMark, WatcherNote
from tests.support.desk_page import CONTRASTS, DeskPage, chromium, picture
from tests.support.desk_server import TOKEN, Visitor, until
from tests.support.making import flat, make_train
from tests.support.scripted_session import WATCH_TOKEN, ScriptedSession, scripted_session

pytestmark = pytest.mark.nightly

LANGUAGES = ("en", "de", "fr")
SIZES = {"desk": (1280, 720), "tablet": (1024, 768), "upright": (820, 1180)}
FORMS = ("tlx", "sus", "kss", "trust")
PROSE = (
    "<p>This study compares <strong>displays</strong> for train drivers. It takes about 90 minutes.</p>"
    "<h2>What you do</h2><ul><li>You drive eight times over a line of 6 km.</li><li>After each drive you answer six "
    "questions.</li></ul><h2>What is stored</h2><p>Settings of the lever and your answers, under a pseudonym. You can "
    "stop at any time, without a reason, and ask for the deletion of your data.</p>"
)
SMALL = """() => [...document.querySelectorAll("button, .radios label, input[type=range], textarea")]
  .filter((one) => one.offsetParent && !one.closest("[inert]"))
  .map((one) => [one.textContent || one.type, one.getBoundingClientRect()])
  .filter(([, box]) => box.height < 44 || box.width < 44).map(([name, box]) => `${name} ${box.width} ${box.height}`)"""
"""What can be pressed and is smaller than 44 px."""
OUTSIDE = """() => [...document.querySelectorAll("#veil > div *, dialog[open] *, .watch section *, .watch header *")]
  .filter((one) => one.offsetParent && one.textContent && !one.classList.contains("unseen"))
  .filter((one) => {
    const box = one.closest("#veil > div, dialog, section, header").getBoundingClientRect();
    const own = one.getBoundingClientRect();
    return own.left < box.left - 1 || own.right > box.right + 1 || one.scrollWidth > one.clientWidth + 1
      && getComputedStyle(one).display === "block";
  }).map((one) => `${one.id || one.tagName}: ${one.textContent}`)"""
"""The texts that are wider than their place."""
HEADER = """() => [...document.querySelectorAll("header, header button, header b, header > div")]
  .filter((one) => one.offsetParent)
  .filter((one) => one.getBoundingClientRect().right > innerWidth || one.scrollWidth > one.clientWidth + 1)
  .map((one) => one.textContent)"""
"""The texts that do not fit into the header."""
Served = tuple[Visitor, ScriptedSession]


@pytest.fixture
def served() -> Iterator[Served]:
    with scripted_session() as found:
        yield found


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as found:
        yield found


def opened(browser: Any, visitor: Visitor, size: str = "desk") -> DeskPage:
    wide, high = SIZES[size]
    context = browser.new_context(viewport={"width": wide, "height": high})
    return DeskPage(context, f"http://{visitor.host}/?token={TOKEN}")


def step(kind: str, name: str = "", language: str = "en", **fields: Any) -> dict[str, Any]:
    """The message of a step."""
    told = {"t": "step", "id": name or kind, "kind": kind, "title": "", "html": "", "done": 2, "of": 8}
    about = {"ready": "trial", "text": "instructions"}.get(kind, kind)
    return told | {"about": about} | {"items": [], "given": {}, "wait_s": 0, "language": language} | fields


def form(name: str, language: str = "en", **fields: Any) -> dict[str, Any]:
    """The message of a bundled questionnaire."""
    one = load_form(name, Path())
    intro = {"html": f"<p>{text_for(one.intro, language)}</p>"} if one.intro else {}
    shown = {"title": text_for(one.title, language), "items": [item.words(language) for item in one.items]} | intro
    return step("form", name, language, **(shown | fields))


OWN = [
    {"id": "sign", "kind": "choice", "text": "Which?", "options": ["clear", "danger"], "least": 1, "most": 2},
    {"id": "why", "kind": "text", "text": "Why?", "least": 0, "most": 0, "options": []},
]
OWN = [{"step": 1, "low": "", "high": "", "needed": True} | one for one in OWN]
OWN[1]["needed"] = False


def faults(page: DeskPage) -> list[str]:
    """The texts that are too small to press, too wide for their place, or less than 4.5 : 1 against what is behind."""
    pale = [text for text, ratio in page.page.evaluate(CONTRASTS, "body *").items() if ratio < 4.5]
    return pale + [text for look in (SMALL, OUTSIDE) for text in page.page.evaluate(look)]


def show(page: DeskPage, session: ScriptedSession, message: dict[str, Any]) -> None:
    session.put(message)
    page.until(lambda state: state.get("step") == message["id"], message["id"])
    page.page.wait_for_timeout(60)


def answers(session: ScriptedSession) -> dict[str, str]:
    """The last answer to each item that the page has sent."""
    return {one["item"]: one["value"] for one in session.of("answer")}


def hello() -> dict[str, Any]:
    told = hello_of((flat(6000.0), make_train(), flat(6000.0).stops), 0, "en", PageSettings())
    return told | {"phase": "driving", "lever": 0.0, "seq": 0, "session": True}


def cab(look: int | str) -> dict[str, Any]:
    message = das_pb2.Cab(time_ns=1, stop_m=6000.0, limit_mps=30.0, speed_mps=20.0, may_depart=True)
    return {
        "t": "cab",
        "cab": cab_fields(message) | {"look": look, "signal_m": None, "late_s": 95.0},
        "why": {},
        "seq": 0,
    }


@pytest.mark.parametrize("size", SIZES)
def test_every_step_fits_can_be_read_and_pressed_in_every_language(browser: Any, served: Served, size: str) -> None:
    visitor, session = served
    page, bad = opened(browser, visitor, size), {}
    for language in LANGUAGES:
        shown = [
            step("text", "instructions", language, title="Instructions", html=PROSE),
            step("consent", "", language, title="Study of displays", html=PROSE),
            step("ready", "", language, html=f"<p>{PROSE[3:90]}</p>", tasks=["pedal", "detection"]),
            step("break", "", language, wait_s=299),
            step("end", "", language),
            *(form(name, language, id=f"{name}-{language}") for name in FORMS),
            step("form", f"own-{language}", language, title="Own", items=OWN),
        ]
        for message in shown:
            show(page, session, message | {"id": f"{message['id']}-{language}"})
            assert page.text("title")
            picture(page, f"{size}-{language}-{message['id']}")
            if message["kind"] == "form":
                page.page.click("#go")
                page.page.evaluate("document.querySelector('#veil > div').scrollTop = 1e6")
                picture(page, f"{size}-{language}-{message['id']}-faults")
            bad[language, message["id"]] = faults(page)
        page.page.evaluate("document.getElementById('really').showModal()")
        picture(page, f"{size}-{language}-stop")
        bad[language, "stop"] = faults(page)
        page.page.keyboard.press("Escape")
        session.put(hello() | {"language": language})
        session.put(cab(language), greets=False)
        page.until(lambda state, look=language: state["phase"] == "driving" and state.get("look") == look, "the cab")
        picture(page, f"{size}-{language}-driving")
        bad[language, "driving"] = faults(page) + page.page.evaluate(HEADER)
    assert {key: found for key, found in bad.items() if found} == {}
    assert page.errors == []


def test_a_questionnaire_is_answered_by_keyboard_alone_and_each_answer_is_sent_at_once(
    browser: Any, served: Served
) -> None:
    visitor, session = served
    page = opened(browser, visitor)
    keys = page.page.keyboard
    show(page, session, form("tlx"))
    keys.press("Tab")
    keys.press("ArrowRight")
    until(lambda: answers(session) == {"mental": "55"}, "the answer")
    keys.press("Tab")
    keys.press("Enter")  # the middle, where the thumb would rest
    until(lambda: answers(session).get("physical") == "50", "the answer in the middle")
    for _ in range(5):
        keys.press("Tab")
    assert page.page.evaluate("document.activeElement.id") == "go"
    keys.press("Enter")
    assert page.page.evaluate("document.activeElement.closest('[data-item]').dataset.item") == "temporal"
    assert page.page.locator(".fault:visible").all_text_contents() == ["Please choose an answer."] * 4
    assert session.of("next") == []
    for _ in range(4):
        keys.press("Home")
        keys.press("Tab")
    assert page.page.locator(".fault:visible").count() == 0
    keys.press("Enter")
    until(lambda: session.of("next"), "the next step")
    assert answers(session) == {"mental": "55", "physical": "50"} | dict.fromkeys(
        ("temporal", "performance", "effort", "frustration"), "0"
    )
    show(page, session, form("sus"))
    keys.press("Tab")
    keys.press("Space")
    keys.press("ArrowRight")
    until(lambda: answers(session).get("often") == "2", "the choice")
    assert page.page.evaluate("[document.body, document.querySelector('header')].map((one) => one.inert)") == [
        False, True,
    ]  # fmt: skip
    assert page.errors == []


def test_answers_come_back_after_a_reload_and_are_sent_again_after_a_lost_connection(
    browser: Any, served: Served
) -> None:
    visitor, session = served
    page = opened(browser, visitor)
    show(page, session, step("form", "own", items=OWN))
    page.page.click("text=danger")
    page.page.fill("textarea", 'it [was] {red}, "I think"')
    until(lambda: answers(session) == {"sign": "2", "why": 'it [was] {red}, "I think"'}, "the answers")
    session.put(step("form", "own", items=OWN, given=answers(session)))
    page.page.reload()
    page.until(lambda state: state.get("step") == "own", "the step")
    assert page.page.is_checked("input[value='2']")
    assert page.page.input_value("textarea") == 'it [was] {red}, "I think"'
    session.said.clear()
    session.drop()
    page.until(lambda state: state["link"] == "down", "the lost connection")
    assert page.text("trouble").startswith("The connection is lost")
    page.page.click("text=clear")  # while there is no connection
    page.until(lambda state: state["link"] == "up", "the connection")
    until(lambda: answers(session) == {"sign": "1"}, "the answer again, and no other")
    page.page.keyboard.press("ArrowDown")
    assert page.errors == []


def test_consent_break_and_stop(browser: Any, served: Served) -> None:
    visitor, session = served
    page = opened(browser, visitor)
    show(page, session, step("consent", html=PROSE))
    page.page.click("#no")
    until(lambda: session.of("next"), "the next step")
    assert answers(session) == {"consent": "no"}
    show(page, session, step("consent", "consent-2", html=PROSE))
    page.page.click("#go")
    until(lambda: answers(session) == {"consent": "yes"}, "the consent")
    show(page, session, step("break", wait_s=2))
    assert page.text("text").startswith("You can go on in 0:0")
    assert not page.page.is_visible("#go")
    page.page.wait_for_selector("#go", state="visible", timeout=5000)
    show(page, session, step("text"))
    page.page.click("#veil .quit")
    assert page.page.evaluate("document.activeElement.id") == "stay"
    page.page.keyboard.press("Enter")
    assert session.of("stop") == []
    page.page.click("#veil .quit")
    page.page.click("#leave")
    until(lambda: session.of("stop"), "the end")
    session.drop()
    until(lambda: len(session.of("stop")) > 1, "the end again after a lost connection")
    show(page, session, step("end"))
    assert (page.text("title"), page.text("text")) == ("Thank you", "You can close this page.")
    assert not page.page.is_visible(".quit >> nth=1")
    assert page.errors == []


def test_beside_driving_tasks_are_shown_and_answered_and_the_end_is_open(browser: Any, served: Served) -> None:
    visitor, session = served
    page = opened(browser, visitor)
    show(page, session, step("ready", tasks=["pedal"]))
    session.put(hello())
    for look in (1, 2):
        session.put(cab(look), greets=False)
    page.until(lambda state: state["phase"] == "driving" and state.get("look") == "2", "the cab")
    page.page.keyboard.press("m")
    page.page.keyboard.press("l")  # the language is that of the experiment
    assert page.page.evaluate("document.documentElement.lang") == "en"
    for what, key, number in (("pedal", "v", 1), ("detection", "d", 4)):
        session.put({"t": "task", "what": what, "number": number, "on": True}, greets=False)
        page.page.wait_for_selector(f"#{what}", state="visible")
        picture(page, f"task-{what}")
        page.page.keyboard.press(key)
        (act,) = until(lambda what=what: [one for one in session.of("act") if one["what"] == what], "the act")
        assert (act["number"], act["look"]) == (number, 2)
        assert 0 < act["at"] - act["shown"] < 60_000
        assert not page.page.is_visible(f"#{what}")
    assert faults(page) == []
    page.page.click("header .quit")
    picture(page, "stop-driving")
    page.page.keyboard.press("Escape")
    assert session.of("stop") == []
    session.put(step("form", "probe", items=OWN))  # a freeze probe covers the display
    page.until(lambda state: state["phase"] == "step", "the probe")
    assert page.page.evaluate("getComputedStyle(document.getElementById('veil')).backgroundColor") == "rgb(7, 19, 32)"
    page.page.keyboard.press("ArrowUp")
    session.put({"t": "phase", "phase": "driving"}, greets=False)
    page.until(lambda state: state["phase"] == "driving", "the drive")
    assert session.of("lever") == []
    assert page.errors == []


WATCHED = {
    "en": ("30 % brake", "14 s early", "3 of 8 measured", "2 of 8 trials, driving", "the journal was altered",
           "not begun", "drive-3: stopped by the dead-man brake", "drive-3: mark 2", "Mark this moment"),
    "de": ("30 % Bremse", "14 s zu früh", "3 von 8 gemessenen", "2 von 8 Fahrten, driving",
           "das Journal wurde verändert", "nicht begonnen",
           "drive-3: durch die Totmannbremse gebremst", "drive-3: Markierung 2", "Moment markieren"),
    "fr": ("30 % frein", "14 s d’avance", "3 sur 8 mesurés", "2 trajets sur 8, driving", "le journal a été modifié",
           "pas commencé", "drive-3: freiné par le dispositif de veille", "drive-3: marque 2", "Marquer ce moment"),
}  # fmt: skip
"""What the experimenter's page says in each language."""


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_experimenter_watches_marks_notes_and_ends_a_trial_by_keys(
    browser: Any, served: Served, language: str
) -> None:
    visitor, session = served
    session.shown |= {
        "language": language,
        "step": "drive-3", "trial": 3, "of": 8, "condition": "guide_punctuality", "driven_s": 83.4,
        "cab": {"speed_mps": 22.1, "limit_mps": 27.8, "display_speed_mps": 25.0, "lever_ratio": -0.3, "late_s": -14.0,
                "stop_m": 6000.0, "s_m": 2410.0},
        "events": [{"at_s": 12.0, "step": "drive-2", "what": "driven", "said": ""},
                   {"at_s": 61.5, "step": "drive-3", "what": "mark", "said": "2"},
                   {"at_s": 70.0, "step": "drive-3", "what": "braked", "said": ""}],
        "others": [{"participant": "P07", "done": 2, "of": 8, "state": "driving"},
                   {"participant": "P08", "done": 8, "of": 8, "state": "end"},
                   {"participant": "P09", "done": 0, "of": 0, "state": "altered"},
                   {"participant": "P10", "done": 0, "of": 0, "state": "not_begun"}],
    }  # fmt: skip
    context = browser.new_context(viewport={"width": 1280, "height": 720})
    page = DeskPage(context, f"http://{visitor.host}/watch?token={WATCH_TOKEN}")
    page.until(lambda state: state["link"] == "up", "the link")
    picture(page, f"watch-{language}")
    said = str(page.page.evaluate("document.body.textContent"))
    assert [text for text in ("1:23", "80 km/h", "100 km/h", "90 km/h", *WATCHED[language]) if text not in said] == []
    assert page.page.evaluate("document.documentElement.lang") == language
    assert page.page.evaluate("[...document.querySelectorAll('[data-word]')].filter((one) => !one.textContent)") == []
    keys = page.page.keyboard
    for key in ("4", "m", "n"):
        keys.press(key)
    keys.type("asks [why] 5 {m}")
    picture(page, f"watch-note-{language}")
    keys.press("Control+Enter")
    keys.press("a")
    picture(page, f"watch-abort-{language}")
    keys.press("Enter")  # back, because it has the focus
    keys.press("a")
    page.page.click("#yes")
    until(lambda: len(session.asked) == 4, "the requests")
    assert session.asked == [WatcherMark("4"), WatcherMark("M"), WatcherNote("asks [why] 5 {m}"), Abort()]
    assert faults(page) == []
    assert page.errors == []
