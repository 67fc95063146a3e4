"""The opening of recordings for all commands, and the metadata on their origin.

Damaged parts are left out with a warning. If a recording holds several trains, the user must name one.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from das.bus import topics
from das.bus.recording import Contents, Recording, read_contents, recording_of
from das.command_line.printing import warn

NODE_ARGUMENTS: Final = "node_arguments"
"""Key of the arguments with which the node was started (JSON list)."""
WHAT_IF: Final = "what_if"
"""Key of the kind of a what-if (`sim.options.WhatIfKind`)."""
OF, OF_SHA256, CHANGED = "what_if_of", "what_if_of_sha256", "what_if_changed"
"""Keys of a what-if: the recording that it starts from, that file's hash, and the changes in words."""
NOTHING: Final = "nothing"
"""Text for a run without disturbances, and for a what-if without changes."""
_warned: set[str] = set()
"""Warnings that the process has printed."""


def open_recording(path: Path, train: str | None = None) -> Recording:
    """Read a recording without its damaged parts; each fault is reported in a line on standard error.

    `train` names the train of a recording that holds several. Raises DasError if the file cannot be used, or if it
    holds several trains and none is named.
    """
    return recording_of(open_contents(path), train)


def open_contents(path: Path) -> Contents:
    """The contents of a file, of all trains, without its damaged parts; warns as `open_recording` does."""
    contents = read_contents(path)
    for text in contents.health.warnings():
        line = f"{path}: {text}"
        if line not in _warned:
            _warned.add(line)
            warn(line)
    return contents


def is_session(recording: Recording) -> bool:
    """Whether a node was active, so that its messages must be there."""
    return any(recording.of(topic) for topic in (topics.ADVICE, topics.STATUS, topics.CONTROL))


def versions(recording: Recording) -> dict[str, str]:
    """The versions of the programs that took part, by their roles."""
    nodes = sorted({one.message.version for one in recording.of(topics.STATUS) if one.message.version})
    found = {"node" if len(nodes) == 1 else f"node {i}": version for i, version in enumerate(nodes, 1)}
    run = recording.metadata.get("run", {})
    who = "recorder" if run.get("kind") == "session" else "simulator"
    return {**({who: run["version"]} if "version" in run else {}), **found}
