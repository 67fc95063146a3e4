"""The node and the recorder as processes of their own, started, watched and stopped."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

from das.domain.errors import DasError

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
