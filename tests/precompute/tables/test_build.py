"""Builds of many tables: plans, resuming, workers that die, and a cluster, with real processes."""

from __future__ import annotations

import json
import multiprocessing
import os
import pickle
import re
import signal
import subprocess
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from distributed import Client

from das.domain.errors import DasError
from das.domain.files.load import load_route
from das.domain.files.writing import folder_held
from das.domain.levels import Level
from das.table import Table
from precompute import workers
from precompute.tables.build import BuildStatus, build, finished, solve_jobs, table_files
from precompute.tables.plan import USUAL, read_plan
from precompute.tables.writing import Job, TableSettings
from precompute.workers import Workers, differences, environment
from tests.das.domain.files.refusing import refused
from tests.support import small_tables
from tests.support.dask_cluster import running_cluster
from tests.support.making import REPOSITORY, das_precompute, flat, in_a_process, printed, started, wait_until
from tests.support.making import refused as refused_command

SMALL = TableSettings(buffers_percent=(0.0, 10.0), with_max=False, refined=False, proven=0)
HEAD = "schema_version = 1\n"
ROUTE = '[[routes]]\nroute = "flat-6km"\n'
TRAIN = '[[trains]]\nvehicle = "re460-ic"\n'
BASE = HEAD + ROUTE + TRAIN
QUICK = "[tables]\nbuffers_percent = [0, 10]\nmax = false\nproven = 1\n"


def job(number: int, kind: type[Job] = Job) -> Job:
    """A small section, longer by its number."""
    length_m = 1000.0 + 50.0 * number
    route = replace(flat(length_m, 25.0), id=f"job-{number}")
    return kind(
        route=route, vehicle=small_tables.train(), level=Level.OWN, start_m=0.0, end_m=length_m, braking=None,
        settings=SMALL,
    )  # fmt: skip


class PoisonJob(Job):
    """A job that takes its worker down."""

    def solve(self) -> bytes:
        os.kill(os.getpid(), signal.SIGKILL)
        raise AssertionError("unreachable")


