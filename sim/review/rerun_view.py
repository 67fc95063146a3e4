"""Recordings in the rerun viewer: as a file with our own layout, or in a viewer started for it."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

from das.bus.recording import Recording
from das.domain.errors import DasError
from das.domain.files.writing import check_writable, write_whole
from sim.recording.opening import open_recording

APPLICATION = "das-review"
CLOSING_S = 5.0


def save_view(recording_path: Path, rrd_path: Path, train: str | None = None) -> None:
    """Write a recording as a rerun file with our layout in it; `train`: which one, where it holds several.

    Raises DasError for an unusable recording, a place that cannot be written to, or where rerun is not installed.
    """
    _check_installed()
    check_writable(rrd_path)
    recording = open_recording(recording_path, train)
    with tempfile.TemporaryDirectory(prefix="das-view-") as folder:
        whole = Path(folder) / "view.rrd"
        write_view(recording, whole)
        write_whole(rrd_path, whole.read_bytes())


def open_view(recording_path: Path, train: str | None = None) -> None:
    """Show a recording in a rerun viewer and wait until it is closed; Ctrl-C closes it.

    The viewer listens on 127.0.0.1 only and sends no usage data. Raises DasError as `save_view`, and without a display.
    """
    _check_installed()
    open_recording(recording_path, train)
    _check_display()
    with tempfile.TemporaryDirectory(prefix="das-view-") as folder:
        rrd = Path(folder) / f"{recording_path.stem}.rrd"
        save_view(recording_path, rrd, train)
        run_viewer(rrd)


def viewer_command(rrd_path: Path) -> list[str]:
    """The command that shows a rerun file in a viewer of its own, on a free port of this machine only."""
    return [sys.executable, "-m", "rerun_cli", "--bind", "127.0.0.1", "--port", "auto", str(rrd_path)]


def viewer_environment() -> dict[str, str]:
    """The environment of the viewer. Setting `CI` is the only way to stop it from sending usage data in one run."""
    kept = {key: value for key, value in os.environ.items() if key != "FORCE_RERUN_ANALYTICS"}
    return {"RUST_LOG": "error", **kept, "CI": "1"}


def run_viewer(rrd_path: Path) -> None:
    """Start a viewer for a rerun file and wait until it is closed; DasError where it ends with an error."""
    viewer = subprocess.Popen(viewer_command(rrd_path), env=viewer_environment(), start_new_session=True)
    try:
        code = viewer.wait()
    finally:
        _close(viewer)
    if code != 0:
        raise DasError(f"the rerun viewer ended with code {code}")


def _close(viewer: subprocess.Popen[bytes]) -> None:
    """End the viewer if it still runs, together with the program that its starter runs: both are one process group."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        if viewer.poll() is None:
            os.killpg(viewer.pid, number)
            with contextlib.suppress(subprocess.TimeoutExpired):
                viewer.wait(CLOSING_S)


def write_view(recording: Recording, path: Path) -> None:
    """Write a rerun file with our layout; what is there is lost, and stays half written where this fails."""
    import rerun as rr

    from sim.review import entities, layout
    from sim.review.series import MapTrack
    from sim.review.story import Story

    story, way = Story.of(recording), MapTrack.of(recording)
    with rr.RecordingStream(APPLICATION, recording_id=recording.path.stem) as out:
        out.save(path, default_blueprint=layout.blueprint(story, way))
        out.send_recording_name(f"{recording.train} ({recording.path.name})")
        entities.send(out, story, way)
        out.flush()
        out.disconnect()


def _check_installed() -> None:
    missing = [name for name in ("rerun", "rerun_cli", "matplotlib") if importlib.util.find_spec(name) is None]
    if missing:
        raise DasError(f"{missing[0]} is not installed: pip install '.[view]' in the checkout")


def _check_display() -> None:
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise DasError("no display to open a viewer on: write the view to a file with --save FILE.rrd instead")
