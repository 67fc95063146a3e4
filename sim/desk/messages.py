"""What the page and the desk's server say to each other, and what the server is given at its start.

Everything is JSON. A message that does not fit these types is refused (`heard`).
"""

from __future__ import annotations

from typing import Annotated, Any, Final

import msgspec

from das.bus.recording import Recording
from das.domain.errors import DasError
from sim.options import MOST_NOTCHES

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
    """A message, or what the server is given, as JSON; NaN and infinity become null, for which JSON has no words."""
    return _encoder.encode(message).decode()


GIVEN: Final = "DAS_DESK"
"""The environment variable that has what the server is given: other users of the machine cannot read it."""


class PageSettings(msgspec.Struct, frozen=True, kw_only=True):
    """What an experimenter sets on the page, and the recording states.

    `notches` is the number of steps of the controller each way (0: none, whole percents). `punctuality`: the page says
    how late the train is.
    """

    notches: Annotated[int, msgspec.Meta(ge=0, le=MOST_NOTCHES)] = 10
    punctuality: bool = True


SETTINGS_KEY: Final = "desk"
"""The key of a recording's metadata under which its page's settings are, as JSON."""


def recorded_settings(recording: Recording) -> PageSettings:
    """The page's settings that a recording states; the defaults without a desk. DasError for any other text."""
    text = recording.metadata.get("run", {}).get(SETTINGS_KEY, "{}")
    try:
        return msgspec.json.decode(text, type=PageSettings)
    except msgspec.MsgspecError as error:
        expected = f"the settings of a desk's page ({error})"
        raise DasError(f"{recording.path}: metadata {SETTINGS_KEY} = {text!r}: expected {expected}") from error


class DeskGiven(msgspec.Struct, frozen=True, kw_only=True):
    """What the server of a run is given: the door (a listening socket), the token, the day, and the page's settings.

    `connect` are the endpoints of simulator and recorder, unless `bus` names the desk's bus file.
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
    page: PageSettings = PageSettings()


def given_of(text: str) -> DeskGiven:
    """The settings that `das-sim` gave the server; DasError if there are none."""
    try:
        return msgspec.json.decode(text, type=DeskGiven)
    except msgspec.MsgspecError as error:
        raise DasError(f"the desk's server is started by das-sim desk, not by itself ({error})") from error
