"""Fixtures and hooks for all tests: which file runs first, what is forgotten at a file's end.

Fixtures import the program only where they are used.
"""

from __future__ import annotations

import gc
import os
import sys
from collections import Counter
from collections.abc import Callable, Generator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

# A busy machine is not a failure, and the same commit gives the same result; `.ci/nightly` draws other examples.
settings.register_profile("same", deadline=None, derandomize=True)
settings.register_profile("drawn", deadline=None)
settings.load_profile("same")

FILE_SECONDS = Path(__file__).parent / "data" / "file_seconds.txt"
"""CPU seconds of test files in each tier, from 1 s: `uv run pytest -m "" --file-seconds` measures them anew."""

# Workers take all cores already. A second thread of OpenBLAS waits for its part of each product in a loop: a product of
# matrices took five times the processor time. NumPy reads this when it is imported, in this process and its children.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

CACHED = type(cache(len))
"""What `@cache` and `@lru_cache` make of a function."""

ALLOCATIONS = 20_000
"""New objects after which the garbage collector looks: at Python's 700 it took two thirds of parsing the modules."""

measured: Counter[str] = Counter()
gc.set_threshold(ALLOCATIONS)


def tier_and_file(item: pytest.Item) -> str:
    """The tier of a test (one with both markers is nightly) and its file, as in `FILE_SECONDS`."""
    tier = next((one for one in ("nightly", "slow") if item.get_closest_marker(one)), "default")
    return f"{tier}:{item.nodeid.split('::')[0]}"


def known_seconds() -> Counter[str]:
    lines = FILE_SECONDS.read_text(encoding="utf-8").splitlines() if FILE_SECONDS.exists() else []
    return Counter({name: int(seconds) for seconds, name in map(str.split, lines)})


def cpu_s() -> float:
    """CPU seconds of this process and of its children that have ended."""
    return sum(os.times()[:4])


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--file-seconds", action="store_true", help=f"keep the CPU seconds of test files in {FILE_SECONDS}"
    )


@pytest.hookimpl(trylast=True)  # after `-m` has chosen
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """In parallel the longest files come first: if one of them came last, one worker would run it alone."""
    if hasattr(config, "workerinput"):
        known_s, of_file_s = known_seconds(), Counter[Path]()
        for name, item in {tier_and_file(item): item for item in items}.items():
            of_file_s[item.path] += known_s[name]
        items.sort(key=lambda item: -of_file_s[item.path])


def pytest_collection_finish() -> None:
    """What collection made stays to the end: from here on the garbage collector looks only at what tests make."""
    gc.collect()
    gc.freeze()


def forget() -> None:
    """Forget what `@cache` functions of tests keep and what only circles refer to: a driven day has up to 100 MB."""
    for module in [one for name, one in sys.modules.items() if name.startswith("tests.")]:
        for one in vars(module).values():
            if isinstance(one, CACHED) and one.__module__.startswith("tests."):
                one.cache_clear()
    gc.collect()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> Generator[None, object, object]:
    began_s = cpu_s()
    try:
        return (yield)
    finally:
        if nextitem is None or nextitem.path != item.path:
            forget()
        measured[tier_and_file(item)] += cpu_s() - began_s


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    measured.update(getattr(node, "workeroutput", {}).get("file_seconds", {}))


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Keep the seconds of the files that were run, and what is known of the others.

    Where all tiers were run, nothing is kept of a tier that a file no longer has.
    """
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["file_seconds"] = dict(measured)
    elif session.config.getoption("--file-seconds"):
        whole = set() if session.config.getoption("-m") else {name.split(":")[1] for name in measured}
        others = {name: seconds for name, seconds in known_seconds().items() if name.split(":")[1] not in whole}
        both = {name: seconds for name, seconds in {**others, **measured}.items() if seconds >= 1}
        lines = [f"{both[name]:.0f} {name}\n" for name in sorted(both, key=lambda name: -both[name])]
        FILE_SECONDS.write_text("".join(lines), encoding="utf-8")


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
