"""Errors that a user can cause; the command lines print them as one line and exit with code 2."""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Iterable
from pathlib import Path
from typing import Final

MOST_OF_A_MESSAGE = 2000
MOST_OF_A_VALUE = 200
"""Longest message, and longest value or key in it (characters): a file may contain megabytes in place of a number."""
NOW_CALLED: Final = {
    "coach": ("guide", "braking"),
    "rms": ("top-speed",),
    "vector": ("speed-and-effort",),
    "guide": ("braking",),
    "--arrival": ("--running-time",),
    "--line": ("--posts",),
    "--speed": ("--pace",),
    "--connect": ("--driver-at",),
}
"""The present name for each old name of an option, key or word."""
_UNSEEN = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"})


class DasError(Exception):
    """A request of the user cannot be fulfilled. The message gives the reason in one line. It is cut after
    `MOST_OF_A_MESSAGE` characters. Control characters, which a terminal would execute, are escaped.
    """

    def __init__(self, message: str = "") -> None:
        super().__init__(seen(shortened(message, MOST_OF_A_MESSAGE)))


class InputError(DasError):
    """A value in an input is unusable.

    The message names the source (a file, or an option), the key in it, the value found and the expected one.
    """

    def __init__(self, source: str | Path, key: str, value: object, expected: str) -> None:
        self.source, self.key, self.value, self.expected = str(source), key, value, expected
        shown = f" = {_shown(value)}" if value is not MISSING else " is missing"
        super().__init__(f"{source}: {shortened(key, MOST_OF_A_VALUE)}{shown}: expected {expected}")


MISSING: Final = object()
"""The value of a missing key; None remains a valid value."""


def check_number(source: str | Path, key: str, value: float, *, positive: bool = False) -> None:
    """Raise InputError unless a number is finite and >= 0, or > 0 if it must be `positive`."""
    if not 0 <= value < math.inf or (positive and value == 0):
        raise InputError(source, key, value, f"a finite number {'> 0' if positive else '>= 0'}")


class InfeasibleError(DasError):
    """The train cannot meet the requirements of this section (climb, brake, or arrive in time)."""


class RunawayError(InfeasibleError):
    """The brakes cannot hold the train on a descent; they can from `held_from_m` on (m; infinity: unknown)."""

    def __init__(self, text: str, held_from_m: float = math.inf) -> None:
        super().__init__(text)
        self.held_from_m = held_from_m


def now_called(name: object, known: Iterable[str]) -> str | None:
    """The present name, among the known ones, for an old name; None for any other name."""
    names = set(known)
    return next((new for new in NOW_CALLED.get(str(name), ()) if new in names), None)


def one_of(known: Iterable[str], name: object, kind: str = "") -> str:
    """The expected value in the error for an unknown name: its present name if it is old, else the known names."""
    new = now_called(name, known)
    return f"{new}, as {name} is now called" if new is not None else f"one of {kind}{', '.join(known)}"


def raise_interruption(error: BaseException) -> None:
    """Raise KeyboardInterrupt if it caused an error: Ctrl-C in a call of compiled code surfaces as SystemError."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, KeyboardInterrupt):
            raise KeyboardInterrupt from error
        cause = cause.__cause__ or cause.__context__


def is_seen(text: str) -> bool:
    """Whether a text can be printed on one line: it has no control characters or line breaks."""
    return not any(unicodedata.category(character) in _UNSEEN for character in text)


def seen(text: str) -> str:
    """The text with control characters and line breaks escaped (`\\x1b`, `\\n`)."""
    if text.isprintable():
        return text
    return "".join(x if is_seen(x) else x.encode("unicode_escape").decode("ascii") for x in text)


def shortened(text: str, most: int) -> str:
    """The text if it has at most `most` characters; otherwise its beginning and its length."""
    if len(text) <= most:
        return text
    end = f"… ({len(text)} characters)"
    return text[: most - len(end)] + end


def _shown(value: object) -> str:
    try:
        return shortened(repr(value), MOST_OF_A_VALUE)
    except (RecursionError, ValueError):  # nested too deeply, or an integer with too many digits
        return f"a {type(value).__name__}"
