"""The opening and writing of recordings for all commands, and the metadata on their origin.

Damaged parts are left out with a warning. If a recording holds several trains, the user must name one. A new file
appears at its path only when it is complete.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from das.bus import topics
from das.bus.recorder import RecordingFile
from das.bus.recording import Contents, Recording, read_contents, recording_of
from das.command_line.printing import warn
from das.domain.clocks import Clocks
from das.domain.errors import DasError
from das.domain.files.writing import refuse_link

NODE_ARGUMENTS: Final = "node_arguments"
"""Key of the arguments with which the node was started (JSON list)."""
WHAT_IF: Final = "what_if"
"""Key of the kind of a what-if (`sim.options.WhatIfKind`)."""
OF, OF_SHA256, CHANGED = "what_if_of", "what_if_of_sha256", "what_if_changed"
"""Keys of a what-if: the recording that it starts from, that file's hash, and the changes in words."""
NOTHING: Final = "nothing"
"""Text for a day without disturbances, and for a what-if without changes."""
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


@contextmanager
def whole_recording(out: Path, now_ns: int) -> Iterator[RecordingFile]:
    """A recording to write; it appears at `out` at the end of the block, and not at all if the block fails.

    `now_ns` is the time stamp of attached files (ns since 1970). Raises DasError if the recording cannot be written.
    """
    refuse_link(out)
    try:
        with tempfile.TemporaryDirectory(dir=out.parent, prefix=f".{out.name}.") as folder:
            beside = Path(folder) / out.name
            file = RecordingFile(beside, Clocks(now_ns=lambda: now_ns))
            try:
                yield file
            finally:
                file.close()
            os.replace(beside, out)
    except OSError as error:
        raise DasError(f"{out}: cannot be written ({error.strerror})") from error


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
