"""What a review says in words: what the driver saw."""

from __future__ import annotations

import math
from datetime import datetime
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np

from das.advice.wording import Language
from das.bus import das_pb2, topics
from das.bus.recording import read_recording
from das.domain.units import NS
from sim.drive.drive import Drive
from sim.drive.table import DriveTable
from sim.review.scene import ReviewScene
from sim.review.words import NODE_ALONE, DisplayWords, cards
from tests.support.hand_recorded import cab, day, recorded
from tests.support.recordings import at_ns, write_recording


def test_what_is_lost_is_not_drawn_and_is_said(tmp_path: Path) -> None:
    """Of a recording with a damaged piece: the driven speed has a gap there, and the picture says why."""
    content = bytearray(write_recording(tmp_path / "whole.mcap").read_bytes())
    places = [i for i in range(len(content) // 2) if content.startswith(b"\x04\0\0\0zstd", i)]
    for place in places[100:120]:  # 20 s
        content[place + 40] ^= 0x10
    (tmp_path / "damaged.mcap").write_bytes(content)
    recording = read_recording(tmp_path / "damaged.mcap", skip_damage=True)
    _, driven = ReviewScene.of(Drive(recording=recording)).series["speed/driven"]
    assert np.isnan(driven).sum() == 1
    assert any("damaged: " in text for text in recording.health.warnings())


def test_what_the_driver_saw() -> None:
    held: dict[str, Any] = {"presentation": 3, "mode": 3, "advised_speed_mps": 20.0, "advised_lever_ratio": 0.4}
    held |= {"next_mode": 4, "next_change_s": 12.0}
    top_speed: dict[str, Any] = {"presentation": 1, "mode": 3, "advised_speed_mps": 20.0, "limit_mps": 40.0}
    recording = recorded(cab(0, **held), cab(1, **held), cab(2, signal_m=1500.0, **top_speed), cab(3))
    seen = cards(DriveTable.of(recording))
    assert [card.time_ns for card in seen] == [at_ns(0), at_ns(2), at_ns(3)]  # each text once
    first, top, nothing = (card.text for card in seen)
    assert first.startswith("# cruise, 72 km/h")
    assert "| next | coast in 12 s |" in first
    assert "| effort advised | +40 % |" in first
    assert top.startswith("# top speed 72 km/h")
    assert "| signal at danger | km 1.50 |" in top
    assert "| limit | 144 km/h |" in top
    assert nothing.startswith("# No advice")
    alone = day()
    alone.messages.pop("cab")
    assert all(NODE_ALONE in card.text for card in cards(DriveTable.of(alone)))


def test_the_words_of_the_display_are_in_its_language_and_time_zone() -> None:
    held: dict[str, Any] = {"presentation": 4, "mode": 4, "display_speed_mps": 20.0, "next_mode": 6, "next_change_s": 8}
    held["next_speed_mps"] = 10.0
    reason = das_pb2.Reason(code=das_pb2.REASON_POINT_EARLIEST, at_m=1500.0, time_ns=at_ns(0), late_s=math.nan)
    recording = recorded(cab(0, reason=reason, **held), cab(1, presentation=1, mode=3, display_speed_mps=20.0))
    said = DisplayWords(Language.DE, ZoneInfo("Europe/Zurich"))
    guide, top = (card.text for card in cards(DriveTable.of(recording), said))
    assert guide.startswith("# rollen lassen bis 72 km/h")
    assert "| next | bremsen 36 km/h in 8 s |" in guide
    assert f"| why | km 1,5 nicht vor {datetime.fromtimestamp(at_ns(0) * NS, said.zone):%H:%M:%S} |" in guide
    assert top.startswith("# Höchstgeschwindigkeit 72 km/h")


def test_a_recording_made_before_the_codes_of_reasons_names_the_cause() -> None:
    recording = recorded((topics.ADVICE, das_pb2.Advice(time_ns=at_ns(0), cause=11)))
    assert cards(DriveTable.of(recording))[0].text.startswith("# No advice: position stale")


def test_what_the_driver_saw_of_how_to_depart() -> None:
    to_depart: dict[str, Any] = {"mode": 9, "next_mode": 1, "next_speed_mps": 25.0, "next_effort_ratio": 1.0}
    top_speed: dict[str, Any] = {"presentation": 1, "mode": 9, "display_speed_mps": 25.0}
    recording = recorded(cab(0, presentation=4, display_speed_mps=25.0, **to_depart), cab(1, **top_speed))
    guide, top = (card.text for card in cards(DriveTable.of(recording)))
    assert guide.startswith("# depart when cleared\n")
    assert "| when cleared | accelerate, 90 km/h, +100 % |" in guide
    assert "effort advised" not in guide
    assert top.startswith("# depart when cleared, top speed 90 km/h")
