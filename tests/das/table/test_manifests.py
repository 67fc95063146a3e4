"""Manifests that say nonsense: each is refused in one line with the file, the key and what was expected."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from das.solver.section import Section
from das.table.format import ARRAYS, MANIFEST, TableError
from das.table.reading import MOST_MANIFEST_BYTES, Table, read_front
from tests.support.making import REPOSITORY, das_precompute
from tests.support.small_tables import seal_anew

Facts = dict[str, Any]


@pytest.fixture
def copied(folder: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(folder, tmp_path / "table"))


def put(*keys: str | int, value: Any) -> Callable[[Facts], None]:
    """Put a value into a manifest."""

    def change(facts: Any) -> None:
        for key in keys[:-1]:
            facts = facts[key]
        facts[keys[-1]] = value

    return change


def drop(*keys: str | int) -> Callable[[Facts], None]:
    """Leave a key out of a manifest."""

    def change(facts: Any) -> None:
        for key in keys[:-1]:
            facts = facts[key]
        del facts[keys[-1]]

    return change


def huge_everywhere(facts: Facts) -> None:
    """A grid that fits its arrays' facts and no memory."""
    facts["grid"] = {"decision_nodes": 200_000, "speeds": 5_000, "integration_nodes": 5_000_000}


BAD: dict[str, tuple[Callable[[Facts], Any], str]] = {
    "no key": (drop("least_time_s"), "least_time_s is missing: expected a finite number > 0"),
    "least time 0": (put("least_time_s", value=0), "least_time_s = 0: expected a finite number > 0"),
    "least time true": (put("least_time_s", value=True), "least_time_s = True: expected a finite number > 0"),
    "section null": (put("section", value=None), "section = None: expected an object"),
    "route null": (put("section", "route", value=None), "section.route = None: expected a string"),
    "start null": (put("section", "start_m", value=None), "section.start_m = None: expected a finite number"),
    "no mass": (drop("section", "mass_kg"), "section.mass_kg is missing: expected a finite number > 0"),
    "from a number": (put("section", "from", value=1), "section.from = 1: expected a string or null"),
    "hashes null": (put("inputs_sha256", value=None), "inputs_sha256 = None: expected an object"),
    "no hash": (drop("inputs_sha256", "solver"), "inputs_sha256.solver is missing: expected a SHA-256"),
    "table's hash": (put("table_sha256", value="x"), "table_sha256 = 'x': expected a SHA-256"),
    "grid null": (put("grid", value=None), "grid = None: expected an object"),
    "nodes a fraction": (
        put("grid", "decision_nodes", value=50.5),
        "grid.decision_nodes = 50.5: expected a whole number from 2 to 200000",
    ),
    "nodes huge": (
        put("grid", "decision_nodes", value=10**30),
        f"grid.decision_nodes = {10**30}: expected a whole number from 2 to 200000",
    ),
    "speeds negative": (
        put("grid", "speeds", value=-1),
        "grid.speeds = -1: expected a whole number from 2 to 5000",
    ),
    "memory huge": (huge_everywhere, "expected at most 2 GB"),
    "multipliers null": (put("lambda_w", value=None), "lambda_w = None: expected a list that is not empty"),
    "no multipliers": (put("lambda_w", value=[]), "lambda_w = []: expected a list that is not empty"),
    "multipliers that fall": (
        put("lambda_w", 3, value=0.0),
        "lambda_w[3] = 0.0: expected a finite number >= 0 above the one before it",
    ),
    "multiplier of 400 digits": (put("lambda_w", 27, value=10**400), "expected a finite number >= 0"),
    "many multipliers": (
        put("lambda_w", value=list(range(3000))),
        "lambda_w = '3000 of them': expected at most 2000",
    ),
    "one multiplier less": (
        lambda facts: facts["lambda_w"].pop(),
        "arrays.value_j.shape = [",
    ),
    "no trajectories": (put("trajectories", value={}), "trajectories = {}: expected a list that is not empty"),
    "trajectory null": (put("trajectories", 1, value=None), "trajectories[1] = None: expected an object"),
    "energy null": (
        put("trajectories", 0, "energy_input_j", value=None),
        "trajectories[0].energy_input_j = None: expected a finite number",
    ),
    "time negative": (
        put("trajectories", 0, "time_s", value=-3.0),
        "trajectories[0].time_s = -3.0: expected a finite number > 0",
    ),
    "fit a list": (
        put("trajectories", 2, "fit", value=["late"]),
        "trajectories[2].fit = ['late']: expected one of on-time, late, early",
    ),
    "buffer a text": (
        put("trajectories", 0, "buffer_percent", value="0"),
        "trajectories[0].buffer_percent = '0': expected a finite number or null",
    ),
    "arrays null": (put("arrays", value=None), "arrays = None: expected an object"),
    "no array": (drop("arrays", "grid"), "arrays.grid is missing: expected an object"),
    "shape huge": (
        put("arrays", "grid", "shape", value=[3, 10**12]),
        "arrays.grid.shape = [3, 1000000000000]: expected [3, ",
    ),
    "type": (put("arrays", "value_j", "dtype", value="|O"), "arrays.value_j.dtype = '|O': expected '<f4'"),
    "size small": (put("arrays", "grid", "size_bytes", value=10), "arrays.grid.size_bytes = 10: expected "),
    "size a fraction": (put("arrays", "grid", "size_bytes", value=10.0), "arrays.grid.size_bytes = 10.0: expected "),
    "hash of an array": (put("arrays", "grid", "sha256", value=7), "arrays.grid.sha256 = 7: expected a SHA-256"),
    "schema true": (put("schema_version", value=True), "schema_version = True: expected 3"),
    "schema a list": (put("schema_version", value=[1]), "schema_version = [1]: expected 3"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_manifest_sealed_anew_is_refused_by_its_key(copied: Path, case: str) -> None:
    change, said = BAD[case]
    seal_anew(copied, change)
    with pytest.raises(TableError) as caught:
        Table.open(copied)
    message = str(caught.value)
    assert message.startswith(f"{copied / MANIFEST}: ")
    assert said in message
    assert "\n" not in message
    assert len(message) < len(str(copied)) + 300


def test_a_seal_alone_does_not_hurt(copied: Path, section: Section) -> None:
    """The way the bad manifests are made leaves a good one good."""
    seal_anew(copied, lambda facts: None)
    Table.open(copied).verify()
    read_front(copied, section)


NOT_MANIFESTS: dict[str, tuple[bytes, str]] = {
    "deep": (b"[" * 200_000, "not valid JSON"),
    "digits": (b"9" * 10_000, "not valid JSON"),
    "NaN": (b'{"schema_version": NaN}', "not valid JSON (NaN is not a number of JSON)"),
    "empty": (b"", "not valid JSON"),
    "large": (b" " * (MOST_MANIFEST_BYTES + 1), f"{MOST_MANIFEST_BYTES + 1} bytes, expected at most"),
}


@pytest.mark.parametrize("case", NOT_MANIFESTS)
def test_what_is_no_manifest_is_refused(copied: Path, case: str) -> None:
    content, said = NOT_MANIFESTS[case]
    (copied / MANIFEST).write_bytes(content)
    with pytest.raises(TableError) as caught:
        Table.open(copied)
    assert str(caught.value).startswith(f"{copied / MANIFEST}: ")
    assert said in str(caught.value)


@pytest.mark.parametrize("name", [MANIFEST, "value_j.npy"])
@pytest.mark.parametrize("kind", ["pipe", "folder", "device"])
def test_only_regular_files_are_opened(copied: Path, name: str, kind: str) -> None:
    """A pipe that nobody writes to must not hold a node up."""
    path = copied / name
    path.unlink()
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    else:
        path.symlink_to("/dev/zero")
    with pytest.raises(TableError, match=f"{name}: is not a regular file"):
        Table.open(copied)


def test_a_file_that_becomes_a_pipe_or_grows_after_it_was_looked_at_is_refused(copied: Path) -> None:
    table, path = Table.open(copied), copied / "value_j.npy"
    with path.open("ab") as file:
        file.write(b"more")
    with pytest.raises(TableError, match=r"value_j.npy: .* bytes, expected at most"):
        table.arrays()
    path.unlink()
    os.mkfifo(path)
    with pytest.raises(TableError, match=r"value_j.npy: is not a regular file"):
        table.arrays()


@pytest.mark.parametrize("name", ARRAYS)
def test_an_array_of_another_length_is_refused_before_it_is_read(copied: Path, name: str) -> None:
    for change in (-8, 8):
        size = (copied / f"{name}.npy").stat().st_size + change
        os.truncate(copied / f"{name}.npy", size)
        with pytest.raises(TableError, match=rf"{name}.npy: {size} bytes, expected .*: was it cut"):
            Table.open(copied)
        os.truncate(copied / f"{name}.npy", size - change)


def with_content(folder: Path, name: str, content: bytes) -> None:
    """Replace an array of a table by another one of its size, as somebody who knows the format could."""
    (folder / f"{name}.npy").write_bytes(content)
    seal_anew(folder, put("arrays", name, "sha256", value=hashlib.sha256(content).hexdigest()))


def test_an_array_with_another_header_is_refused(copied: Path) -> None:
    content = (copied / "grid.npy").read_bytes().replace(b"<f8", b">f8")
    with_content(copied, "grid", content)
    with pytest.raises(TableError, match=r"grid.npy: its header is not that of <f8 numbers"):
        Table.open(copied).verify()


@pytest.mark.parametrize("name", ["value_j", "run_v_mps"])
def test_an_array_with_a_number_that_is_not_finite_is_refused(copied: Path, name: str) -> None:
    content = (copied / f"{name}.npy").read_bytes()
    with_content(copied, name, content[:-8] + b"\xff" * 8)
    with pytest.raises(TableError, match=rf"{name}.npy: holds a number that is not finite"):
        Table.open(copied).verify()


def test_the_commands_say_it_in_one_line(copied: Path, tmp_path: Path) -> None:
    seal_anew(copied, put("arrays", "value_j", "shape", value=[10**6, 10**6, 10**6]))
    said = f"{Path('table') / MANIFEST}: arrays.value_j.shape = [1000000, 1000000, 1000000]: expected ["
    for command in ("verify", "show"):
        done = das_precompute(tmp_path, command, "table")
        assert done.returncode == (1 if command == "verify" else 0)
        assert said in done.stdout
        assert done.stderr == ""
    (copied / MANIFEST).unlink()
    os.mkfifo(copied / MANIFEST)
    for command in ("verify", "show"):
        done = das_precompute(tmp_path, command, ".")
        assert f"{Path('table') / MANIFEST}: is not a regular file" in done.stdout


@pytest.mark.nightly
def test_a_huge_table_takes_no_memory(copied: Path) -> None:
    """A table that claims to hold terabytes is refused in words, before anything is allocated for it."""
    seal_anew(copied, put("grid", value={"decision_nodes": 190_000, "speeds": 4_900, "integration_nodes": 4_900_000}))
    code = (
        "import sys; from pathlib import Path; from das.table.format import TableError; "
        "from das.table.reading import Table\n"
        "try:\n    Table.open(Path(sys.argv[1])).verify()\n"
        "except TableError as error:\n    print(error)\n"
        # ru_maxrss would count the process that started this one.
        "print(Path('/proc/self/status').read_text().partition('VmHWM:')[2].split()[0])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(copied)],
        cwd=REPOSITORY,
        stdout=subprocess.PIPE,
        encoding="utf-8",
        check=True,
        timeout=120,
    )
    message, peak_kb = done.stdout.splitlines()
    assert message.endswith("expected at most 2 GB")
    assert int(peak_kb) < 600_000
