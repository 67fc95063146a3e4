"""How the readers of files refuse a bad one."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from das.domain.errors import MOST_OF_A_MESSAGE, DasError

Read = Callable[[Path], object]


def refused(read: Read, path: Path, expected: str = "") -> str:
    """Check that a file is refused in one short line that begins with its path and `expected` (a pattern)."""
    with pytest.raises(DasError, match=f"^{re.escape(str(path))}: {expected}") as caught:
        read(path)
    message = str(caught.value)
    assert message.isprintable()
    assert len(message) <= MOST_OF_A_MESSAGE
    assert "np." not in message, "a number is shown with its Python type"
    return message


def refused_with(read: Read, path: Path, text: str, change: tuple[str, str, str]) -> None:
    """Check that a file is refused after `change` replaces a text that stands in it once: old, new, pattern."""
    old, new, expected = change
    assert text.count(old) == 1
    path.write_text(text.replace(old, new))
    refused(read, path, expected)


def named(changes: list[tuple[str, str, str]]) -> list[str]:
    """The ids of the changes in a table of cases."""
    return [repr(new[:40] or f"no {old[:30]}") for old, new, _ in changes]
