"""Writing files whole, whatever stands at the path."""

from __future__ import annotations

from pathlib import Path

import pytest

from das.domain.errors import DasError
from das.domain.files import writing


def test_a_device_is_written_to_and_a_link_followed(tmp_path: Path) -> None:
    """Renaming into place would put a regular file where the device or the link was."""
    full = Path("/dev/full")
    if full.is_char_device():
        with pytest.raises(DasError, match="No space left"):
            writing.write_whole(full, b"x")
        assert full.is_char_device()
    (tmp_path / "link").symlink_to(tmp_path / "target")
    writing.write_whole(tmp_path / "link", b"x")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_bytes() == b"x"
