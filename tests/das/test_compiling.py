"""Compiled kernels are kept on disk, and never outlive the source that they were compiled from."""

from __future__ import annotations

import compileall
import errno
from pathlib import Path

import pytest
from numba.core.caching import IndexDataCacheFile

from das.compiling import FOLDER, KEPT_VERSIONS, kernel, sources_of
from tests.support.copies import copy_of, edit, run_copy, started_copy
from tests.support.making import REPOSITORY

CALLER = """
from das.compiling import kernel
from {package}.callee import twice
from {package}.numbers import OFFSET

@kernel
def answer(x):
    return twice(x) + OFFSET
"""
CALLEE = """
from das.compiling import kernel

@kernel
def twice(x):
    return 2 * x
"""
RUN = """
import numba
before = numba.config.CACHE_DIR
from {package}.caller import answer
assert numba.config.CACHE_DIR == before
print(answer(10), sum(answer.stats.cache_hits.values()))
"""


@pytest.fixture
def kernels(tmp_path: Path) -> Path:
    """The package `das` with two more modules: a kernel that calls one of another file and reads its constant."""
    copy_of(tmp_path, "das")
    for name, text in (("caller", CALLER), ("callee", CALLEE), ("numbers", "OFFSET = 1\n")):
        (tmp_path / "das" / f"{name}.py").write_text(text.format(package="das"))
    return tmp_path


def answered(folder: Path, **env: str) -> tuple[int, int, str]:
    """What the kernel answers, how many compiled functions came from the disk, and what was said on the way."""
    done = run_copy(folder, "-c", RUN.format(package="das"), env=env)
    assert done.returncode == 0, done.stderr
    value, hits = done.stdout.split()
    return int(value), int(hits), done.stderr


@pytest.mark.slow
def test_a_changed_callee_or_constant_is_seen_without_removing_anything(kernels: Path) -> None:
    assert answered(kernels) == (21, 0, "")
    assert answered(kernels) == (21, 1, "")
    edit(kernels / "das/callee.py", "2 * x", "3 * x")
    assert answered(kernels) == (31, 0, "")
    assert answered(kernels) == (31, 1, "")
    edit(kernels / "das/numbers.py", "OFFSET = 1", "OFFSET = 5")
    assert answered(kernels) == (35, 0, "")
    edit(kernels / "das/numbers.py", "OFFSET = 5", "OFFSET = 1")
    assert answered(kernels) == (31, 1, "")


TOGETHER = """
import sys
from concurrent.futures import ThreadPoolExecutor
from {package}.caller import answer
print("ready", flush=True)
sys.stdin.readline()
with ThreadPoolExecutor(4) as pool:
    answers = set(pool.map(answer, range(10, 14)))
print(sorted(answers), sum(answer.stats.cache_hits.values()))
"""


@pytest.mark.slow
def test_processes_and_threads_that_need_a_kernel_at_a_time_compile_it_once(kernels: Path) -> None:
    """One of the processes compiles it; the others wait for that code and load it."""
    programs = [started_copy(kernels, "-c", TOGETHER.format(package="das")) for _ in range(3)]
    for one in programs:
        assert one.stdout is not None
        assert one.stdout.readline() == "ready\n"
    said = []
    for one in programs:
        assert one.stdin is not None
        one.stdin.write("go\n")
        one.stdin.flush()
    for one in programs:
        out, error = one.communicate()
        assert (one.returncode, error) == (0, "")
        said.append(out.strip())
    assert sorted(said) == ["[21, 23, 25, 27] 0", "[21, 23, 25, 27] 1", "[21, 23, 25, 27] 1"]


PARTS = """
from das.compiling import kernel

@kernel
def checked(x):
    if x < 0:
        raise ValueError("negative")
    return 2 * x

@kernel
def first(x):
    return checked(x) + 1

@kernel
def second(x):
    return checked(x) + first(x)
"""
CALLS = """
from {package}.parts import checked, first, second
calls = [lambda: first(3), lambda: second(3), lambda: checked(3), lambda: checked(3.5), lambda: first(3.5)]
for call in calls if ORDER else calls[::-1]:
    print(call())
for one in (first, second, checked):
    try:
        one(-1)
    except ValueError as error:
        print(error)
print(sum(sum(one.stats.cache_hits.values()) for one in (checked, first, second)))
"""


