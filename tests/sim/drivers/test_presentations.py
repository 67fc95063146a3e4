"""A presentation is one module, a made-up one as well, and shows what it is for and nothing else."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest

from das.advice.regimes import Regime
from das.bus import das_pb2, topics
from das.domain.units import KMH
from das.front_door import chosen
from sim.drive.drive import Drive
from sim.drivers import presentations
from sim.drivers.cab import AdviceView
from sim.drivers.human import HumanDriver
from sim.drivers.kinds import DriverKind, Presentation
from sim.drivers.messages import recorded_view
from sim.drivers.presentations.presenter import Shown, presenter_of, shown_presentation
from sim.experiment.study_files import level_words
from sim.meanings import DARK
from sim.review.scene import lanes
from sim.review.words import cards
from tests.support import presentations as made_up
from tests.support.flat_days import flat_day
from tests.support.recorded_days import recorded_day
from tests.support.ride import shown


@pytest.fixture
def traffic_light(monkeypatch: pytest.MonkeyPatch) -> Iterator[Presentation]:
    """The made-up presentation, added as anybody adds one: the line of the enumeration, and the file in the package."""
    added = str.__new__(Presentation, "traffic-light")
    added._name_, added._value_ = "TRAFFIC_LIGHT", "traffic-light"
    monkeypatch.setattr(Presentation, "_member_names_", [*Presentation._member_names_, added.name])
    monkeypatch.setitem(Presentation._member_map_, added.name, added)
    monkeypatch.setitem(Presentation._value2member_map_, added.value, added)
    monkeypatch.setattr(presentations, "__path__", [*presentations.__path__, *made_up.__path__])
    yield added
    presenter_of.cache_clear()


@pytest.mark.slow
def test_a_new_presentation_takes_one_file_and_one_line(traffic_light: Presentation) -> None:
    """A day is driven with it; the recording, the lane, the card and the words of a study know it."""
    assert chosen(Presentation, "run_day", "advice", "traffic-light") is traffic_light
    day = flat_day("[[disturbances]]\nkind = 'sensor-fault'\nfault = 'dropout'\nfrom_s = 80\nfor_s = 10\n")
    driver = day.driver(DriverKind.HUMAN)
    assert isinstance(driver, HumanDriver)
    recording = recorded_day(day, driver, traffic_light)

    seen = [entry.message for entry in recording.of(topics.CAB) if entry.message.presentation]
    views = [view for message in seen if (view := recorded_view(message)) is not None]
    assert len(views) == len(seen) > 100
    assert {message.presentation for message in seen} == {17}
    assert {view.presentation for view in views} == {traffic_light}
    assert {Regime.FULL_TRACTION, Regime.COAST, Regime.FULL_BRAKE} <= {Regime(view.mode) for view in views}
    assert any(event.what == "followed" and event.value == Regime.COAST for event in driver.events)

    drive = Drive(recording=recording)
    lane = next(one for one in lanes(drive) if one.name == "shown")
    assert {change.state for change in lane.changes} == {"", "a light", "depart", "stop"}
    assert lane.color("a light", DARK) == "#123456"
    assert {"green", "amber", "red"} <= {card.text.splitlines()[0].removeprefix("# ") for card in cards(drive.table)}
    assert level_words("presentation", "traffic-light") == "green, amber or red"


def test_every_presentation_has_a_number_of_its_own_and_the_one_that_the_bus_names() -> None:
    numbers = {f"PRESENTATION_{one.name}": presenter_of(one).number for one in Presentation}
    named = dict(das_pb2.Cab.Presentation.items())
    assert {name: numbers.get(name) for name in named} == named
    assert len(set(numbers.values())) == len(numbers)


def test_a_number_of_the_bus_is_a_presentation_or_nothing_is_shown() -> None:
    found = {number: shown_presentation(number) for number in (0, *das_pb2.Cab.Presentation.values(), 99)}
    assert {number for number, presentation in found.items() if presentation is None} == {0, 99}
    assert [one for number, one in found.items() if one is not None and presenter_of(one).number != number] == []


@pytest.mark.parametrize(("late_s", "words"), [(12.4, "12 s late"), (-3.0, "3 s early"), (0.2, "on time")])
def test_a_display_of_the_deviation_has_no_mode_in_its_headline(late_s: float, words: str) -> None:
    seen = shown(Presentation.DEVIATION, Regime.COAST, deviation_s=late_s)
    assert presenter_of(Presentation.DEVIATION).headline(seen) == words


def view(presentation: Presentation, mode: Regime = Regime.CRUISE, **fields: Any) -> AdviceView:
    given = {"speed_mps": 81.4 * KMH, "display_speed_mps": 82 * KMH, "lever_ratio": 0.31, **fields}
    return shown(presentation, mode, **given)


def test_each_presentation_shows_what_it_is_for() -> None:
    assert Shown.of(view(Presentation.TOP_SPEED)) == Shown(mode=None, speed_kmh=82, effort=None)
    assert Shown.of(view(Presentation.FOUR_MODE)) == Shown(mode=Regime.CRUISE, speed_kmh=82, effort=None)
    assert Shown.of(view(Presentation.FOUR_MODE, Regime.COAST)) == Shown(mode=Regime.COAST, speed_kmh=None, effort=None)
    late = view(Presentation.DEVIATION, deviation_s=12.4)
    assert Shown.of(late) == Shown(mode=None, speed_kmh=None, effort=None, deviation_s=12)
    assert Shown.of(view(Presentation.SPEED_AND_EFFORT)) == Shown(mode=Regime.CRUISE, speed_kmh=82, effort=2)


@pytest.mark.parametrize(("ratio", "steps"), [(0.0, 0), (0.09, 0), (0.11, 1), (-0.29, -1), (-0.31, -2), (1.0, 5)])
def test_effort_is_read_in_fifths_of_the_controller(ratio: float, steps: int) -> None:
    assert Shown.of(view(Presentation.SPEED_AND_EFFORT, lever_ratio=ratio)).effort == steps


def test_what_is_not_known_is_not_shown() -> None:
    nothing = view(Presentation.SPEED_AND_EFFORT, speed_mps=math.nan, display_speed_mps=math.nan, lever_ratio=math.nan)
    assert Shown.of(nothing) == Shown(mode=Regime.CRUISE)
    assert Shown.of(view(Presentation.TOP_SPEED, display_speed_mps=math.nan)) == Shown(speed_kmh=81)
