"""Shows a recording in the rerun viewer, or writes it as a rerun file with this project's layout.

Rerun need not be installed: modules that use it are imported when needed.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

from das.advice.wording import Language
from das.command_line.printing import busy
from das.command_line.process import interrupted_by_termination
from das.domain.errors import DasError
from das.domain.files.writing import check_writable, write_whole
from sim.drive.drive import Drive
from sim.review.scene import ReviewScene

APPLICATION: Final = "das-review"
CLOSING_S: Final = 5.0
"""Time (s) that a viewer may take to end before it is killed."""


def save_view(drive: Drive, rrd_path: Path, language: Language = Language.EN) -> None:
    """Write a recording as a rerun file, with this project's layout; the display is in the given language.

    Raises DasError if the recording has no positions or the place cannot be written to.
    """
    if rrd_path.suffix.lower() != ".rrd":
        raise DasError(f"{rrd_path}: expected a file name that ends in .rrd")
    check_writable(rrd_path, overwrite=True)
    with tempfile.TemporaryDirectory(prefix="das-view-") as folder:
        write_whole(rrd_path, _written(drive, Path(folder), language).read_bytes())


def open_view(drive: Drive, language: Language = Language.EN) -> None:
    """Show a recording in a rerun viewer and wait until the viewer is closed; Ctrl-C and SIGTERM close it as well.

    The viewer listens on 127.0.0.1 only and sends no usage data. Raises DasError as `save_view` does, and if there is
    no display.
    """
    _check_display()
    with interrupted_by_termination(), tempfile.TemporaryDirectory(prefix="das-view-") as folder:
        with busy("solving the sections of the drive …"):
            file = _written(drive, Path(folder), language)
        run_viewer(file)


def _written(drive: Drive, folder: Path, language: Language) -> Path:
    import rerun as rr

    from sim.review.rerun_drawing import blueprint, send

    scene, path = ReviewScene.of(drive), folder / f"{drive.name}.rrd"
    with rr.RecordingStream(APPLICATION, recording_id=drive.name) as out:
        out.save(path, default_blueprint=blueprint(scene))
        send(out, scene, language)
        out.flush()
    out.disconnect()
    return path


def _check_display() -> None:
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise DasError("no display is available for the viewer: write the view to a file with --save FILE.rrd instead")


def _free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def viewer_command(file: Path) -> list[str]:
    """The command that starts a viewer of a file, which listens on a free port of this machine only."""
    viewer = [sys.executable, "-m", "rerun_cli", str(file), "--bind", "127.0.0.1", "--port", str(_free_port())]
    return [*viewer, "--hide-welcome-screen"]


def viewer_environment() -> dict[str, str]:
    """The environment of the viewer. Setting `CI` is the only way to stop it from sending usage data for one run."""
    kept = {key: value for key, value in os.environ.items() if key != "FORCE_RERUN_ANALYTICS"}
    return {"RUST_LOG": "error", **kept, "CI": "1"}


def run_viewer(file: Path) -> None:
    """Start a viewer of a file and wait until it is closed; DasError if it ends with an error."""
    viewer = subprocess.Popen(viewer_command(file), env=viewer_environment(), start_new_session=True)
    try:
        code = viewer.wait()
    finally:
        close(viewer)
    if code != 0:
        raise DasError(f"the rerun viewer ended with code {code}")


def close(viewer: subprocess.Popen[bytes]) -> None:
    """End the viewer if it still runs, and its launcher, which is in the same process group."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        if viewer.poll() is None:
            os.killpg(viewer.pid, number)
            with contextlib.suppress(subprocess.TimeoutExpired):
                viewer.wait(CLOSING_S)
