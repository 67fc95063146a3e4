"""Reasons as values: what is read from other objects, and that the documentation lists every code."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

from das.advice.reason import NO_REASON, Reason, ReasonCode
from docs.studies.reference import reasons
from tests.support.making import REPOSITORY

STOP = Reason(code=ReasonCode.STOP, stop="Zug")


def test_only_a_code_makes_a_reason() -> None:
    assert not NO_REASON
    assert not Reason(late_s=40.0)
    assert STOP
    assert Reason.of_text("old") == Reason(code=ReasonCode.TEXT, text="old")


def test_a_reason_that_is_read_equals_the_one_it_was_made_from() -> None:
    """As from a message, whose NaN is another object."""
    assert Reason.read(STOP) is STOP
    assert Reason.read(SimpleNamespace(**{**vars(STOP), "code": 5, "at_m": float("nan")})) == STOP
    assert Reason.read(SimpleNamespace(**vars(replace(STOP, late_s=7.0)))) == replace(STOP, late_s=7.0)


@pytest.mark.parametrize("code", [0, 99])
def test_a_code_that_is_unknown_or_not_set_is_no_reason(code: int) -> None:
    """As in a recording of a later version, or of one before codes."""
    assert Reason.read(SimpleNamespace(code=code)) == NO_REASON


def test_the_documentation_lists_every_reason() -> None:
    assert "docs.studies.reference -> reasons.md }}" in (REPOSITORY / "docs" / "reference" / "bus.md").read_text()
    assert [code for code in ReasonCode if f"| {int(code)} | `{code.name}` | " not in reasons()] == []
