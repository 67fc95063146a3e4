"""How every command opens a recording: what is damaged is left out and said, and no train is chosen in silence."""

from __future__ import annotations

from pathlib import Path

from das.bus.recording import Recording, read_recording
from das.command_line.printing import warn

_warned: set[str] = set()
"""Warnings that this process has printed."""


def open_recording(path: Path, train: str | None = None) -> Recording:
    """Read a recording, without what is damaged in it; one line on standard error says each thing that is wrong.

    `train` says which train of a recording that holds several. Raises DasError for a file that cannot be used, and for
    one of several trains where none is named.
    """
    recording = read_recording(path, train=train, skip_damage=True)
    for text in recording.health.warnings():
        line = f"{path}: {text}"
        if line not in _warned:
            _warned.add(line)
            warn(line)
    return recording