class FaultyJob(Job):
    """A job that meets a fault of the solver."""

    def solve(self) -> bytes:
        return bytes([1 // 0])


def plan_file(folder: Path, text: str) -> Path:
    path = folder / "plan.toml"
    path.write_text(text)
    return path


# Plans


def test_a_plan_is_every_section_with_every_train(tmp_path: Path) -> None:
    vehicle = (REPOSITORY / "das/domain/catalogue/vehicles/re460-ic.toml").read_text()
    (tmp_path / "train.toml").write_text(f"{vehicle}\n[loads.full]\nmass_t = 500\n[loads.empty]\nmass_t = 400\n")
    text = (
        HEAD
        + '[[routes]]\nroute = "zurich-luzern"\nreverse = "both"\nstops = ["Zürich HB", "Zug", "Luzern"]\n'
        + ROUTE
        + '[[trains]]\nvehicle = "train.toml"\nloads = ["empty", "full"]\nlevels = ["l3", "l1"]\n'
        + TRAIN
        + "[tables]\nbuffers_percent = {from = 0, to = 20, step = 2.5}\n"
    )
    plan = read_plan(plan_file(tmp_path, text))
    assert len(plan.jobs) == (2 * 2 + 1) * (2 * 2 + 1)
    labels = [job.name.rpartition("_")[0] for job in plan.jobs]
    assert "zurich-luzern_zurich-hb-zug_re460-ic-full_l1" in labels
    assert "zurich-luzern_luzern-zug_re460-ic_l3" in labels
    assert plan.jobs[0].settings == TableSettings(buffers_percent=tuple(np.arange(0, 20.1, 2.5)))
    back = plan.jobs[labels.index("zurich-luzern_luzern-zug_re460-ic_l3")]
    stops = {stop.name: stop.position_m for stop in load_route("zurich-luzern").stops}
    assert back.end_m - back.start_m == pytest.approx(stops["Luzern"] - stops["Zug"])
    assert plan.jobs[labels.index("flat-6km_a-b_re460-ic-full_l3")].vehicle.mass_kg == 500e3


BAD_PLANS: dict[str, tuple[str, str]] = {
    "no schema": (ROUTE + TRAIN, "schema_version is missing: expected 1"),
    "unknown key": (BASE + "[table]\n", "table = {}: expected one of the keys"),
    "no routes": (HEAD + TRAIN, "routes is missing: expected at least one"),
    "no trains": (HEAD + ROUTE, "trains is missing: expected at least one"),
    "routes is no list": (HEAD + "routes = 1\n" + TRAIN, r"routes = 1: expected \[\[routes\]\] tables"),
    "unknown route": (HEAD + ROUTE.replace("flat-6km", "nowhere") + TRAIN, r"routes\[0\].route = 'nowhere': .*bundled"),
    "missing file": (HEAD + ROUTE.replace("flat-6km", "a.toml") + TRAIN, r"routes\[0\].route = 'a.toml': .*no such"),
    "route without name": (HEAD + "[[routes]]\n" + TRAIN, r"routes\[0\].route is missing: expected a string"),
    "reverse": (HEAD + ROUTE + "reverse = 1\n" + TRAIN, r'routes\[0\].reverse = 1: expected true, false or "both"'),
    "unknown stop": (HEAD + ROUTE + 'stops = ["A", "Q"]\n' + TRAIN, r"routes\[0\].stops = 'Q'"),
    "one stop": (HEAD + ROUTE + 'stops = ["A"]\n' + TRAIN, "expected at least two stops"),
    "stops backwards": (HEAD + ROUTE + 'stops = ["B", "A"]\n' + TRAIN, "stops = 'A': expected a stop after 'B'"),
    "stop twice": (HEAD + ROUTE + 'stops = ["A", "A"]\n' + TRAIN, "expected a list of distinct texts"),
    "unknown vehicle": (HEAD + ROUTE + TRAIN.replace("re460-ic", "x"), r"trains\[0\].vehicle = 'x'"),
    "unknown load": (BASE + 'loads = ["x"]\n', r"trains\[0\].loads = 'x': .*no load"),
    "unknown level": (BASE + 'levels = ["l9"]\n', r"trains\[0\].levels = 'l9': expected one of"),
    "level without data": (BASE + 'levels = ["own"]\n', r"levels = .*no data for level own"),
    "missing loss map": (BASE + 'loss_map = "x.csv"\n', r"loss_map = 'x.csv': .*cannot be read"),
    "buffers fall": (BASE + "[tables]\nbuffers_percent = [5, 0]\n", "expected rising numbers"),
    "no buffers": (BASE + "[tables]\nbuffers_percent = []\n", "expected rising numbers"),
    "buffer below 0": (BASE + "[tables]\nbuffers_percent = [-1]\n", "expected rising numbers"),
    "buffer text": (BASE + '[tables]\nbuffers_percent = ["a"]\n', "expected a number"),
    "step 0": (
        BASE + "[tables]\nbuffers_percent = {from = 0, to = 5, step = 0}\n",
        r"tables.buffers_percent.step = 0.0: expected a number > 0",
    ),
    "too many buffers": (
        BASE + "[tables]\nbuffers_percent = {from = 0, to = 20, step = 1e-6}\n",
        "at most 1000 buffers",
    ),
    "multipliers": (BASE + "[tables]\nmultipliers = 28\n", "multipliers = 28: expected one of the keys"),
    "max": (BASE + "[tables]\nmax = 1\n", "tables.max = 1: expected true or false"),
    "made-up lines": (BASE + "[synthetic]\nsections = 3\n", "synthetic = .*: expected one of the keys"),
    "twice the same": (HEAD + ROUTE + ROUTE + TRAIN, "expected every section and train once"),
}


@pytest.mark.parametrize("case", BAD_PLANS)
def test_a_bad_plan_is_refused(tmp_path: Path, case: str) -> None:
    text, said = BAD_PLANS[case]
    refused(read_plan, plan_file(tmp_path, text), f".*{said}")


# On this machine


def solve_all(
    jobs: Sequence[Job], folder: Path, hear: Callable[[int], None] = lambda _count: None
) -> dict[str, object]:
    """Outcomes of jobs on two workers by label; `hear` is called after each with how many there are."""
    outcomes = {}
    for outcome in solve_jobs(jobs, folder, Workers(count=2)):
        outcomes[outcome.name.partition("_")[0]] = outcome
        hear(len(outcomes))
    return outcomes


@pytest.mark.nightly
def test_a_killed_worker_costs_one_attempt_and_a_poison_job_only_itself(tmp_path: Path) -> None:
    jobs = [job(i) for i in range(12)]
    jobs.insert(3, job(20, PoisonJob))
    jobs.insert(5, job(21, FaultyJob))

    def kill_one(count: int) -> None:
        if count == 6:
            os.kill(multiprocessing.active_children()[0].pid or 0, signal.SIGKILL)

    outcomes = solve_all(jobs, tmp_path, kill_one)
    assert {label for label, outcome in outcomes.items() if outcome.status is BuildStatus.BUILT} == {
        f"job-{i}" for i in range(12)
    }
    poison, faulty = outcomes["job-20"], outcomes["job-21"]
    assert (poison.status, poison.attempts) == (BuildStatus.POISON, workers.ATTEMPTS)
    assert poison.reason == "its worker died 3 times, last by SIGKILL"
    assert (faulty.status, faulty.attempts) == (BuildStatus.FAILED, 1)
    assert "ZeroDivisionError" in faulty.reason
    attempts = [outcomes[f"job-{i}"].attempts for i in range(12)]
    assert sum(attempts) - 12 <= 1
    for path in table_files(tmp_path):
        Table.read(path)
    assert len(table_files(tmp_path)) == 12
    assert not multiprocessing.active_children()


def test_workers_that_cannot_start_are_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "serve", os.abort)
    with pytest.raises(DasError, match="workers cannot be started: 3 in a row ended at once"):
        list(solve_jobs([job(1)], tmp_path, Workers(count=1)))


def test_a_second_build_in_one_folder_is_refused(tmp_path: Path) -> None:
    plan, folder = read_plan(plan_file(tmp_path, BASE)), tmp_path / "tables"
    refused = pytest.raises(DasError, match=rf"another build is writing to it \(process {os.getpid()}\)")
    with folder_held(folder, "busy"), refused:
        build(plan, folder, Workers(count=1), print)
    assert not table_files(folder)


def test_a_table_is_kept_for_its_own_job_alone(tmp_path: Path) -> None:
    """Another braking has a table of its own name; another line or other buffers make the table anew."""
    first = job(1)
    with small_tables.quick_references():
        (tmp_path / first.name).write_bytes(first.solve())
    assert finished(tmp_path, first) == (tmp_path / first.name).stat().st_size
    gentle = replace(first, braking=USUAL.of(first.vehicle))
    assert gentle.name != first.name
    slower = replace(first, route=replace(flat(1050.0, 20.0), id=first.route.id))
    wider = replace(first, settings=replace(SMALL, buffers_percent=(0.0, 30.0)))
    for other in (slower, wider):
        assert other.name == first.name
        assert finished(tmp_path, other) is None
    assert finished(tmp_path, first) is not None


@pytest.mark.slow
def test_a_build_reports_keeps_and_replaces(tmp_path: Path) -> None:
    """One section cannot be driven; the others are built, kept, and built anew where an input has changed."""
    route = (REPOSITORY / "das/domain/catalogue/routes/flat-6km.toml").read_text().replace("6.0", "2.0")
    (tmp_path / "flat.toml").write_text(route)
    (tmp_path / "steep.toml").write_text(
        route.replace('id = "flat-6km"', 'id = "steep"').replace(
            "rows = [[0.0, 0.0]]", "rows = [[0.0, 0.0], [1.0, 100.0]]"
        )
    )
    (tmp_path / "slow.toml").write_text(route.replace('id = "flat-6km"', 'id = "slow"'))
    routes = "".join(f'[[routes]]\nroute = "{name}.toml"\n' for name in ("flat", "steep", "slow"))
    plan_file(tmp_path, HEAD + routes + TRAIN + QUICK)
    first = das_precompute(tmp_path, "build", "plan.toml", "--out", "tables", "--json", "--workers", "1")
    assert first.returncode == 1, first.stderr
    report = json.loads(first.stdout)
    assert report["counts"] == {"built": 2, "kept": 0, "failed": 1, "poison": 0, "pending": 0}
    assert report == json.loads((tmp_path / "tables/build.json").read_text())
    failed = next(section for section in report["sections"] if section["status"] == "failed")
    assert failed["name"].startswith("steep_a-b_re460-ic_l3_")
    assert "the train stalls" in failed["reason"]
    (tmp_path / "slow.toml").write_text(
        route.replace('id = "flat-6km"', 'id = "slow"').replace("[0.0, 160.0]", "[0.0, 80.0]")
    )
    again = das_precompute(tmp_path, "build", "plan.toml", "-o", "tables", "--workers", "1")
    assert again.returncode == 1
    assert "1 built, 1 kept, 1 failed" in again.stdout
    shown = json.loads(printed(tmp_path, "show", "tables", "--json"))["tables"]
    assert [row["route"] for row in shown] == ["flat-6km", "slow"]
    assert all(row["refine"] == "on" and row["refinement_saved_ratio"] > 0 for row in shown)
    assert all(row["gaps_proven"] == 1 and 0 < row["largest_gap_ratio"] < 0.02 for row in shown)
    assert shown[1]["least_time_s"] > shown[0]["least_time_s"] + 5
    listed = in_a_process("precompute.cli", "show", "tables", cwd=tmp_path)
    assert listed.returncode == 0
    assert re.search(r"slow +2\.0 +\d.*\n +A – B +\n +re460-ic, l3 *\n", listed.stdout)
    assert "gap %: largest excess of a run" in listed.stdout
    assert max(map(len, listed.stdout.splitlines())) <= 80
    size_mb = sum(row["size_bytes"] for row in shown) / 1e6
    assert 0.005 < size_mb < 0.5
    assert f"2 tables, {size_mb:.1f} MB" in listed.stdout
    damaged = tmp_path / "tables" / shown[0]["name"]
    damaged.write_bytes(damaged.read_bytes()[:-9])
    checked = in_a_process("precompute.cli", "verify", "tables", cwd=tmp_path)
    assert checked.returncode == 1
    assert "not valid JSON" in checked.stdout
    assert "1 of 2 tables are whole" in checked.stdout
    assert in_a_process("precompute.cli", "show", "tables", cwd=tmp_path).returncode == 1
    assert "not valid JSON" in refused_command(tmp_path, "show", f"tables/{damaged.name}")


BENCHMARK = ("CH_Stadler_FLIRT_TPF", "CH_Stadler_KISS_SBB", "CN_Beijing_Subway", "NL_Intercity_VIRM6")
LEVELS = 'levels = ["own", "l0-noreg", "l0-reg", "l1"]\n'
MANY = HEAD + ROUTE + "".join(f'[[trains]]\nvehicle = "{name}"\n{LEVELS}' for name in BENCHMARK) + QUICK


def started_build(folder: Path, tables: int) -> subprocess.Popen[str]:
    """A build of 16 sections in a process group of its own, on its way: so many tables are there."""
    plan_file(folder, MANY)
    words = ["-m", "precompute.cli", "build", "plan.toml", "-o", "tables", "--workers", "2", "--refine", "off"]
    process = started(*words, cwd=folder, start_new_session=True)
    assert wait_until(lambda: len(list((folder / "tables").glob("flat-6km*"))) >= tables)
    return process


def group_is_gone(process: subprocess.Popen[str]) -> bool:
    try:
        os.killpg(process.pid, 0)
    except ProcessLookupError:
        return True
    return False


def tables_of(folder: Path) -> dict[str, int]:
    """When each table of a folder was put there; all of them are whole."""
    for path in table_files(folder):
        Table.read(path)
    return {path.name: path.stat().st_mtime_ns for path in table_files(folder)}


@pytest.mark.nightly
def test_a_stopped_and_a_killed_build_go_on_where_they_were(tmp_path: Path) -> None:
    """No section is lost, none is solved twice, and no worker outlives the build."""
    tables = tmp_path / "tables"
    process = started_build(tmp_path, 3)
    os.killpg(process.pid, signal.SIGINT)
    said = process.communicate(timeout=30)[1]
    assert (process.returncode, "Traceback" in said) == (130, False), said
    assert wait_until(lambda: group_is_gone(process), for_s=10)
    stopped = tables_of(tables)
    assert json.loads((tables / "build.json").read_text())["counts"]["pending"] == 16 - len(stopped) > 0

    process = started_build(tmp_path, len(stopped) + 3)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate(timeout=30)
    assert wait_until(lambda: group_is_gone(process), for_s=10)
    killed = tables_of(tables)
    assert len(killed) < 16
    assert {name: killed[name] for name in stopped} == stopped

    done = das_precompute(tmp_path, "build", "plan.toml", "-o", "tables", "--refine", "off", "--json")
    assert done.returncode == 0, done
    progress = r"building: (\d+ of )?16 sections"  # Only a slow machine prints it, and nothing else is said.
    assert [line for line in done.stderr.splitlines() if not re.fullmatch(progress, line)] == []
    report = json.loads(done.stdout)
    assert (report["counts"]["kept"], report["counts"]["built"]) == (len(killed), 16 - len(killed))
    after = tables_of(tables)
    assert {name: after[name] for name in killed} == killed
    assert set(after) == {section["name"] for section in report["sections"]}
    assert not list(tables.glob(".*.json.*"))


# On a cluster


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A real scheduler with two real workers on the loopback."""
    with running_cluster(tmp_path_factory.mktemp("cluster"), 2) as address:
        yield address


def killed_a_worker(client: Client) -> bool:
    """Kill one of the workers that answer; False where none does (the poison job may just have taken it down)."""
    for pid in client.run(os.getpid, on_error="ignore").values():
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
            return True
    return False


@pytest.mark.nightly
def test_a_cluster_solves_the_same_and_survives_its_workers(address: str, tmp_path: Path) -> None:
    """A worker is killed in mid-build, a poison job kills others: all else is built, and nothing stays behind."""
    jobs = [job(i) for i in range(8)]
    jobs.insert(2, job(20, PoisonJob))
    for name in ("far", "near"):
        (tmp_path / name).mkdir()
    outcomes = {}
    with Client(address, set_as_default=False) as client:
        for outcome in solve_jobs(jobs, tmp_path / "far", Workers(count=1, scheduler=address)):
            outcomes[outcome.name.partition("_")[0]] = outcome
            if len(outcomes) == 3:
                assert wait_until(lambda: killed_a_worker(client))
        assert {label for label, found in outcomes.items() if found.status is BuildStatus.BUILT} == {
            f"job-{i}" for i in range(8)
        }
        assert outcomes["job-20"].status is BuildStatus.POISON
        assert wait_until(lambda: not any(client.who_has().values()))
    for outcome in solve_jobs([job(4)], tmp_path / "near", Workers(count=1)):
        near, far = tmp_path / "near" / outcome.name, tmp_path / "far" / outcome.name
        assert near.read_bytes() == far.read_bytes()


@pytest.mark.nightly
def test_a_cluster_that_differs_is_refused(address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with Client(address, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=60)
        workers.check_workers(client, address)
    monkeypatch.setattr(workers, "version", lambda _name: "0.1")
    with pytest.raises(DasError, match=r"worker tcp://.*: numpy .*, here 0.1; numba .*, here 0.1"):
        list(solve_jobs([job(1)], tmp_path, Workers(count=1, scheduler=address)))
    monkeypatch.setattr(workers, "check_workers", lambda *_: None)
    with pytest.raises(DasError, match=r"a worker that joined later: numpy .*, here 0.1"):
        list(solve_jobs([job(1)], tmp_path, Workers(count=1, scheduler=address)))


def test_a_cluster_that_is_not_there_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "CONNECT_WITHIN_S", 0.5)
    with pytest.raises(DasError, match=r"tcp://127.0.0.1:9: no Dask scheduler answers"):
        list(solve_jobs([job(1)], tmp_path, Workers(count=1, scheduler="tcp://127.0.0.1:9")))
    with pytest.raises(DasError, match=r"--scheduler 127.0.0.1:9: expected an address like tcp://HOST:8786"):
        list(solve_jobs([job(1)], tmp_path, Workers(count=1, scheduler="127.0.0.1:9")))


def test_differences_are_named() -> None:
    here = environment()
    assert differences(here, here) == ""
    assert differences(here, {**here, "numpy": "1.0"}) == f"numpy 1.0, here {here['numpy']}"
    assert "source missing" in differences(here, {k: v for k, v in here.items() if k != "source"})


def test_a_job_travels_to_another_process() -> None:
    sent = job(1)
    sent = replace(sent, vehicle=replace(sent.vehicle, losses=MappingProxyType(dict(sent.vehicle.losses))))
    received = pickle.loads(pickle.dumps(sent))
    assert received.name == sent.name
    assert received.vehicle.losses[Level.OWN] == sent.vehicle.losses[Level.OWN]
