"""What is wanted of a timetable feed: groups of options of `das-precompute journey import`."""

from __future__ import annotations

import datetime
import re
from dataclasses import dataclass
from typing import Annotated

import typer

from das.domain.errors import DasError

LONGEST_S = 3600.0
"""Longest dwell and tolerance (s) that are accepted."""
CLOCK = re.compile(r"\s*(\d{1,3}):([0-5]?\d):([0-5]?\d)\s*")
"""A time of the service day, which goes on after 24:00:00."""


def clock_s(match: re.Match[str]) -> float:
    """The time (s) of a match of `CLOCK`."""
    hours, minutes, seconds = (int(part) for part in match.groups())
    return 3600.0 * hours + 60.0 * minutes + seconds


def parsed_clock_s(text: str) -> float:
    """The time of the service day (s) that `--at` names, like 07:30; DasError for anything else."""
    match = CLOCK.fullmatch(text if text.count(":") > 1 else f"{text}:00")
    if match is None:
        raise DasError(f"--at {text}: expected a time like 07:30")
    return clock_s(match)


def parsed_day(text: str) -> datetime.date:
    """The day that `--date` names; DasError for anything else."""
    try:
        return datetime.date.fromisoformat(text)
    except ValueError:
        raise DasError(f"--date {text}: expected a day like 2026-11-26") from None


@dataclass(frozen=True, kw_only=True)
class TripChoice:
    """Which trip: by its id, or by two stops and the earliest departure (s after midnight); `day` must be served.

    With an id, the two stops cut the trip, and a trip that does not run at that time or on that day is refused.
    """

    trip: Annotated[str | None, typer.Option(metavar="ID", help="The trip_id, or a number that only one trip has.")] = (
        None
    )
    from_stop: Annotated[
        str | None, typer.Option("--from", metavar="STOP", help="Where the journey begins: name or stop_id.")
    ] = None
    to_stop: Annotated[
        str | None, typer.Option("--to", metavar="STOP", help="Where the journey ends: name or stop_id.")
    ] = None
    at_s: Annotated[
        float | None,
        typer.Option(
            "--at",
            parser=parsed_clock_s,
            metavar="HH:MM",
            help="The first train from then on; with --trip, its first run from then on.",
        ),
    ] = None
    day: Annotated[
        datetime.date | None,
        typer.Option(
            "--date",
            parser=parsed_day,
            metavar="YYYY-MM-DD",
            help="Only trips that run on this day, after midnight also those of the day before [default: on any day].",
        ),
    ] = None


@dataclass(frozen=True, kw_only=True)
class TimesRead:
    """How the times of a feed become windows. Raises DasError for an impossible time.

    The train may be `rounded_s` later than the timetable; None: after a departure by `ROUNDED_S` of
    `precompute.journey_import` if all times are whole minutes, never at the last stop.
    """

    dwell_s: Annotated[
        float,
        typer.Option("--dwell", metavar="S", help="Least dwell (s) where the feed has arrival = departure."),
    ] = 30.0
    rounded_s: Annotated[
        float | None,
        typer.Option(
            "--tolerance",
            metavar="S",
            help="How much later (s) than the feed says the train may be [default: 59 at departures if all times are "
            "whole minutes, else 0].",
        ),
    ] = None

    def __post_init__(self) -> None:
        for option, value_s in (("--dwell", self.dwell_s), ("--tolerance", self.rounded_s)):
            if value_s is not None and not 0 <= value_s <= LONGEST_S:
                raise DasError(f"{option} {value_s:g}: expected seconds from 0 to {LONGEST_S:g}")
