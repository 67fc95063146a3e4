"""A person drives 6 km at the cab desk by keyboard, in Chromium."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from das.bus.recording import Recording, read_recording
from das.bus.topics import ACTION, CAB, TRUTH
from sim.desk.messages import PageSettings, recorded_settings
from sim.plant.plant import COAST, lever
from sim.world.scenario import load_scenario
from sim.world.service import make_day, prepare_service
from tests.support.desk_page import FLAT_DAY, DeskPage, chromium, desk_command

pytestmark = pytest.mark.nightly


def driven_anew(recording: Recording) -> list[tuple[float, float]]:
    """Times (s) and positions (m) of the train if the levers of the recorded cabs are set again, without any desk."""
    day = make_day(prepare_service(load_scenario(str(FLAT_DAY))), 0)
    state = day.plant.at(day.service.stops[0].position_m, time_s=-10.0)
    cabs = [entry.message for entry in recording.of(CAB)]
    found = []
    for cab, after in pairwise(cabs):
        found.append((cab.clock_s, state.s_m))
        held = not cab.may_depart and cab.speed_mps <= 0
        state = day.plant.advance(state, COAST if held else lever(after.lever_ratio), 0.2)
    return found


def test_a_person_drives_6_km_by_keyboard_and_the_recording_is_what_was_shown_and_set(tmp_path: Path) -> None:
    """At three times real time: a stop within 10 m of the mark, 20 moments as recorded, and the same train again."""
    seen: dict[int, dict[str, str]] = {}
    options = ("--pace", "3", "--no-punctuality", "--out", "d.mcap", "--json")
    with desk_command(tmp_path, str(FLAT_DAY), *options) as (child, address):
        with chromium() as browser:
            page = DeskPage(browser.new_context(viewport={"width": 1280, "height": 720}), address)
            page.begin()
            page.drive(lambda state: seen.update({int(state["look"]): state}))
            assert page.phase("over")
            assert page.errors == []
        said, errors = child.communicate(timeout=60)
    found = json.loads(said)
    assert child.returncode == 0, errors
    assert abs(found["stops"][-1]["stopping_error_m"]) <= 10
    assert (found["driver"], found["messages_lost"], found["signals_passed"]) == ("desk", 0, 0)
    recording = read_recording(tmp_path / "d.mcap")
    assert recorded_settings(recording) == PageSettings(punctuality=False)
    cabs = {entry.message.look: entry.message for entry in recording.of(CAB)}
    moments = [seen[look] for look in sorted(seen)][:: max(len(seen) // 40, 1)]
    assert len(moments) >= 20
    for state in moments:
        cab = cabs[int(state["look"])]
        assert state["speed"] == f"{round(cab.speed_mps * 3.6)}"
        assert state["limit"] == f"{round(cab.limit_mps * 3.6)}"
        assert state["way"] == f"{cab.stop_m - cab.s_m:.1f}"
        assert state["lever"] == f"{round(cab.lever_ratio * 100)}"
        if state["advice"]:
            assert state["advice"] == f"{round(cab.display_speed_mps * 3.6)}"
    truth = recording.columns(TRUTH, "s_m")["s_m"]
    again = [s_m for clock_s, s_m in driven_anew(recording) if abs(clock_s - round(clock_s)) < 0.01]
    np.testing.assert_allclose(again[: len(truth)], truth[: len(again)], atol=1e-6)
    actions = [entry.message for entry in recording.of(ACTION)]
    assert len(actions) > 10
    assert all(one.browser_ns <= one.server_ns <= one.bus_ns for one in actions)