@pytest.mark.slow
def test_python_and_kernels_may_call_the_same_kernel_in_any_order(tmp_path: Path) -> None:
    """Also the error that a called kernel raises arrives, compiled just now or kept before."""
    copy_of(tmp_path, "das")
    (tmp_path / "das/parts.py").write_text(PARTS)
    results = ["7", "13", "6", "7.0", "8.0"]
    for order, kept in ((1, "0"), (0, "5")):
        done = run_copy(tmp_path, "-c", CALLS.replace("ORDER", str(order)).replace("{package}", "das"))
        assert done.returncode == 0, done.stderr
        said = done.stdout.split()
        assert said == [*(results if order else results[::-1]), *["negative"] * 3, kept]


@pytest.mark.nightly
def test_a_module_that_the_kernel_does_not_use_changes_nothing(kernels: Path) -> None:
    assert answered(kernels)[:2] == (21, 0)
    (kernels / "das/domain/units.py").write_text((kernels / "das/domain/units.py").read_text() + "MORE = 1\n")
    assert answered(kernels)[:2] == (21, 1)


@pytest.mark.nightly
def test_few_old_versions_are_kept(kernels: Path) -> None:
    folder = kernels / "das/__pycache__" / FOLDER / "das.caller"
    for offset in range(2, KEPT_VERSIONS + 4):
        edit(kernels / "das/numbers.py", f"OFFSET = {offset - 1}", f"OFFSET = {offset}")
        assert answered(kernels)[0] == 20 + offset
    assert len(list(folder.iterdir())) == KEPT_VERSIONS


@pytest.mark.nightly
def test_the_users_folder_is_used(kernels: Path) -> None:
    place = kernels / "mine"
    assert answered(kernels, NUMBA_CACHE_DIR=str(place))[:2] == (21, 0)
    assert answered(kernels, NUMBA_CACHE_DIR=str(place))[:2] == (21, 1)
    edit(kernels / "das/callee.py", "2 * x", "3 * x")
    assert answered(kernels, NUMBA_CACHE_DIR=str(place))[:2] == (31, 0)
    assert {path.name for path in place.iterdir()} == {FOLDER}
    assert not (kernels / "das/__pycache__").exists()


@pytest.mark.nightly
def test_an_installation_that_cannot_be_written_to_uses_the_users_folder_of_caches(kernels: Path) -> None:
    (kernels / "das/__pycache__").write_text("a file: no folder can be made here, whoever we are")
    home = {"HOME": str(kernels / "home"), "XDG_CACHE_HOME": str(kernels / "home/caches")}
    assert answered(kernels, **home) == (21, 0, "")
    assert answered(kernels, **home) == (21, 1, "")
    assert list((kernels / "home").rglob(f"{FOLDER}/das.caller"))


@pytest.mark.nightly
def test_where_nothing_can_be_kept_the_user_is_told_how_to_help(kernels: Path) -> None:
    (kernels / "das/__pycache__").write_text("a file")
    nowhere = {"HOME": "/dev/null", "XDG_CACHE_HOME": "/dev/null/caches"}
    value, hits, said = answered(kernels, **nowhere)
    assert (value, hits) == (21, 0)
    assert said.count("set NUMBA_CACHE_DIR to a folder that can be written to") == 1


@pytest.mark.nightly
def test_bounds_checks_have_their_own_compiled_code(kernels: Path) -> None:
    assert answered(kernels)[:2] == (21, 0)
    assert answered(kernels, NUMBA_BOUNDSCHECK="1")[:2] == (21, 0)
    assert answered(kernels)[:2] == (21, 1)


LOADED = """
import sys
from {package}.caller import answer
print(answer(10), sum(answer.stats.cache_hits.values()), "numba.np.linalg" in sys.modules)
"""


@pytest.mark.slow
def test_a_kept_kernel_is_loaded_without_what_the_compiler_needs(kernels: Path) -> None:
    loaded = [run_copy(kernels, "-c", LOADED.format(package="das")).stdout for _ in range(2)]
    assert loaded == ["21 0 True\n", "21 1 False\n"]


MIXED = """
from {package}.callee import twice
from {package}.caller import answer
print(twice(4), answer(10), *(sum(one.stats.cache_hits.values()) for one in (twice, answer)))
"""


