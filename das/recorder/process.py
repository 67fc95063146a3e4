"""The process das-record: it records every message on the bus about a train in one MCAP file, until it is stopped."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from das import __version__
from das.bus.config import BusFile, bus_options
from das.bus.recorder import Recorder, RecordingFile
from das.bus.sealing import MAGIC
from das.bus.session import Bus, check_endpoint
from das.bus.topics import RECORDED, RECORDER, Received
from das.command_line.options import NODE_ENDPOINT, RECORDER_ENDPOINT
from das.command_line.printing import say
from das.command_line.process import StopFlag
from das.domain.clocks import WALL, Clocks
from das.domain.errors import DasError
from das.domain.files.writing import new_file
from das.recorder.command import RecorderOptions

MOST_WAITING = 20_000
"""Largest number of messages that may wait while the disk is slow; of more, the oldest are lost and counted."""
LISTENS_S = 0.1
"""Longest time (s) for which the recorder waits for a message before it checks its clock."""
SILENT_S = 10.0
"""Time (s) after which a bus without messages is called silent."""
COUNTED_EVERY_S = 60.0
"""Interval (s) at which the recorder reports its number of messages."""


class LifeSigns:
    """Reports the state of a recording on standard error; a full disk or a closed terminal never delays it."""

    def __init__(self, name: str, clocks: Clocks = WALL, tell: Callable[[str], None] = say) -> None:
        self._name, self._seconds, self._tell = name, clocks.seconds, tell
        self._heard: set[tuple[str, str]] = set()
        self._last_s = self._counted_s = self._seconds()
        self._silent = False

    def say(self, text: str) -> None:
        """Print a message about this recorder."""
        self._tell(f"das-record {self._name}: {text}")

    def take(self, received: Received) -> None:
        """Count a message; the first one of each sender is reported."""
        self._last_s, self._silent = self._seconds(), False
        sender = received.topic.publisher, received.source
        if sender not in self._heard:
            self._heard.add(sender)
            self.say(f"hears the {received.topic.publisher} ({received.topic.name})")

    def look(self, messages: int) -> None:
        """Report the number of recorded messages, if due, and the absence of new ones."""
        now_s = self._seconds()
        if not self._silent and now_s - self._last_s >= SILENT_S:
            self._silent = True
            why = "" if self._heard else ": is every process that sends running, and named by --connect?"
            self.say(f"nothing received for {SILENT_S:.0f} s{why}")
        if now_s - self._counted_s >= COUNTED_EVERY_S:
            self._counted_s = now_s
            self.say(f"{messages} messages so far")


def record(options: RecorderOptions) -> None:
    """Record until asked to stop. Raises DasError for unusable options and if the file cannot be written."""
    bus, where = _bus(options)
    out = options.out or Path(f"{options.place.train}.mcap")
    try:
        _record(options, bus, where, out, StopFlag(with_parent=options.with_parent))
    except OSError as error:
        raise DasError(f"{out}: cannot be written ({error.strerror})") from error


def _bus(options: RecorderOptions) -> tuple[Bus, str]:
    """The bus to record, not opened yet, and the recorder's endpoints, in words."""
    place = options.place
    file: BusFile | None = bus_options(place.bus, place.insecure_bus, place.listen, place.connect)
    listen = None if file else check_endpoint(RECORDER_ENDPOINT if place.listen is None else place.listen)
    alone = file is not None or place.listen is not None
    connect = [check_endpoint(one) for one in place.connect or ([] if alone else [NODE_ENDPOINT])]
    bus = Bus(place.train, listen=listen, connect=connect, hear=RECORDED, file=file, waiting=MOST_WAITING)
    listens = f"listening on {listen}, connecting to {' and '.join(connect) or 'nobody'}"
    return bus, f"on the bus of {file.path}" if file else listens


def _record(options: RecorderOptions, made: Bus, where: str, out: Path, stop: StopFlag) -> None:
    attachments = [(path, _content(path)) for path in options.attach or ()]
    metadata = _metadata(options)
    # A program that starts a recorder reports to the user itself.
    signs = LifeSigns(options.place.train, tell=say if options.with_parent is None else lambda _text: None)
    with made as bus, closing(RecordingFile(_place(out, options))) as file:
        for path, content in attachments:
            file.add_attachment(path.name, "application/octet-stream", content)
        file.add_metadata("run", metadata)
        file.flush()
        signs.say(f"{where}, recording to {file.path} until Ctrl-C")
        recorder = Recorder(bus, file, options.start_ns)
        while not stop.stopped:
            received = bus.receive(LISTENS_S)
            if received is not None:
                recorder.take(received)
                signs.take(received)
            file.flush_if_due()
            recorder.report_if_due()
            signs.look(file.messages)
        while (received := bus.receive(0)) is not None:
            recorder.take(received)
        if bus.dropped:
            file.add_metadata(RECORDER.name, {"dropped": str(bus.dropped)})
            print(f"{bus.dropped} messages were not recorded: too many at once", file=sys.stderr)
    signs.say(f"{file.messages} messages in {file.path}")


def _place(path: Path, options: RecorderOptions) -> Path:
    """The file to record into: a recorder that is restarted keeps the earlier recording and takes a new name."""
    if options.overwrite or (path.exists() and not path.is_file()):
        return path
    free = new_file(path, MAGIC)
    if free != path:
        say(f"{path} exists already: recording to {free}")
    return free


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise DasError(f"{path}: cannot be read ({error.strerror})") from error


def _metadata(options: RecorderOptions) -> dict[str, str]:
    """The metadata that the user gave; by default the kind (session), this version and the train."""
    if options.metadata is None:
        return {"kind": "session", "version": __version__, "train": options.place.train}
    try:
        found = json.loads(options.metadata)
    except ValueError as error:
        raise DasError(f"--metadata: not valid JSON ({error})") from error
    if not isinstance(found, dict) or not all(isinstance(value, str) for value in found.values()):
        raise DasError("--metadata: expected a JSON object of texts")
    return found
