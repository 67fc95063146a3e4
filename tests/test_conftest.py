"""The order of the test files, what is forgotten at the end of a file, and the tiers of random cases."""

from __future__ import annotations

import sys
import weakref
from functools import cache
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from tests import conftest
from tests.support.crossing import few
from tests.support.making import REPOSITORY


def item(name: str, *marks: str) -> Any:
    """What the hooks ask of a test: its file, its name and its markers."""
    return SimpleNamespace(nodeid=f"{name}::test", path=REPOSITORY / name, get_closest_marker=marks.__contains__)


def test_the_longest_file_of_the_tiers_that_run_comes_first(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    seconds = "50 nightly:a.py\n20 slow:b.py\n9 default:c.py\n7 default:a.py\n"
    monkeypatch.setattr(conftest, "FILE_SECONDS", tmp_path / "seconds.txt")
    conftest.FILE_SECONDS.write_text(seconds)
    tests = [item("new.py"), item("a.py"), item("b.py", "slow"), item("a.py"), item("c.py")]
    worker: Any = SimpleNamespace(workerinput={})
    conftest.pytest_collection_modifyitems(worker, tests)
    assert [one.path.name for one in tests] == ["b.py", "c.py", "a.py", "a.py", "new.py"]
    conftest.pytest_collection_modifyitems(worker, nightly := [item("c.py"), item("a.py", "slow", "nightly")])
    assert [one.path.name for one in nightly] == ["a.py", "c.py"]


def test_every_file_whose_seconds_are_kept_is_there() -> None:
    names = [name.split(":")[1] for name in conftest.known_seconds()]
    assert names
    assert [name for name in names if not (REPOSITORY / name).is_file()] == []


def test_what_functions_of_the_tests_keep_is_forgotten_at_the_end_of_a_file(monkeypatch: pytest.MonkeyPatch) -> None:
    """What functions of the program keep stays, as in a program that runs for long; circles go."""

    @cache
    def ours() -> object:
        return object()

    @cache
    def products() -> object:
        return object()

    class Circle:
        def __init__(self) -> None:
            self.itself = self

    ours.__module__, products.__module__ = "tests.support.drives_days", "sim.drives_days"
    module = ModuleType(ours.__module__)
    vars(module).update(ours=ours, products=products, number=3)
    monkeypatch.setitem(sys.modules, module.__name__, module)
    first, same_file, other_file = item("a.py"), item("a.py"), item("b.py")
    kept, circle = (ours(), products()), weakref.ref(Circle())
    for nextitem, forgotten in ((same_file, False), (other_file, True)):
        hook: Any = conftest.pytest_runtest_protocol(first, nextitem)
        next(hook)
        with pytest.raises(StopIteration):
            hook.send(None)
        assert (ours() is not kept[0]) is forgotten
    assert products() is kept[1]
    assert circle() is None


def test_values_that_are_not_kept_are_in_the_tier_that_is_asked_for() -> None:
    kept, rest = few((1, 2), (1,), pytest.mark.slow)
    assert (kept, rest.values, [mark.name for mark in rest.marks]) == (1, (2,), ["slow"])