@pytest.mark.nightly
def test_a_kernel_is_compiled_around_one_that_was_kept(kernels: Path) -> None:
    assert run_copy(kernels, "-c", MIXED.format(package="das")).stdout == "8 21 0 0\n"
    edit(kernels / "das/numbers.py", "OFFSET = 1", "OFFSET = 2")
    assert run_copy(kernels, "-c", MIXED.format(package="das")).stdout == "8 22 1 0\n"


# --- what a module depends on -----------------------------------------------------------------------------------


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Path:
    """An importable package of its own name with an inner package."""
    folder = tmp_path / f"own_{abs(hash(request.node.name))}"
    (folder / "inner").mkdir(parents=True)
    for name in ("__init__.py", "inner/__init__.py"):
        (folder / name).write_text("")
    monkeypatch.syspath_prepend(str(tmp_path))
    return folder


def test_all_ways_to_import_are_followed(package: Path) -> None:
    name = package.name
    (package / "start.py").write_text(
        f"import os, {name}.a as x\n"
        f"from {name} import b, nothing\n"
        f"from {name}.inner import (\n    c,  # a comment\n    other as d,\n)\n"
        f"def late():\n    from . import e\n    from .inner.f import g\n"
        "from numpy import array\n"
    )
    for module in ("a", "b", "e", "inner/c", "inner/other", "inner/f", "unused"):
        (package / f"{module}.py").write_text("X = 1\n")
    (package / "b.py").write_text(f"import {name}.far\n")
    (package / "far.py").write_text(f"import {name}.start  # round in a circle\n")
    found = sources_of(f"{name}.start")
    inner = f"{name}.inner"
    modules = [f"{name}.{x}" for x in ("a", "b", "e", "far", "start")]
    assert set(found) == {name, inner, *modules, f"{inner}.c", f"{inner}.other", f"{inner}.f"}


def test_the_solver_depends_on_its_kernels_and_on_the_domain_and_on_nothing_else() -> None:
    found = set(sources_of("das.solver.front"))
    assert {"das.solver.front", "das.solver.section", "das.solver.tolerances", "das.solver.kernels.tuples"} <= found
    assert {"das.domain.vehicle", "das.domain.route", "das.domain.losses", "das.domain.units"} <= found
    assert any(name.startswith("das.solver.kernels") for name in found)
    assert all(
        name.startswith(("das.solver", "das.offline", "das.domain")) or name == "das.compiling" for name in found
    )


def test_a_module_without_its_source_is_refused(package: Path) -> None:
    (package / "a.py").write_text("X = 1\n")
    (package / "start.py").write_text(f"from {package.name} import a\n")
    assert len(sources_of(f"{package.name}.start")) == 3
    other = package.with_name(f"{package.name}_b")
    package.rename(other)
    compileall.compile_dir(other, quiet=1, legacy=True)
    (other / "a.py").unlink()
    (other / "start.py").write_text(f"import {other.name}.a\n")
    with pytest.raises(FileNotFoundError, match=rf"{other.name}.a: its source file is not installed"):
        sources_of(f"{other.name}.start")
    with pytest.raises(FileNotFoundError, match=r"das.nowhere: its source file is not installed"):
        sources_of("das.nowhere")


def test_every_kernel_of_ours_is_compiled_by_the_one_decorator() -> None:
    """A kernel compiled by numba's own decorator would outlive a change of what it calls."""
    own = [
        str(path.relative_to(REPOSITORY))
        for package in ("das", "precompute", "sim")
        for path in (REPOSITORY / package).rglob("*.py")
        if "import njit" in path.read_text(encoding="utf-8") or "numba.njit(" in path.read_text(encoding="utf-8")
    ]
    assert own == []


@kernel
def doubled(x):  # type: ignore[no-untyped-def]
    return x + x


def test_a_full_disk_costs_only_the_kept_code(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a full folder of caches the first kernel that was compiled anew ended the program."""
    tried = []

    def full(*_: object) -> None:
        tried.append(True)
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(IndexDataCacheFile, "save", full)
    monkeypatch.setattr(IndexDataCacheFile, "load", lambda *_: None)
    assert doubled(3) == 6
    assert doubled(1.5) == 3.0
    assert tried
