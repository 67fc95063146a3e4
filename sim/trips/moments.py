"""Times of records as whole ns since 1970, without the rounding of a double."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from decimal import Decimal, InvalidOperation
from pathlib import Path

from das.domain.errors import InputError
from das.domain.units import MS, NS

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_NS_PER_MICROSECOND = 1000
LATEST_NS = round(9e9 / NS)
"""The latest time (ns since 1970, year 2255) that fits in integer nanoseconds."""
PER_UNIT_NS = {"time_ms": round(MS / NS), "time_s": round(1 / NS)}


def from_number(path: Path, key: str, text: str, column: str) -> int:
    """An epoch time written as a number in the column's unit; InputError (file, key, value) otherwise."""
    unit = column.rpartition("_")[2]
    try:
        value = Decimal(text)
    except InvalidOperation:
        raise InputError(path, key, text, "a number") from None
    if not value.is_finite():
        raise InputError(path, key, text, "a finite number")
    # A figure like 1e999999999 must not become an integer of so many digits.
    if not 0 <= value <= LATEST_NS or not 0 <= (ns := value * PER_UNIT_NS[column]) <= LATEST_NS:
        raise InputError(path, key, text, f"an epoch time in {unit}")
    return round(ns)


def from_iso(path: Path, key: str, text: str) -> int:
    """An ISO 8601 time, UTC where it names no zone; InputError (file, key, value) otherwise."""
    expected = "an ISO 8601 time like 2026-11-21T08:04:00Z"
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise InputError(path, key, text, expected) from None
    moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    ns = (moment - _EPOCH) // timedelta(microseconds=1) * _NS_PER_MICROSECOND
    if not 0 <= ns <= LATEST_NS:
        raise InputError(path, key, text, f"{expected}, 1970 to 2255")
    return ns
