"""Recordings in the rerun viewer: as a file with our own layout, or in a viewer started for it."""

from __future__ import annotations

import importlib.util
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from das.bus.recording import Recording
from das.command_line.running import interrupt_on_termination
from das.domain.errors import DasError
from das.domain.files.writing import check_writable, write_whole
from sim.review.viewer import check_display, free_port, run_viewer, viewer_address

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb

    from sim.drive.drive import Drive
    from sim.review.story import Story

APPLICATION = "das-review"


def save_view(recording: Recording, rrd_path: Path, *, with_map: bool = False) -> None:
    """Write a recording as a rerun file with our layout in it, and with where the energy went.

    Raises DasError for a recording without positions, a place that cannot be written to, or where rerun is not
    installed.
    """
    _check_installed()
    check_writable(rrd_path, overwrite=True)
    with tempfile.TemporaryDirectory(prefix="das-view-") as folder:
        whole = Path(folder) / "view.rrd"
        write_view(recording, whole, with_map=with_map)
        write_whole(rrd_path, whole.read_bytes())


def write_view(recording: Recording, path: Path, *, with_map: bool = False) -> None:
    """Write a rerun file with our layout; what is there is lost, and stays half written where this fails."""
    shown = ReviewView.of(recording, with_map=with_map)
    with shown.stream() as out:
        out.save(path, default_blueprint=shown.blueprint())
        shown.send(out)
        shown.send_account(out)
        out.flush()
        out.disconnect()


def open_view(recording: Recording, *, with_map: bool = False) -> None:
    """Show a recording in a rerun viewer and wait until it is closed; Ctrl-C and a request to end close it.

    The viewer opens with what was recorded; where the energy went follows as soon as that is found. It listens on
    127.0.0.1 only and sends no usage data. Raises DasError as `save_view`, and without a display.
    """
    _check_installed()
    check_display()
    shown, port = ReviewView.of(recording, with_map=with_map), free_port()
    interrupt_on_termination()
    run_viewer(port, lambda: feed_viewer(shown, port))


def feed_viewer(shown: ReviewView, port: int) -> None:
    """Send a view to the viewer that listens on a port of this machine: what was recorded, then the account.

    A viewer that is closed meanwhile is no error; rerun's own words about it are kept from the terminal.
    """
    os.environ.setdefault("RUST_LOG", "off")  # read when rerun is imported
    with shown.stream() as out:
        out.connect_grpc(viewer_address(port), default_blueprint=shown.blueprint())
        shown.send(out)
        out.flush()
        shown.send_account(out)
        out.flush()


@dataclass(frozen=True, kw_only=True)
class ReviewView:
    """What a view of a recording shows, found once."""

    drive: Drive
    story: Story
    with_map: bool

    @classmethod
    def of(cls, recording: Recording, *, with_map: bool = False) -> ReviewView:
        """The view of a recording; DasError for one without positions."""
        from sim.drive.drive import Drive
        from sim.review.story import Story

        drive = Drive(source=recording)
        return cls(drive=drive, story=Story.of(drive), with_map=with_map)

    def stream(self) -> rr.RecordingStream:
        """A stream to write or send the view to."""
        import rerun as rr

        return rr.RecordingStream(APPLICATION, recording_id=self.drive.name)

    def blueprint(self) -> rrb.Blueprint:
        """The layout of the view."""
        from sim.review import layout

        return layout.blueprint(self.story, with_map=self.with_map)

    def send(self, out: rr.RecordingStream) -> None:
        """Send all that was recorded."""
        from sim.review import entities

        out.send_recording_name(f"{self.drive.recording.train} ({self.drive.recording.path.name})")
        entities.send(out, self.story, with_map=self.with_map)

    def send_account(self, out: rr.RecordingStream) -> None:
        """Find where the energy went, and send that, or why it is not known."""
        from sim.review.account_view import AccountView
        from sim.review.entities import send_account, send_no_account
        from sim.review.timelines import Timelines

        lines = Timelines(trip=self.story.trip, clock=self.story.clock)
        if self.drive.account is None:
            send_no_account(out, f"Where the energy went is not known: {self.drive.why_no_account}.")
        else:
            send_account(out, lines, AccountView.of(self.drive.account))


def _check_installed() -> None:
    missing = [name for name in ("rerun", "rerun_cli") if importlib.util.find_spec(name) is None]
    if missing:
        raise DasError(f"{missing[0]} is not installed: pip install '.[view]' in the checkout")
