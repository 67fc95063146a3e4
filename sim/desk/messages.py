"""What the page and the desk's server say to each other, and what the server is given at its start.

Everything is JSON. A message that does not fit these types is refused (`heard`).
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Final

import msgspec

from das.domain.errors import DasError

VERSION: Final = 1
"""Version of the protocol; `hello` states it."""
LARGEST_BYTES: Final = 4096
"""Longest message of a page (bytes); the longest that our own page sends has 120."""
Count = Annotated[int, msgspec.Meta(ge=0, le=2**53)]
WallMs = Annotated[float, msgspec.Meta(ge=0, le=4e12)]
"""A moment by the browser's wall clock (ms since 1970)."""


class Lever(msgspec.Struct, tag_field="t", tag="lever", frozen=True):
    """A new setting of the controller: its running number, the setting (−1 … 1), when, by what, after which look."""

    k: Count
    ratio: Annotated[float, msgspec.Meta(ge=-1, le=1)]
    at: WallMs
    by: Annotated[str, msgspec.Meta(max_length=16)]
    look: Count = 0


class FrameDrawn(msgspec.Struct, tag_field="t", tag="drawn", frozen=True):
    """The page has drawn a frame since its last message, the newest with this look: somebody can see the desk."""

    look: Count


class Ready(msgspec.Struct, tag_field="t", tag="ready", frozen=True):
    """The person is ready to drive."""


class Marked(msgspec.Struct, tag_field="t", tag="mark", frozen=True):
    """The person marked this moment, or changed a setting of the page, which `text` names."""

    at: WallMs
    look: Count = 0
    text: Annotated[str, msgspec.Meta(max_length=40)] = ""


Said = Lever | FrameDrawn | Ready | Marked
_decoder: Final = msgspec.json.Decoder(Said)
_encoder: Final = msgspec.json.Encoder()


def heard(text: str) -> Said | None:
    """The message of a page; None for what is none: no JSON, a wrong type, a number out of range.

    Our messages have no depth. A deep text must not reach the decoder, because it would recurse.
    """
    if text.count("{") != 1 or "[" in text:
        return None
    try:
        said: Said = _decoder.decode(text)
    except (msgspec.MsgspecError, UnicodeError):
        return None
    return said


def encoded(message: Any) -> str:
    """A message to the page as JSON; NaN and infinity become null, because JSON has no words for them."""
    return _encoder.encode(message).decode()


def plain(value: Any) -> Any:
    """A number for JSON: None for NaN and infinity."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


GIVEN: Final = "DAS_DESK"
"""The environment variable that has what the server is given: other users of the machine cannot read it."""


class DeskGiven(msgspec.Struct, frozen=True, kw_only=True):
    """What the server of a run is given: the door (a listening socket), the token, the day, and the desk's looks.

    `connect` are the endpoints of simulator and recorder, unless `bus` names the desk's bus file. `notches` is the
    number of steps of the controller each way (0: none, whole percents). `punctuality`: the page says how late the
    train is.
    """

    door: int
    token: str
    scenario: str
    train: str
    language: str
    journey: str | None = None
    connect: tuple[str, ...] = ()
    bus: str | None = None
    insecure_bus: bool = False
    notches: int = 10
    punctuality: bool = True


def given_of(text: str) -> DeskGiven:
    """The settings that `das-sim` gave the server; DasError if there are none."""
    try:
        return msgspec.json.decode(text, type=DeskGiven)
    except msgspec.MsgspecError as error:
        raise DasError(f"the desk's server is started by das-sim desk, not by itself ({error})") from error


def given_text(given: DeskGiven) -> str:
    """The settings as text."""
    return _encoder.encode(given).decode()
