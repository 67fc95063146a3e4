"""How every command opens a recording: what is damaged is left out and said, and no train is chosen in silence."""

from __future__ import annotations

from pathlib import Path

from das.bus.contents import Contents, read_contents
from das.bus.recording import Recording, recording_of
from das.command_line.printing import warn

_warned: set[str] = set()
"""Warnings that this process has printed."""


def open_recording(path: Path, train: str | None = None) -> Recording:
    """Read a recording, without what is damaged in it; one line on standard error says each thing that is wrong.

    `train` says which train of a recording that holds several. Raises DasError for a file that cannot be used, and for
    one of several trains where none is named.
    """
    return recording_of(open_contents(path), train)


def open_contents(path: Path) -> Contents:
    """All that a file holds, of all trains; what is damaged is left out and said as in `open_recording`."""
    contents = read_contents(path)
    for text in contents.health.warnings():
        line = f"{path}: {text}"
        if line not in _warned:
            _warned.add(line)
            warn(line)
    return contents


def forget_warnings() -> None:
    """Say again what was said before in this process."""
    _warned.clear()
