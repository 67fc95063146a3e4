"""The page for assessors from outside: its program runs as it stands, and the names that it promises are there."""

from __future__ import annotations

import dataclasses
import io
import re
from contextlib import redirect_stdout

import pytest

from das.advice import advice
from das.cab import cab, heard, outputs
from das.estimate import estimate
from docs.studies.reference import rows_of
from tests.support.making import REPOSITORY

CODE = (REPOSITORY / "docs" / "examples" / "assess.py").read_text(encoding="utf-8")
ROWS = [re.findall(r"`(\w+)`", " ".join(row)) for row in rows_of("seam")[1:]]
MODULES = (cab, heard, outputs, advice, estimate)
PROMISED = 23
"""So many types are promised: a row that is taken away is noticed here."""


def named(name: str) -> type:
    """The type with a name in the modules of the seam."""
    found = {getattr(module, name) for module in MODULES if hasattr(module, name)}
    assert len(found) == 1, f"{name}: {found}"
    return found.pop()


def test_the_program_of_the_page_runs_and_hears_all_kinds_of_answers() -> None:
    names: dict[str, object] = {}
    assert len(CODE.splitlines()) <= 40
    with redirect_stdout(io.StringIO()) as printed:
        exec(compile(CODE, "assess.py", "exec"), names)
    said, last = names["said"], names["advice"]
    assert isinstance(said, list)
    assert isinstance(last, outputs.Advice)
    kinds = (outputs.Advice, outputs.Status, outputs.Plan, outputs.Estimated, outputs.Event)
    assert [kind.__name__ for kind in kinds if not any(isinstance(one, kind) for one in said)] == []
    assert sum(isinstance(one, outputs.Advice) for one in said) == 30
    assert last.mode.name != "NONE"
    assert last.guide is not None
    # All that was told counts: the journey, the restriction, the target and the delay.
    assert all(word in printed.getvalue() for word in ("journey A – B", "restriction set", "targets: B", "20 s late"))


def test_the_page_promises_no_fewer_types_than_before() -> None:
    assert len(ROWS) >= PROMISED
    assert all(len(row) > 1 for row in ROWS)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_what_the_page_promises_is_there(row: list[str]) -> None:
    kind, promised = named(row[0]), row[1:]
    if dataclasses.is_dataclass(kind):
        there = {field.name for field in dataclasses.fields(kind)}
    else:
        there = set(getattr(kind, "_fields", ())) | set(vars(kind))
    assert [name for name in promised if name not in there] == []
