"""Messages between the page and the desk's server, and the settings passed to the server at its start.

All are JSON. A message that does not match these types is rejected (`heard`).
"""

from __future__ import annotations

import os
import re
from typing import Annotated, Any, Final, TypeVar

import msgspec

from das.bus.recording import Recording
from das.domain.errors import DasError
from sim.options import MOST_NOTCHES

LARGEST_BYTES: Final = 4096
"""Longest message accepted from a page (bytes). An answer to a questionnaire has up to 500 characters; all other
messages of the desk's own page are shorter."""
Count = Annotated[int, msgspec.Meta(ge=0, le=2**53)]
WallMs = Annotated[float, msgspec.Meta(ge=0, le=4e12)]
"""A time on the browser's wall clock (ms since 1970)."""


class Lever(msgspec.Struct, tag_field="t", tag="lever", frozen=True):
    """A new setting of the controller: sequence number, setting (−1 … 1), time, input device, and the number of the
    last view of the cab that the page had received."""

    k: Count
    ratio: Annotated[float, msgspec.Meta(ge=-1, le=1)]
    at: WallMs
    by: Annotated[str, msgspec.Meta(max_length=16)]
    look: Count = 0


class FrameDrawn(msgspec.Struct, tag_field="t", tag="drawn", frozen=True):
    """Report that the page is visible: it has drawn a frame since its last report. `look` is the number of the newest
    view drawn."""

    look: Count


class Ready(msgspec.Struct, tag_field="t", tag="ready", frozen=True):
    """Report that the person is ready to drive."""


class Marked(msgspec.Struct, tag_field="t", tag="mark", frozen=True):
    """A mark that the person set, or a changed setting of the page, named in `text`."""

    at: WallMs
    look: Count = 0
    text: Annotated[str, msgspec.Meta(max_length=40)] = ""


StepId = Annotated[str, msgspec.Meta(max_length=80)]


class Answered(msgspec.Struct, tag_field="t", tag="answer", frozen=True):
    """An answer to an item of the present step of a session."""

    step: StepId
    item: Annotated[str, msgspec.Meta(max_length=40)]
    value: Annotated[str, msgspec.Meta(max_length=500)]
    at: WallMs


class WentOn(msgspec.Struct, tag_field="t", tag="next", frozen=True):
    """The request for the step after the present one."""

    step: StepId
    at: WallMs


class Stopped(msgspec.Struct, tag_field="t", tag="stop", frozen=True):
    """The participant's decision, already confirmed, to stop taking part."""

    at: WallMs


class Acted(msgspec.Struct, tag_field="t", tag="act", frozen=True):
    """A response in a secondary task: the number of the request answered (from 1; 0: no request was shown), and when
    that request was drawn."""

    what: Annotated[str, msgspec.Meta(max_length=16)]
    at: WallMs
    look: Count = 0
    number: Count = 0
    shown: WallMs = 0


Said = Lever | FrameDrawn | Ready | Marked | Answered | WentOn | Stopped | Acted
_QUOTED: Final = re.compile(r'"(?:[^"\\]|\\.)*"')
_decoder: Final = msgspec.json.Decoder(Said)
_encoder: Final = msgspec.json.Encoder()


def heard(text: str, decoder: msgspec.json.Decoder[Any] = _decoder) -> Any | None:
    """The decoded message of a page; None if it is invalid: not JSON, a wrong type, a number out of range.

    Valid messages are not nested. A deeply nested text must not reach the decoder, which would recurse.
    """
    bare = _QUOTED.sub("", text)  # a person's answer may contain brackets
    if bare.count("{") != 1 or "[" in bare:
        return None
    try:
        return decoder.decode(text)
    except (msgspec.MsgspecError, UnicodeError):
        return None


def encoded(message: Any) -> str:
    """A message, or the server's settings, as JSON; NaN and infinity, which JSON does not have, become null."""
    return _encoder.encode(message).decode()


GIVEN: Final = "DAS_DESK"
"""The environment variable with the server's settings; other users of the machine cannot read it."""


class PageSettings(msgspec.Struct, frozen=True, kw_only=True):
    """The page's settings, chosen by the experimenter and stated in the recording.

    `notches` is the number of steps of the controller in each direction (0: none, whole percents). `punctuality`: the
    page shows the delay of the train.
    """

    notches: Annotated[int, msgspec.Meta(ge=0, le=MOST_NOTCHES)] = 10
    punctuality: bool = True

    @property
    def metadata(self) -> dict[str, str]:
        """The settings as an entry of a recording's metadata."""
        return {SETTINGS_KEY: encoded(self)}


SETTINGS_KEY: Final = "desk"
"""The key of the page's settings (JSON) in a recording's metadata."""


def recorded_settings(recording: Recording) -> PageSettings:
    """The page's settings stated in a recording; the defaults without a desk. DasError for an invalid text."""
    text = recording.metadata.get("run", {}).get(SETTINGS_KEY, "{}")
    try:
        return msgspec.json.decode(text, type=PageSettings)
    except msgspec.MsgspecError as error:
        expected = f"the settings of a desk's page ({error})"
        raise DasError(f"{recording.path}: metadata {SETTINGS_KEY} = {text!r}: expected {expected}") from error


class DeskBus(msgspec.Struct, frozen=True, kw_only=True):
    """The desk's place on the bus: its train, and the endpoints of simulator and recorder, or the desk's bus file.

    `lsl` is the name in the drive's streams over LSL; without one, nothing is streamed.
    """

    train: str
    connect: tuple[str, ...] = ()
    file: str | None = None
    insecure: bool = False
    lsl: str = ""


class DeskGiven(msgspec.Struct, frozen=True, kw_only=True):
    """The settings passed to the server of a run: door (a listening socket), token, scenario, bus, page settings."""

    door: int
    token: str
    scenario: str
    language: str
    bus: DeskBus
    journey: str | None = None
    page: PageSettings = PageSettings()


Given = TypeVar("Given", bound=msgspec.Struct)


def given_to(variable: str, kind: type[Given], starter: str) -> Given:
    """The settings that `starter` has passed to this process in an environment variable; DasError if there are none."""
    try:
        return msgspec.json.decode(os.environ.pop(variable, ""), type=kind)
    except msgspec.MsgspecError as error:
        raise DasError(f"this process is started by {starter}, not by itself ({error})") from error
