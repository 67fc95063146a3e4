"""The node and the recorder of a run as processes: where each listens, how it is started, watched and stopped."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from das.bus.access import Role
from das.bus.config import BusFolder
from das.bus.session import Bus, endpoint, free_ports
from das.bus.topics import ADVICE, CONTROLS, RECORDER, STATUS
from das.domain.errors import DasError
from sim.recording.metadata import NODE_ARGUMENTS

STOP_TIMEOUT_S = 30.0


class Process:
    """A child process running a module of ours; use with `with`. Its words go to a file and into errors."""

    def __init__(self, name: str, module: str, arguments: Sequence[str]) -> None:
        self.name = name
        self._log = tempfile.NamedTemporaryFile(prefix=f"{name}-", suffix=".log", delete=False)  # noqa: SIM115
        # A session of its own: Ctrl-C comes to us alone, and we stop the children in order.
        self._child = subprocess.Popen(
            [sys.executable, "-m", module, "--with-parent", str(os.getpid()), *arguments],
            stdin=subprocess.DEVNULL,
            stdout=self._log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )

    def __enter__(self) -> Process:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()
        self._log.close()
        Path(self._log.name).unlink(missing_ok=True)

    def check(self) -> None:
        """Raise DasError with its last words if the process has ended."""
        code = self._child.poll()
        if code is not None:
            if code < 0:
                raise DasError(f"the {self.name} was killed by {signal.Signals(-code).name}")
            raise DasError(f"the {self.name} ended: {self._last_words()}")

    def kill(self) -> None:
        """End it with SIGKILL, as a crash would."""
        self._child.kill()
        self._child.wait()

    def stop(self) -> int:
        """End it with SIGTERM, after a while with SIGKILL; returns its exit code."""
        if self._child.poll() is None:
            self._child.send_signal(signal.SIGTERM)
            try:
                self._child.wait(STOP_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                self._child.kill()
        return self._child.wait()

    def finish(self) -> None:
        """End it with SIGTERM; raise DasError with its last words if it did not end well."""
        if self.stop() != 0:
            self.check()

    def _last_words(self) -> str:
        lines = Path(self._log.name).read_text(errors="replace").strip().splitlines()
        return lines[-1].removeprefix("error: ") if lines else "it said nothing"


@dataclass(frozen=True, kw_only=True)
class Processes:
    """How node and recorder of a run are started.

    `driver_at` is the endpoint where an external driver finds the simulator; None where there is no such driver. With a
    bus folder the bus file says where, and any text will do.
    """

    train: str
    node_arguments: tuple[str, ...]
    out: Path
    metadata: dict[str, str]
    start_ns: int
    attachments: tuple[Path, ...] = ()
    bus: BusFolder | None = None
    driver_at: str | None = None


class Stations:
    """The places on the bus of simulator, node and recorder: free ports of this machine, or those of a bus folder."""

    def __init__(self, processes: Processes) -> None:
        self._processes = processes
        self._ports = [endpoint(port) for port in free_ports(3)]
        if processes.driver_at is not None:
            self._ports[0] = processes.driver_at

    def open_bus(self) -> Bus:
        """Open the simulator's own session, which hears what node, recorder and an external driver say."""
        driver = () if self._processes.driver_at is None else (CONTROLS,)
        hear, files = (ADVICE, STATUS, RECORDER, *driver), self._processes.bus
        if files is not None:
            return Bus(self._processes.train, hear=hear, file=files.file(Role.SIMULATOR))
        return Bus(self._processes.train, listen=self._ports[0], connect=self._ports[1:], hear=hear)

    def start_recorder(self) -> Process:
        """Start the recorder of the run."""
        processes = self._processes
        arguments = [
            *self._place(1, Role.RECORDER),
            "--out",
            str(processes.out),
            "--overwrite",
            "--metadata",
            json.dumps({**processes.metadata, NODE_ARGUMENTS: json.dumps(processes.node_arguments)}),
        ]
        arguments += ["--start-ns", str(processes.start_ns)]
        for path in processes.attachments:
            arguments += ["--attach", str(path)]
        return Process("recorder", "das.recorder", arguments)

    def start_node(self) -> Process:
        """Start a node that goes by the simulation's clock."""
        return Process(
            "node", "das.node", [*self._place(2, Role.NODE), "--clock", "bus", *self._processes.node_arguments]
        )

    def _place(self, own: int, role: Role) -> Sequence[str]:
        """Train and endpoints of the process that listens on port `own`, or its role's bus file."""
        if self._processes.bus is not None:
            return ["--train", self._processes.train, *self._processes.bus.file(role).arguments()]
        others = [port for i, port in enumerate(self._ports) if i != own]
        connect = [word for port in others for word in ("--connect", port)]
        return ["--train", self._processes.train, "--listen", self._ports[own], *connect]
