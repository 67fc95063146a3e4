"""Combinations of values and random cases for tests: few in the default run, the rest with the marker `nightly`."""

from __future__ import annotations

import os
from collections.abc import Container, Iterable, Sequence
from itertools import product
from typing import Any

import pytest


def crossed(*lists: Sequence[Any]) -> list[Any]:
    """Every combination of the values of several lists, as parameters of a test.

    The default run has enough of them to contain every pair of values from two different lists (with only two lists:
    every value). The others have the marker `nightly`.
    """
    combinations = list(product(*(range(len(one)) for one in lists)))
    missing = {part for combination in combinations for part in _parts(combination)}
    kept = set()
    while missing:
        best = max(combinations, key=lambda combination: len(_parts(combination) & missing))
        kept.add(best)
        missing -= _parts(best)
    return [
        pytest.param(
            *(one[i] for one, i in zip(lists, combination, strict=True)),
            marks=() if combination in kept else pytest.mark.nightly,
        )
        for combination in combinations
    ]


def numbered(variable: str, usual: int, first: int = 0, rest: pytest.MarkDecorator = pytest.mark.nightly) -> list[Any]:
    """The numbers of random cases, as parameters of a test: a quarter in the default run, the rest marked.

    If the environment variable is set, it gives the number of cases, and all of them are in the default run.
    """
    if variable in os.environ:
        return [pytest.param(range(first, first + int(os.environ[variable])), id="all")]
    middle = first + -(-usual // 4)
    return [
        pytest.param(range(first, middle), id="first"),
        pytest.param(range(middle, first + usual), id="rest", marks=rest),
    ]


def few(values: Iterable[Any], kept: Container[Any], rest: pytest.MarkDecorator = pytest.mark.nightly) -> list[Any]:
    """Values as parameters of a test; those not in `kept`, the default run, are marked."""
    return [one if one in kept else pytest.param(one, marks=rest) for one in values]


def _parts(combination: tuple[int, ...]) -> set[tuple[tuple[int, int], ...]]:
    """The parts of a combination for the default run to cover: its values if there are two, else pairs of values."""
    places = list(enumerate(combination))
    if len(places) <= 2:
        return {(place,) for place in places}
    return {(a, b) for i, a in enumerate(places) for b in places[i + 1 :]}
