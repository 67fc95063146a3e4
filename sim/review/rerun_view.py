"""Recordings in the rerun viewer: as a file with our own layout, or in a viewer started for it."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from enum import Enum, auto
from pathlib import Path
from typing import TYPE_CHECKING

from das.bus.recording import Recording
from das.domain.errors import DasError
from das.domain.files.writing import check_writable, write_whole

if TYPE_CHECKING:
    import rerun as rr

    from sim.accounts.account import Account

APPLICATION = "das-review"
CLOSING_S = 5.0


def save_view(recording: Recording, rrd_path: Path, *, with_map: bool = False) -> None:
    """Write a recording as a rerun file with our layout in it.

    Raises DasError for a recording without positions, a place that cannot be written to, or where rerun is not
    installed.
    """
    _check_installed()
    check_writable(rrd_path)
    with tempfile.TemporaryDirectory(prefix="das-view-") as folder:
        whole = Path(folder) / "view.rrd"
        write_view(recording, whole, with_map=with_map)
        write_whole(rrd_path, whole.read_bytes())


def open_view(recording: Recording, *, with_map: bool = False) -> None:
    """Show a recording in a rerun viewer and wait until it is closed; Ctrl-C closes it.

    The viewer opens with what was recorded; where the energy went is sent to it as soon as that is found. It listens on
    127.0.0.1 only and sends no usage data. Raises DasError as `save_view`, and without a display.
    """
    _check_installed()
    _check_display()
    with tempfile.TemporaryDirectory(prefix="das-view-") as folder:
        rrd, port = Path(folder) / f"{recording.path.stem}.rrd", free_port()
        write_view(recording, rrd, with_map=with_map, account=Later.SENT)
        threading.Thread(target=_send_later, args=(recording, port), daemon=True).start()
        run_viewer(rrd, port)


def _send_later(recording: Recording, port: int) -> None:
    """Find where the energy went, and send it to the viewer that listens on a port of this machine."""
    import rerun as rr

    found = _account_of(recording)
    with rr.RecordingStream(APPLICATION, recording_id=recording.path.stem, send_properties=False) as out:
        out.connect_grpc(f"rerun+http://127.0.0.1:{port}/proxy")
        _send_account(out, recording, found)
        out.flush()


def free_port() -> int:
    """A port of this machine on which nobody listens now."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def viewer_command(rrd_path: Path, port: int) -> list[str]:
    """The command that shows a rerun file in a viewer of its own, which listens on a port of this machine only."""
    return [sys.executable, "-m", "rerun_cli", "--bind", "127.0.0.1", "--port", str(port), str(rrd_path)]


def viewer_environment() -> dict[str, str]:
    """The environment of the viewer. Setting `CI` is the only way to stop it from sending usage data in one run."""
    kept = {key: value for key, value in os.environ.items() if key != "FORCE_RERUN_ANALYTICS"}
    return {"RUST_LOG": "error", **kept, "CI": "1"}


def run_viewer(rrd_path: Path, port: int) -> None:
    """Start a viewer for a rerun file and wait until it is closed; DasError where it ends with an error."""
    viewer = subprocess.Popen(viewer_command(rrd_path, port), env=viewer_environment(), start_new_session=True)
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


class Later(Enum):
    """When the account of the energy comes into a view: with it, or by itself when it is found."""

    WRITTEN = auto()
    SENT = auto()


def write_view(recording: Recording, path: Path, *, with_map: bool = False, account: Later = Later.WRITTEN) -> None:
    """Write a rerun file with our layout; what is there is lost, and stays half written where this fails."""
    import rerun as rr

    from sim.events.chronicle import Chronicle
    from sim.review import entities, layout
    from sim.review.series import MapTrack
    from sim.review.story import Story

    story, way = Story.of(recording), MapTrack.of(recording)
    with rr.RecordingStream(APPLICATION, recording_id=recording.path.stem) as out:
        out.save(path, default_blueprint=layout.blueprint(story, way, with_map=with_map))
        out.send_recording_name(f"{recording.train} ({recording.path.name})")
        entities.send(out, story, Chronicle.of(recording), way, with_map=with_map)
        if account is Later.WRITTEN:
            _send_account(out, recording, _account_of(recording))
        out.flush()
        out.disconnect()


def _account_of(recording: Recording) -> Account | str:
    """The account of a recorded drive, or why there is none."""
    from sim.accounts.account import account_of

    try:
        return account_of(recording)
    except DasError as error:
        return str(error).removeprefix(f"{recording.path}: ")


def _send_account(out: rr.RecordingStream, recording: Recording, found: Account | str) -> None:
    from sim.events.clock import DriveClock
    from sim.review.account_view import account_view, send_account, send_no_account
    from sim.review.series import DrivenCourse
    from sim.review.timelines import Timelines

    if isinstance(found, str):
        send_no_account(out, f"Where the energy went is not known: {found}.")
        return
    trip = DrivenCourse.of(recording)
    lines = Timelines(trip=trip, clock=DriveClock.of(recording, int(trip.time_ns[0])))
    send_account(out, lines, account_view(found))


def _check_installed() -> None:
    missing = [name for name in ("rerun", "rerun_cli") if importlib.util.find_spec(name) is None]
    if missing:
        raise DasError(f"{missing[0]} is not installed: pip install '.[view]' in the checkout")


def _check_display() -> None:
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise DasError("no display to open a viewer on: write the view to a file with --save FILE.rrd instead")
