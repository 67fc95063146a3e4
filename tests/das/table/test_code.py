"""A table belongs to the code that made it: after a change of a kernel nobody uses it, and a build makes it anew."""

from __future__ import annotations

import compileall
import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from das.bus import das_pb2
from das.table.hashes import CODE, differing_parts, is_other_code, solver_code_sha256
from das.table.reading import Table
from tests.support.copies import copy_of, edit, run_copy
from tests.support.making import das_precompute

PLAN = """
schema_version = 1
routes = [{route = "flat-6km"}]
trains = [{vehicle = "re460-ic"}]
tables = {buffers_percent = [0, 10], max = false, multipliers = 8}
"""
ON_BOARD = """
import json
from pathlib import Path
from das.bus.topics import STATUS
from das.cab.fronts import Fronts
from das.domain.files.load import load_route, load_vehicle
from das.solver.section import build_section
from tests.support.driven_node import DrivenNode

fronts = Fronts(Path("tables"), threads=1)
driven = DrivenNode(fronts=fronts)
advice = driven.tick(1.0)
found = fronts.find(build_section(load_route("flat-6km"), load_vehicle("re460-ic")))
bound_j = found.front.trajectory(300.0).table_bound_j
told = {"cause": advice.cause, "source": advice.source, "events": driven.sink.events(), "bound_j": bound_j}
print(json.dumps(told))
"""
HASH = "from das.table.hashes import solver_code_sha256\nprint(solver_code_sha256())"
KERNEL = "return low + a * (high - low)"
"""The loss at a state, in a kernel of the solver."""
IN_VECTORS = "= low + across[j] * (high - low)"
"""The same loss where the sweep's transitions are found."""


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a plan and its table, made by the code as it is."""
    folder = tmp_path_factory.mktemp("built")
    (folder / "plan.toml").write_text(PLAN)
    done = das_precompute(folder, "build", "plan.toml", "--out", "tables", "--workers", "1", "--refine", "off")
    assert done.returncode == 0, done.stderr
    return folder


def file_with(folder: Path, text: str) -> Path:
    """The one file of the solver that holds a text."""
    (found,) = (path for path in (folder / "das/solver").rglob("*.py") if text in path.read_text(encoding="utf-8"))
    return found


def on_board(folder: Path) -> dict[str, Any]:
    """What a node that has the tables advises from on their section, and what it says."""
    done = run_copy(folder, "-c", ON_BOARD)
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout))


def command(folder: Path, *words: str) -> tuple[int, str]:
    done = run_copy(folder, "-m", "precompute.cli", *words)
    assert "Traceback" not in done.stderr
    return done.returncode, done.stdout + done.stderr


@pytest.mark.nightly
def test_a_table_of_other_code_is_not_used_and_built_again(built: Path, tmp_path: Path) -> None:
    copy_of(tmp_path, "das", "precompute", "tests")
    shutil.copytree(built / "tables", tmp_path / "tables")
    shutil.copy(built / "plan.toml", tmp_path)
    (table,) = (tmp_path / "tables").glob("flat-6km*")
    name = table.relative_to(tmp_path)
    code, said = command(tmp_path, "verify", "tables")
    assert code == 0, said
    edit(file_with(tmp_path, KERNEL), KERNEL, "return 3.0 * (low + a * (high - low))")
    edit(file_with(tmp_path, IN_VECTORS), IN_VECTORS, "= 3.0 * (low + across[j] * (high - low))")
    code, said = command(tmp_path, "verify", "tables")
    assert code == 1
    assert f"{name}: made by other solver code; build it again" in said
    assert "made by other solver code" in command(tmp_path, "show", "tables")[1]
    solved = on_board(tmp_path)
    assert (solved["cause"], solved["source"]) == (das_pb2.CAUSE_NONE, das_pb2.Advice.SOURCE_SOLVED)
    assert f"{name}: made by other solver code; solved instead" in solved["events"]
    code, said = command(tmp_path, "build", "plan.toml", "--out", "tables", "--workers", "1", "--refine", "off")
    assert code == 0, said
    assert "1 built" in said
    assert not table.exists()
    code, said = command(tmp_path, "verify", "tables")
    assert code == 0, said
    again = on_board(tmp_path)
    assert (again["cause"], again["source"]) == (das_pb2.CAUSE_NONE, das_pb2.Advice.SOURCE_TABLE)
    assert "solver code" not in again["events"]
    assert again["bound_j"] == pytest.approx(solved["bound_j"], rel=5e-3)
    # The change was one that counts: the old table holds other energies.
    assert solved["bound_j"] > 1.1 * _bound_j(built)


def _bound_j(folder: Path) -> float:
    from das.cab.fronts import Fronts
    from das.domain.files.load import load_route, load_vehicle
    from das.front_door import build_section, in_service

    section = in_service(build_section(load_route("flat-6km"), load_vehicle("re460-ic")))
    found = Fronts(folder / "tables", threads=1).find(section)
    assert found.source.name == "TABLE"
    return found.front.trajectory(300.0).table_bound_j


@pytest.mark.slow
def test_comments_and_docstrings_do_not_matter_and_the_domain_does(tmp_path: Path) -> None:
    copy_of(tmp_path, "das")

    def found() -> str:
        done = run_copy(tmp_path, "-c", HASH)
        assert done.returncode == 0, done.stderr
        return done.stdout.strip()

    assert found() == solver_code_sha256()
    path = file_with(tmp_path, KERNEL)
    text = path.read_text(encoding="utf-8")
    same = f"{KERNEL}  # the same"
    changed = text.replace(KERNEL, same).replace('"""Component loss', '"""The loss')
    path.write_text(f"{changed}# more\n", encoding="utf-8")
    assert path.read_text(encoding="utf-8") != text
    assert found() == solver_code_sha256()
    path = tmp_path / "das/domain/units.py"
    path.write_text(path.read_text(encoding="utf-8") + "MORE = 1\n", encoding="utf-8")
    assert found() != solver_code_sha256()


@pytest.mark.nightly
def test_without_source_files_no_table_is_trusted(built: Path, tmp_path: Path) -> None:
    copy_of(tmp_path, "das", "precompute")
    shutil.copytree(built / "tables", tmp_path / "tables")
    shutil.copy(built / "plan.toml", tmp_path)
    compileall.compile_dir(tmp_path / "das", quiet=1, legacy=True)
    for path in (tmp_path / "das").rglob("*.py"):
        path.unlink()
    code = "from pathlib import Path; from das.cab.fronts import Fronts; print(Fronts(Path('tables')).notes)"
    done = run_copy(tmp_path, "-c", code)
    assert done.returncode == 0, done.stderr
    assert "tables: nobody can tell which solver code made the tables (das.solver." in done.stdout
    assert "its source file is not installed, only a compiled one); none is used" in done.stdout
    code_, said = command(tmp_path, "verify", "tables")
    assert code_ == 1
    assert "nobody can tell which solver code made it" in said
    code_, said = command(tmp_path, "build", "plan.toml", "--out", "tables")
    assert code_ == 2
    assert said.splitlines()[-1].startswith("error: das.solver.")


def test_a_table_from_before_code_was_hashed_is_of_other_code(built: Path) -> None:
    (folder,) = (built / "tables").glob("flat-6km*")
    inputs = Table.open(folder).manifest["inputs_sha256"]
    before = {name: value for name, value in inputs.items() if name != CODE}
    assert differing_parts(before, inputs) == ["solver code"]
    assert is_other_code(differing_parts(before, inputs))
    assert not is_other_code(differing_parts({**before, "line": "0"}, inputs))
