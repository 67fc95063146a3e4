"""Writing a recording that is in its place when it is whole, and not before."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from das.bus.recorder import RecordingFile
from das.domain.clocks import Clocks
from das.domain.errors import DasError
from das.domain.files.writing import refuse_link


@contextmanager
def whole_recording(out: Path, now_ns: int) -> Iterator[RecordingFile]:
    """A recording to write to; at the end of the block it is at `out`, and if that fails nothing is.

    `now_ns` is the time at which files are attached (ns since 1970). Raises DasError where it cannot be written.
    """
    refuse_link(out)
    try:
        with tempfile.TemporaryDirectory(dir=out.parent, prefix=f".{out.name}.") as folder:
            beside = Path(folder) / out.name
            file = RecordingFile(beside, Clocks(now_ns=lambda: now_ns))
            try:
                yield file
            finally:
                file.close()
            os.replace(beside, out)
    except OSError as error:
        raise DasError(f"{out}: cannot be written ({error.strerror})") from error
