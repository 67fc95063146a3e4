"""Options in groups: a command takes frozen dataclasses, and their fields are its options.

A group is declared once, with the type, spelling and help of each option as the `Annotated` type of its field, and
any command that takes the dataclass as a parameter has all of its options. Groups may hold groups.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from inspect import Parameter, Signature
from typing import Any, get_type_hints


def with_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function with the fields of its groups as parameters of their own, as typer reads them.

    A function without groups comes back as an equal one. Two options of one name are a mistake of the programmer and
    raise TypeError.
    """
    hints = get_type_hints(function, include_extras=True)
    parameters: list[Parameter] = []
    for parameter in inspect.signature(function).parameters.values():
        if is_dataclass(hints[parameter.name]):
            parameters += _options(hints[parameter.name])
        else:
            annotation = hints[parameter.name]
            parameters.append(parameter.replace(kind=Parameter.KEYWORD_ONLY, annotation=annotation))
    names = [parameter.name for parameter in parameters]
    if len(set(names)) < len(names):
        raise TypeError(f"{function.__name__}: two options of one name among {', '.join(names)}")

    def flat(**given: Any) -> Any:
        return function(
            **{
                name: _gathered(hints[name], given) if is_dataclass(hints[name]) else given[name]
                for name in inspect.signature(function).parameters
            }
        )

    flat.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    flat.__name__, flat.__doc__, flat.__module__ = function.__name__, function.__doc__, function.__module__
    return flat


def _options(group: type) -> Iterator[Parameter]:
    """The options of a group and of the groups in it."""
    hints = get_type_hints(group, include_extras=True)
    for field in fields(group):
        if is_dataclass(hints[field.name]):
            yield from _options(hints[field.name])
        else:
            yield Parameter(field.name, Parameter.KEYWORD_ONLY, default=_default(field), annotation=hints[field.name])


def _default(field: Field[Any]) -> Any:
    return Parameter.empty if field.default is MISSING else field.default


def _gathered(group: Any, given: Mapping[str, Any]) -> Any:
    """The group with the options that were given."""
    hints = get_type_hints(group, include_extras=True)
    return group(
        **{
            field.name: _gathered(hints[field.name], given) if is_dataclass(hints[field.name]) else given[field.name]
            for field in fields(group)
        }
    )
