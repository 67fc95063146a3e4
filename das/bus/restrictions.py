"""Conversion of a restriction to its message and back: only this module knows its bus format."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from typing import Any, TypeVar

from das.bus import das_pb2
from das.domain.errors import InputError
from das.domain.restriction import Restriction

_Kind = TypeVar("_Kind", bound=Restriction)


def encode_restriction(one: Restriction) -> das_pb2.Restrictions.Restriction:
    """The message of a restriction; an open end of the time window is left unset."""
    return das_pb2.Restrictions.Restriction(**vars(one))


def decode_restriction(message: Any, kind: type[_Kind]) -> _Kind:
    """The restriction of a message. If `kind` checks the figures, as Restriction does, wrong ones raise InputError."""
    return kind(**{one.name: getattr(message, one.name) for one in fields(kind)})


def valid_restrictions(messages: Iterable[Any]) -> tuple[Restriction, ...]:
    """The restrictions of a recorded list; entries that no node accepts as a restriction are left out."""
    found = []
    for message in messages:
        try:
            found.append(decode_restriction(message, Restriction))
        except InputError:
            continue
    return tuple(found)
