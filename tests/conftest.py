"""Fixtures that tests all over the tree need. They import the program only where they are used."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("untimed", deadline=None)  # a busy machine is not a failure
settings.load_profile("untimed")


WHOLE_TESTS = 12
"""A file with more chosen tests than this is dealt out test by test."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--part", metavar="K/N", help="run the Kth of N parts of the chosen tests only")


@pytest.hookimpl(trylast=True)  # after `-m` has chosen
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Keep a part of the tests: whole files, as their tests may build on each other, but those of long files singly."""
    if config.getoption("--part"):
        number, parts = map(int, config.getoption("--part").split("/"))
        sizes = Counter(one.path for one in items)
        dealt = [one.nodeid if sizes[one.path] > WHOLE_TESTS else str(one.path) for one in items]
        numbers = {key: k for k, key in enumerate(dict.fromkeys(dealt))}
        items[:] = [one for one, key in zip(items, dealt, strict=True) if numbers[key] % parts == number - 1]


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of third-party data beside the checkout: needed in CI, skipped with a reason elsewhere."""
    from tests.support.benchmark import shared_data

    return shared_data(module=False)


@pytest.fixture(scope="module")
def flat(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """A function that writes a scenario file of the flat line, with text added at its end or another beginning."""
    from tests.support.flat_days import FLAT

    folder = tmp_path_factory.mktemp("scenarios")
    count = iter(range(1000))

    def write(more: str = "", base: str = FLAT) -> Path:
        path = folder / f"s{next(count)}.toml"
        path.write_text(base + more, encoding="utf-8")
        return path

    return write
