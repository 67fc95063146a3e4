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


@contextmanager
def whole_recording(out: Path, now_ns: int) -> Iterator[RecordingFile]:
    """A recording to write to; at the end of the block it is at `out`, and if that fails nothing is.

    `now_ns` is the time at which files are attached (ns since 1970). Raises DasError where it cannot be written.
    """
    place = out.resolve()
    try:
        with tempfile.TemporaryDirectory(dir=place.parent, prefix=f".{place.name}.") as folder:
            beside = Path(folder) / place.name
            file = RecordingFile(beside, Clocks(now_ns=lambda: now_ns))
            try:
                yield file
            finally:
                file.close()
            os.replace(beside, place)
    except OSError as error:
        raise DasError(f"{out}: cannot be written ({error.strerror})") from error
