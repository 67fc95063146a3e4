"""The published results on TTOBench against their schema, the peer's and a witness; the command on a tiny library."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.domain.errors import DasError, InputError
from das.offline.refinement import refined
from das.solver.solve import solve_front
from docs.studies.output import write_csv
from docs.studies.results import (
    BUFFER_RATIO,
    COLUMNS,
    FOLDER,
    PEER,
    RESULTS,
    TOLERANCE_S,
    Instance,
    read_rows,
    results,
)
from tests.das.solver.test_solver import pose_reference
from tests.support.benchmark import TRACKS, TRAIN, TRAINS, shared_data
from tests.support.making import csv_rows
from tests.support.verifier import KWH, SUBSTEPS, Drive, verify

PACKAGE = json.loads((FOLDER / "datapackage.json").read_text(encoding="utf-8"))
CONSTANT, CHAIN = "constant 0.9/0.9", "map NL_Intercity_VIRM6_chain"
BOTH = "electric+pneumatic"


def wrong(field: dict[str, Any], text: str) -> bool:
    """Whether a cell breaks the type or a constraint of its column."""
    rules = field.get("constraints", {})
    if not text:
        return bool(rules.get("required", False))
    if field["type"] in ("number", "integer") and float(text) < rules.get("minimum", -np.inf):
        return True
    return text not in rules.get("enum", [text]) or re.fullmatch(rules.get("pattern", ".*"), text) is None


@pytest.mark.parametrize("resource", PACKAGE["resources"], ids=lambda one: str(one["name"]))
def test_a_table_keeps_its_schema(resource: dict[str, Any]) -> None:
    fields = resource["schema"]["fields"]
    with (FOLDER / resource["path"]).open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    assert head == [field["name"] for field in fields]
    assert [row for row in rows if any(map(wrong, fields, row))] == []
    keys = [tuple(row[head.index(name)] for name in resource["schema"]["primaryKey"]) for row in rows]
    assert len(set(keys)) == len(rows) > 20


def test_the_published_rows_hold_together_and_need_no_more_than_the_peer() -> None:
    rows = dict(read_rows(RESULTS, COLUMNS))
    for (_, time_s), row in rows.items():
        energy, bound = float(row["energy_kwh"]), float(row["bound_kwh"])
        gap_kwh = float(row["gap_percent"]) * abs(energy) / 100
        assert 0 <= energy - bound == pytest.approx(gap_kwh, abs=1e-4 + 1e-6 * abs(energy))
        assert float(row["least_time_s"]) < float(row["running_time_s"]) <= time_s + TOLERANCE_S
    assert {one[:2] for one, _ in rows} == {(track, train) for track in TRACKS for train in TRAINS}
    for key, theirs in read_rows(PEER):
        assert float(rows[key]["energy_kwh"]) <= float(theirs["energy_kwh"])


def integrated_kwh(drive: Drive) -> float:
    """Net energy at the collector under constant forces: Simpson's rule on Runge–Kutta steps in time."""
    _, speeds = drive.driven
    power_w = drive.electric_n * speeds + drive.loss(np.broadcast_to(drive.electric_n, speeds.shape), speeds)
    weights = np.array([1.0, *([4.0, 2.0] * (SUBSTEPS // 2 - 1)), 4.0, 1.0]) / 3.0
    return float((weights @ power_w * drive.step_s).sum()) / SUBSTEPS / KWH


@pytest.mark.slow
@pytest.mark.parametrize(
    ("problem", "time_s"),
    [
        (Instance("CH_Fribourg_Bern", "CH_Stadler_FLIRT_TPF", CONSTANT, BOTH), 1161.5),
        (Instance("00_var_speed_limit_100", "NL_Intercity_VIRM6", "constant 0.875/0.7", BOTH), 1612.3),
        (Instance("SE_Vasteras_Kolback", "NL_Intercity_VIRM6", CHAIN, BOTH), 656.1),
    ],
)
def test_a_published_energy_is_found_again_and_integrated_by_a_witness(problem: Instance, time_s: float) -> None:
    """In fine steps, with raw data: our energies are at or below the peer's for the same time."""
    with_map = problem.loss_model == CHAIN
    map_path = shared_data() / "loss_maps" / "NL_Intercity_VIRM6_chain.csv" if with_map else None
    section, line, train, loss = pose_reference(problem, map_path)
    run = refined(solve_front(section, threads=1).trajectory(time_s, tolerance_s=TOLERANCE_S))
    rows, ends_m = csv_rows(run.trajectory), (section.start_m, section.end_m)
    assert verify(rows, line, train, loss, ends_m=ends_m, end_speeds_mps=(1.0, 1.0)) == []
    witness_kwh = integrated_kwh(Drive(rows, line, train, loss))
    published, theirs = (dict(read_rows(table))[problem, time_s] for table in (RESULTS, PEER))
    print(f"{witness_kwh:.4f} kWh, published {published['energy_kwh']}, theirs {theirs['energy_kwh']}")
    assert float(published["energy_kwh"]) == pytest.approx(run.balance.input / KWH, rel=1e-4)
    assert float(published["energy_kwh"]) == pytest.approx(witness_kwh, rel=2e-4)
    assert witness_kwh <= float(theirs["energy_kwh"])


# ------------------------------------------------------------------------------------------------- the command


def table(units: dict[str, str], values: list[list[float]]) -> dict[str, Any]:
    return {"units": units, "values": values}


def track(slope_permil: float) -> dict[str, Any]:
    return {
        "metadata": {"id": "short"},
        "altitude": {"unit": "m", "value": 0},
        "stops": {"unit": "m", "values": [0, 2000]},
        "speed limits": table({"position": "m", "velocity": "km/h"}, [[0, 80], [1000, 60]]),
        "gradients": table({"position": "m", "slope": "permil"}, [[0, slope_permil]]),
    }


HEAD = "track,train,loss_model,brakes,time_s,energy_kwh\n"
THEIRS = HEAD + "short,own,constant 0.90/0.8,electric,130,9.5\nshort,own,constant 0.9/0.8,electric,10,9\n"
THEIRS += "short,own,map other,electric,130,9\n"


@pytest.fixture
def library(tmp_path: Path) -> Path:
    """A library of two tracks, one of them too steep, and a train; beside it the results of another solver."""
    for kind, name, content in (
        ("tracks", "short", track(2.0)),
        ("tracks", "steep", track(200.0)),
        ("trains", "own", {**TRAIN, "metadata": {"id": "own"}}),
    ):
        (tmp_path / kind).mkdir(exist_ok=True)
        (tmp_path / kind / f"{name}.json").write_text(json.dumps(content), encoding="utf-8")
    (tmp_path / "theirs.csv").write_text(THEIRS, encoding="utf-8")
    return tmp_path


def solve(library: Path, ttobench: Path | None = None, loss_map: Path | None = None) -> list[str]:
    """The lines of the table after the command."""
    out = library / "ours.csv"
    results(ttobench, loss_map, library / "theirs.csv", out)
    return out.read_text(encoding="utf-8").splitlines()


def test_a_tiny_library_is_solved_compared_and_an_interrupted_run_continues(
    library: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    head, *rows = solve(library, library)
    said = capsys.readouterr()
    assert head == ",".join(COLUMNS)
    found = [dict(zip(COLUMNS, row.split(","), strict=True)) for row in rows]
    (asked,) = (one for one in found if one["time_s"] == "130")
    (pair,) = (one for one in found if one is not asked)
    assert float(pair["time_s"]) == pytest.approx((1 + BUFFER_RATIO) * float(pair["least_time_s"]), abs=0.11)
    assert (asked["time_s"], asked["running_time_s"][:5], asked["brakes"]) == ("130", "130.0", "electric")
    assert 0.0 <= float(asked["gap_percent"]) < 0.2
    above = 100.0 * (9.5 / float(asked["energy_kwh"]) - 1.0)
    line = f"| short | own | constant 0.9/0.8 | electric | 130 | 9.50 | {float(asked['energy_kwh']):.2f} |"
    assert line in said.out
    assert f"| {above:+.2f} % |" in said.out
    for words in ("steep own", "no row for 10 s; the least running time is", "2 of 3 rows"):
        assert words in said.err
    (library / "ours.csv").write_text(f"{head}\n{rows[0].replace('1 core', 'kept core')}\n", encoding="utf-8")
    again = solve(library, library)
    assert "kept" in again[1]
    assert [row.split(",")[:10] for row in again[2:]] == [row.split(",")[:10] for row in rows[1:]]
    assert solve(library) == again
    (library / "theirs.csv").write_text(HEAD + "short,own,constant 0.9/0.8,electric,130,1\n", encoding="utf-8")
    solve(library)
    assert "energies below the proven bound: 1 of 1;" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("theirs", "message"),
    [
        ("track,train\n", r"columns = 'track, train': expected also loss_model, brakes, time_s, energy_kwh"),
        (HEAD + "../a,own,map b,electric,1,1\n", r"line 2, track = '\.\./a': expected the name of a file"),
        (HEAD + "a,own,0.9,electric,1,1\n", "line 2, loss_model = '0.9': expected constant"),
        (HEAD + "a,own,map b,air,1,1\n", r"line 2, brakes = 'air': expected electric or electric\+pneumatic"),
        (HEAD + "a,own,map b,electric,1\n", "line 2, energy_kwh = '': expected a number"),
    ],
)
def test_a_bad_table_is_refused_with_file_line_and_column(library: Path, theirs: str, message: str) -> None:
    (library / "theirs.csv").write_text(theirs, encoding="utf-8")
    with pytest.raises(InputError, match=rf"theirs\.csv: {message}"):
        solve(library, library)
    assert not (library / "ours.csv").exists()


def test_a_folder_that_is_no_library_and_a_map_without_one_are_refused(library: Path) -> None:
    with pytest.raises(DasError, match="expected the folder of TTOBench"):
        solve(library, library / "tracks")
    with pytest.raises(DasError, match="--loss-map: expected together with --ttobench"):
        solve(library, None, library / "theirs.csv")


def test_an_empty_last_cell_stays_a_cell(tmp_path: Path) -> None:
    write_csv(tmp_path / "a.csv", ["| a | b |", "|---|---|", "| 1 |  |"])
    assert (tmp_path / "a.csv").read_text(encoding="utf-8") == "a,b\n1,\n"
