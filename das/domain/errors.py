"""Errors a user can cause; the command lines print them as one line and exit with code 2."""

from __future__ import annotations

from pathlib import Path


class DasError(Exception):
    """Something the user asked for cannot be done; the message is one line and says why."""


class InputError(DasError):
    """A value in an input is unusable.

    The message names the source (a file, or an option), the key in it, the value found and what was expected.
    """

    def __init__(self, source: str | Path, key: str, value: object, expected: str) -> None:
        self.source, self.key, self.value, self.expected = str(source), key, value, expected
        shown = f" = {value!r}" if value is not MISSING else " is missing"
        super().__init__(f"{source}: {key}{shown}: expected {expected}")


class _Missing:
    """Marks a key that is not there, so that None can be a value."""


MISSING = _Missing()


class InfeasibleError(DasError):
    """The train cannot do what is asked on this section (climb, brake, or arrive in time)."""
