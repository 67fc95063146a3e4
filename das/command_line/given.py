"""The options that the user typed, and the refusal of those that a command would not use as it is called."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from types import MappingProxyType
from typing import Any

import typer

from das.domain.errors import DasError

_given: ContextVar[Mapping[str, str]] = ContextVar("given", default=MappingProxyType({}))
"""The options that the user typed for the command that runs: each spelling of an option, with its words."""


@contextmanager
def options_of(context: typer.Context) -> Iterator[None]:
    """Know, within the block, which options the user typed for the command of a context."""
    before = _given.set(dict(_typed(context)))
    try:
        yield
    finally:
        _given.reset(before)


def is_given(option: str) -> bool:
    """Whether the user typed an option of the command that runs, be it with its default value."""
    return option in _given.get()


def refuse_given(why: str, *options: str) -> None:
    """Raise DasError for the first of some options that the user typed; `why` says what it needs.

    Nothing is refused where a function is called without a command line.
    """
    for option in options:
        if is_given(option):
            raise DasError(f"{_given.get()[option]}: {why}")


def _typed(context: typer.Context) -> Iterator[tuple[str, str]]:
    for parameter in context.command.params:
        name = parameter.name or ""
        source = context.get_parameter_source(name)
        if source is not None and source.name == "COMMANDLINE":
            for option in parameter.opts:
                yield option, _words(option, parameter.secondary_opts, context.params.get(name))


def _words(option: str, opposites: list[str], value: Any) -> str:
    """An option as it was typed, with its value; a flag that was turned off has the word for that."""
    if isinstance(value, bool) or value is None:
        return opposites[0] if value is False and opposites else option
    return f"{option} {' '.join(map(str, value)) if isinstance(value, list | tuple) else value}"
