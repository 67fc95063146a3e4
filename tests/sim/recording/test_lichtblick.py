"""The layout for Lichtblick and Foxglove names topics and fields that our recordings have.

A path is written as in those viewers: topic, then fields after dots. Its grammar knows a topic as words of letters,
digits, '-' and '_' with slashes between them, so that none of ours needs quotes.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from foxglove_schemas_protobuf.Event_pb2 import Event
from google.protobuf.descriptor import FieldDescriptor
from mcap.reader import make_reader

from das.bus.recording import read_recording
from das.bus.topics import LOCATION, LOG, TOPICS, topic_of
from das.command_line.options import DEFAULT_TRAIN
from sim.drive.notes import TOPIC as NOTES
from sim.meanings import LIGHT

ROOT = Path(__file__).parents[3]
LAYOUT = json.loads((ROOT / "docs/layouts/lichtblick.json").read_text())
PANELS: dict[str, dict[str, Any]] = LAYOUT["configById"]
REFERENCES = (ROOT / "recordings/references/clear-day.mcap", ROOT / "recordings/references/replay.mcap")
PATH = re.compile(r"(?P<topic>[\w-]+(?:/[\w-]+)*)(?:\.(?P<field>\w+))?")


def paths() -> list[str]:
    """All paths and topics that the panels name, but the notes."""
    found: set[str] = set()
    for panel in PANELS.values():
        found |= {
            one["value"] for one in (*panel.get("paths", ()), *([panel["xAxisPath"]] if "xAxisPath" in panel else []))
        }
        found |= {panel[key] for key in ("topicPath", "topicToRender") if key in panel}
        found |= set(panel.get("topicColors", ()))
    return sorted(found - {NOTES})


def leaves(tree: Any) -> Iterator[str]:
    if isinstance(tree, str):
        yield tree
    else:
        yield from leaves(tree["first"])
        yield from leaves(tree["second"])


TITLES = {"lichtblickPanelTitle", "foxglovePanelTitle"}
"""Keys of a panel's title in Lichtblick and in Foxglove."""
SETTINGS: dict[str, set[str]] = {
    "Plot": {
        "paths", "showLegend", "legendDisplay", "showPlotValuesInLegend", "showXAxisLabels", "showYAxisLabels",
        "isSynced", "xAxisVal", "xAxisPath", "sidebarDimension",
    },
    "StateTransitions": {"isSynced", "paths"},
    "map": {
        "center", "customTileUrl", "disabledTopics", "followTopic", "layer", "topicColors", "zoomLevel",
        "maxNativeZoom",
    },
    "RawMessages": {"diffEnabled", "diffMethod", "diffTopicPath", "showFullMessageForDiff", "topicPath"},
    "RosOut": {"searchTerms", "minLogLevel", "topicToRender"},
}  # fmt: skip
"""What the panels of Lichtblick know, by the types in its source (packages/suite-base/src/panels, November 2026)."""
OF_A_PATH = {
    "Plot": {"value", "label", "color", "enabled", "timestampMethod"},
    "StateTransitions": {"value", "label", "timestampMethod"},
}


@pytest.mark.parametrize("name", PANELS)
def test_a_panel_says_what_lichtblick_knows_and_has_a_title(name: str) -> None:
    panel, kind = PANELS[name], name.split("!", maxsplit=1)[0]
    assert set(panel) - TITLES <= SETTINGS[kind]
    assert SETTINGS[kind] - set(panel) <= {"xAxisPath"}  # nothing that its types ask for is left out
    assert len({panel[key] for key in TITLES}) == 1
    for path in panel.get("paths", ()):
        assert set(path) == OF_A_PATH[kind]
        assert path["timestampMethod"] == "receiveTime"
        assert path.get("color", LIGHT.ink) in (LIGHT.ink, *LIGHT.of.values())  # a colour means what it means here
    if kind == "Plot":
        assert re.search(r"\([^)]+\)$", panel["lichtblickPanelTitle"])  # the unit: the axes have no names there
        assert panel["xAxisVal"] == ("custom" if "xAxisPath" in panel else "timestamp")


def test_every_panel_is_shown_once() -> None:
    assert sorted(leaves(LAYOUT["layout"])) == sorted(PANELS)


@pytest.mark.parametrize("path", paths())
def test_a_path_names_a_recorded_topic_and_a_plain_field_of_it(path: str) -> None:
    found = PATH.fullmatch(path)
    assert found is not None
    topic = topic_of(found["topic"])
    assert topic is not None
    assert topic.recorded
    assert topic.key(DEFAULT_TRAIN) == found["topic"]
    if found["field"] is not None:
        field = topic.message.DESCRIPTOR.fields_by_name[found["field"]]
        assert not field.is_repeated
        assert field.cpp_type not in (FieldDescriptor.CPPTYPE_STRING, FieldDescriptor.CPPTYPE_MESSAGE)


def test_the_bundled_recordings_have_what_is_plotted() -> None:
    """What the node says is in the references under these very names, with a number to draw."""
    seen = set()
    for file in REFERENCES:
        with file.open("rb") as content:
            channels = {channel.topic for channel in make_reader(content).get_summary().channels.values()}
        recording = read_recording(file)
        for path in paths():
            topic, _, field = path.partition(".")
            if topic in channels and field:
                values = recording.columns(topic.split("/")[-1], field)[field]
                if any(math.isfinite(value) for value in values):
                    seen.add(path)
    missing = {path for path in paths() if path.startswith("das/") and "." in path} - seen
    assert missing == set()


def test_messages_that_other_viewers_know_are_foxgloves() -> None:
    assert LOCATION.message.DESCRIPTOR.full_name == "foxglove.LocationFix"
    assert LOG.message.DESCRIPTOR.full_name == "foxglove.Log"
    assert Event.DESCRIPTOR.full_name == "foxglove.Event"
    assert all(topic.message.DESCRIPTOR.full_name.split(".")[0] in ("das", "foxglove") for topic in TOPICS)


def test_the_notes_are_under_the_name_that_the_layout_shows() -> None:
    assert PANELS["RawMessages!notes"]["topicPath"] == NOTES
