"""The rerun viewer as a child process: how it is started, fed and closed."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable

from das.domain.errors import DasError

CLOSING_S = 5.0


def check_display() -> None:
    """Raise DasError where there is no screen to open a viewer on."""
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise DasError("no display to open a viewer on: write the view to a file with --save FILE.rrd instead")


def free_port() -> int:
    """A port of this machine on which nobody listens now."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def viewer_address(port: int) -> str:
    """Where a viewer on a port of this machine takes data."""
    return f"rerun+http://127.0.0.1:{port}/proxy"


def viewer_command(port: int) -> list[str]:
    """The command that starts a viewer, which listens on a port of this machine only."""
    viewer = [sys.executable, "-m", "rerun_cli", "--bind", "127.0.0.1", "--port", str(port)]
    return [*viewer, "--hide-welcome-screen", "--expect-data-soon"]


def viewer_environment() -> dict[str, str]:
    """The environment of the viewer. Setting `CI` is the only way to stop it from sending usage data in one run."""
    kept = {key: value for key, value in os.environ.items() if key != "FORCE_RERUN_ANALYTICS"}
    return {"RUST_LOG": "error", **kept, "CI": "1"}


def run_viewer(port: int, feed: Callable[[], None]) -> None:
    """Start a viewer, feed it beside, and wait until it is closed; DasError where it ends with an error.

    The feeding ends with the viewer, finished or not.
    """
    viewer = subprocess.Popen(viewer_command(port), env=viewer_environment(), start_new_session=True)
    try:
        threading.Thread(target=feed, daemon=True).start()
        code = viewer.wait()
    finally:
        close(viewer)
    if code != 0:
        raise DasError(f"the rerun viewer ended with code {code}")


def close(viewer: subprocess.Popen[bytes]) -> None:
    """End the viewer if it still runs, together with the program that its starter runs: both are one process group."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        if viewer.poll() is None:
            os.killpg(viewer.pid, number)
            with contextlib.suppress(subprocess.TimeoutExpired):
                viewer.wait(CLOSING_S)
