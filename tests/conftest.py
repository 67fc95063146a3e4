"""Fixtures that tests all over the tree need. They import the program only where they are used."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("untimed", deadline=None)  # a busy machine is not a failure
settings.load_profile("untimed")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--part", metavar="K/N", help="run every Nth of the chosen tests only, from the Kth on")


@pytest.hookimpl(trylast=True)  # after `-m` has chosen
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Keep every Nth test: neighbours in a file, which often take as long, are dealt out to different parts."""
    if config.getoption("--part"):
        number, parts = map(int, config.getoption("--part").split("/"))
        items[:] = items[number - 1 :: parts]


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
