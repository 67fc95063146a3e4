"""How a recording is written for the viewer, how the viewer is started and closed, and what is refused."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from das.advice.wording import Language
from das.bus import topics
from das.command_line.process import STOP_SIGNALS
from das.domain.errors import DasError
from sim.cli.review import view as view_command
from sim.drive.drive import Drive
from sim.review import view
from tests.support.recordings import write_recording


def test_a_failed_view_leaves_nothing(whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rerun")
    rrd = tmp_path / "view.rrd"
    rrd.write_bytes(b"before")

    def fail(drive: Drive, folder: Path, language: Language) -> Path:
        (folder / "view.rrd").write_bytes(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(view, "_written", fail)
    with pytest.raises(KeyboardInterrupt):
        view.save_view(Drive.read(whole), rrd)
    assert rrd.read_bytes() == b"before"
    assert [path.name for path in tmp_path.iterdir()] == ["view.rrd"]
    with pytest.raises(DasError, match="no such folder"):
        view.save_view(Drive.read(whole), tmp_path / "nowhere" / "view.rrd")
    with pytest.raises(DasError, match=r"view\.png: expected a file name that ends in \.rrd"):
        view.save_view(Drive.read(whole), tmp_path / "view.png")
    only_events = write_recording(tmp_path / "events.mcap", only=(topics.EVENT,))
    monkeypatch.undo()
    with pytest.raises(DasError, match="no positions"):
        view.save_view(Drive.read(only_events), rrd)


def test_without_rerun_or_display(whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(view.sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(DasError, match="no display"):
        view.open_view(Drive.read(whole))
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(DasError, match=r"rerun is not installed.*\[view\]"):
        view_command(whole, save=tmp_path / "view.rrd")


def test_the_viewer_leaves_the_handlers_of_signals_as_they_were(whole: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before, during = [signal.getsignal(number) for number in STOP_SIGNALS], []
    monkeypatch.setattr(view, "_check_display", lambda: None)
    monkeypatch.setattr(view, "_written", lambda *_: None)
    monkeypatch.setattr(
        view, "run_viewer", lambda *_: during.extend(signal.getsignal(number) for number in STOP_SIGNALS)
    )
    view.open_view(Drive.read(whole))
    assert len(during) == len(before)
    assert not set(during) & set(before)
    assert [signal.getsignal(number) for number in STOP_SIGNALS] == before


def test_the_viewer_is_closed_and_private(monkeypatch: pytest.MonkeyPatch) -> None:
    command = view.viewer_command(Path("drive.rrd"))
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    monkeypatch.setenv("FORCE_RERUN_ANALYTICS", "1")
    assert view.viewer_environment()["CI"] == "1"
    assert "FORCE_RERUN_ANALYTICS" not in view.viewer_environment()
    monkeypatch.setattr(view, "viewer_command", lambda file: [view.sys.executable, "-c", "raise SystemExit(3)"])
    with pytest.raises(DasError, match="code 3"):
        view.run_viewer(Path("drive.rrd"))
    started: list[view.subprocess.Popen[bytes]] = []

    class Interrupted(view.subprocess.Popen):  # type: ignore[type-arg]
        def wait(self, timeout: float | None = None) -> int:
            if not started:
                started.append(self)
                raise KeyboardInterrupt
            return super().wait(timeout)

    monkeypatch.setattr(view.subprocess, "Popen", Interrupted)
    monkeypatch.setattr(view, "viewer_command", lambda file: [view.sys.executable, "-c", "import time; time.sleep(60)"])
    with pytest.raises(KeyboardInterrupt):
        view.run_viewer(Path("drive.rrd"))
    assert started[0].poll() is not None
