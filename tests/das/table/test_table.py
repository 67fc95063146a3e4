"""Tables: what is written comes back, the damaged and the foreign are refused, look-ups agree with roll-outs."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from das.domain.errors import DasError, InfeasibleError
from das.domain.files import writing
from das.domain.files.load import load_route, load_vehicle
from das.domain.losses import EfficiencyLoss, Level
from das.domain.route import Route, Stop
from das.domain.vehicle import Vehicle
from das.solver import look_up_kernels, rollout_kernels
from das.solver import tolerances as tol
from das.solver.front import Fit, Front, solve_front
from das.solver.look_up import LookUp
from das.solver.section import Section, build_section
from das.table.table import (
    INFEASIBLE_STEP,
    LONGEST_BUFFER_RATIO,
    SHORTEST_BUFFER_RATIO,
    SectionTable,
    Table,
    TableError,
    TableSettings,
    make_table,
    table_ladder,
    warm_up,
    write_table,
)
from tests.support.benchmark import track_path, train_path
from tests.support.making import make_route, make_train

BUFFERS = (0.0, 2.0, 7.0, 20.0)
LENGTH_M = 5000.0
LIMITS = [(0.0, 25.0), (1500.0, 35.0), (3800.0, 20.0)]
GRADES = [(0.0, 0.0), (1000.0, 0.008), (2500.0, -0.006), (4000.0, 0.0)]


def line(length_m: float = LENGTH_M) -> Route:
    return make_route(length_m, LIMITS, GRADES)


def train() -> Vehicle:
    """100 t with a power limit, resistance and losses with an idle part; 60 m long."""
    made = make_train(
        resistance=(1500.0, 20.0, 5.0),
        power_w=1.5e6,
        loss=EfficiencyLoss(traction_ratio=0.15, brake_ratio=0.2, idle_w=30e3),
    )
    return replace(made, length_m=60.0)


@pytest.fixture(scope="module")
def section() -> Section:
    return build_section(line(), train())


@pytest.fixture(scope="module")
def front(section: Section) -> Front:
    return solve_front(section)


@pytest.fixture(scope="module")
def folder(section: Section, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("tables") / "table"
    write_table(path, make_table(section, TableSettings(buffers_percent=BUFFERS)))
    return path


@pytest.fixture(scope="module")
def bound(folder: Path, section: Section) -> SectionTable:
    return Table.open(folder).bind(section)


@pytest.fixture
def copied(folder: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(folder, tmp_path / "table"))


def states(front: Front, count: int, buffers: tuple[float, float] = (0.02, 0.3)) -> list[tuple[float, float, float]]:
    """Positions, speeds and times left all over a section."""
    rng, section = np.random.default_rng(4), front.section
    found = []
    for _ in range(count):
        s_m = float(rng.uniform(section.start_m + 10, section.end_m - 1000))
        top = float(np.interp(s_m, section.node_m, section.envelope_mps))
        v_mps = top * float(rng.uniform(0.4, 0.99))
        found.append((s_m, v_mps, front.least_time_s(s_m, v_mps) * (1 + float(rng.uniform(*buffers)))))
    return found


def test_every_trajectory_comes_back_as_it_was_solved(bound: SectionTable, front: Front) -> None:
    runs = bound.table.manifest["trajectories"]
    assert [run["buffer_percent"] for run in runs] == [*BUFFERS, None]
    least_time_s = front.fastest().time_s
    for index, run in enumerate(runs):
        buffer = run["buffer_percent"]
        solved = front.trajectory(1e9 if buffer is None else least_time_s * (1 + buffer / 100))
        stored = bound.trajectory_for(buffer)
        for name in ("s_m", "t_s", "v_mps", "force_el_n", "force_friction_n", "limit_mps"):
            np.testing.assert_array_equal(getattr(stored, name), getattr(solved.trajectory, name))
        arrays = bound.table.arrays
        np.testing.assert_allclose(arrays["run_t_s"][index], stored.t_s, rtol=1e-6)
        np.testing.assert_allclose(arrays["run_force_el_n"][index], stored.force_el_n, rtol=1e-6, atol=1e-2)
        np.testing.assert_array_equal(arrays["run_s_m"], stored.s_m)
        assert run["time_s"] == stored.time_s
        assert run["energy_input_j"] == pytest.approx(stored.ledger(train(), front.section.loss).input, rel=1e-12)
        assert run["fit"] == str(solved.fit)
    assert runs[-1]["fit"] == str(Fit.EARLY)
    energies = [run["energy_input_j"] for run in runs]
    assert energies == sorted(energies, reverse=True)


def test_policies_are_mapped_not_copied(bound: SectionTable) -> None:
    values = bound.front.value_j
    assert np.shares_memory(values, bound.table.arrays["value_j"])
    assert not values.flags.writeable
    assert (values.dtype, bound.table.arrays["time_to_go_steps"].dtype) == (np.float32, np.uint16)


def test_stored_policies_are_those_of_their_multipliers(bound: SectionTable, section: Section) -> None:
    """Values to float32; times to half a step of their 16 bits; infeasible states are marked as such."""
    solved = solve_front(section, lambda_w=bound.front.lambda_w)
    assert isinstance(solved.time_to_go_s, np.ndarray)
    known = solved.value_j < tol.UNREACHABLE
    np.testing.assert_allclose(bound.front.value_j[known], solved.value_j[known], rtol=1e-7)
    assert (bound.front.value_j[~known] > tol.UNREACHABLE).all()
    steps = bound.table.arrays["time_to_go_steps"]
    np.testing.assert_array_equal(steps == INFEASIBLE_STEP, ~known)
    low_s, step_s = bound.table.arrays["time_to_go_scale_s"]
    times_s = low_s[:, np.newaxis] + step_s[:, np.newaxis] * steps.astype(float)
    half_step_s = 0.5 * np.broadcast_to(step_s[:, np.newaxis], times_s.shape)
    assert (np.abs(times_s - solved.time_to_go_s) <= half_step_s + 1e-4)[known].all()


def test_table_answers_as_the_full_front_does(bound: SectionTable, front: Front) -> None:
    """From the start and from mid-route: the time is hit, and the energy is nearly that of 64 multipliers."""
    start = (front.section.start_m, 0.0)
    cases = [(*start, front.fastest().time_s * (1 + b)) for b in (0.003, 0.01, 0.035, 0.12, 0.3)] + states(front, 12)
    scale_j = abs(front.fastest().ledger.input)
    for s_m, v_mps, time_s in cases:
        full, stored = front.trajectory(time_s, s_m, v_mps), bound.front.trajectory(time_s, s_m, v_mps)
        assert (stored.fit, stored.feasible) == (full.fit, True)
        assert stored.fit is Fit.EARLY or abs(stored.time_s - time_s) <= 2 * tol.TIME_TOLERANCE_S
        later_j = full.lambda_w * (stored.time_s - full.time_s)
        assert stored.ledger.input + later_j - full.ledger.input < 2e-3 * scale_j


@pytest.mark.slow
def test_look_up_agrees_with_the_roll_out(bound: SectionTable, front: Front) -> None:
    scale_j = abs(front.fastest().ledger.input)
    for s_m, v_mps, time_s in states(front, 40):
        found, run = bound.look_up(s_m, v_mps, time_s), front.trajectory(time_s, s_m, v_mps)
        assert found.fit == run.fit
        assert found.energy_to_go_j == pytest.approx(run.ledger.input, abs=2e-3 * scale_j)
        assert found.time_to_go_s == pytest.approx(run.time_s, abs=0.3)
        there = int(np.searchsorted(run.trajectory.s_m, found.next_m - 1e-6))
        assert found.speed_mps == pytest.approx(run.trajectory.v_mps[there], abs=0.6)
        # The mean force by the work–energy theorem over the way to the next node.
        way = slice(0, there)
        step_m = np.diff(run.trajectory.s_m)[way]
        force_n = (run.trajectory.force_el_n + run.trajectory.force_friction_n)[way] @ step_m / step_m.sum()
        mass_kg = front.section.train.inertial_mass_kg
        other_n = 0.5 * mass_kg * (found.speed_mps**2 - run.trajectory.v_mps[there] ** 2) / step_m.sum()
        assert found.force_n == pytest.approx(force_n + other_n, abs=0.05 * front.section.train.traction_force_n)


@pytest.mark.slow
def test_look_up_from_memory_and_from_disk_agree(bound: SectionTable, front: Front) -> None:
    solved = LookUp(front)
    for s_m, v_mps, time_s in states(front, 20):
        here, there = solved(s_m, v_mps, time_s), bound.look_up(s_m, v_mps, time_s)
        assert there.speed_mps == pytest.approx(here.speed_mps, abs=0.6)
        assert there.energy_to_go_j == pytest.approx(here.energy_to_go_j, abs=2e-3 * abs(front.fastest().ledger.input))


def test_look_up_says_late_and_early(bound: SectionTable, front: Front) -> None:
    least_s = front.fastest().time_s
    start_m = front.section.start_m
    late, early = bound.look_up(start_m, 0.0, 0.9 * least_s), bound.look_up(start_m, 0.0, 1e6)
    assert (late.fit, early.fit) == (Fit.LATE, Fit.EARLY)
    assert late.time_to_go_s == pytest.approx(least_s, rel=5e-3)
    assert late.force_n == pytest.approx(front.section.train.traction_force_n)
    least = front.trajectory(1e9)
    assert early.time_to_go_s == pytest.approx(least.time_s, rel=0.05)
    assert early.energy_to_go_j < late.energy_to_go_j
    assert bound.look_up(start_m, 0.0, -5.0) == late


def test_look_up_above_the_envelope_brakes_with_all_there_is(bound: SectionTable, section: Section) -> None:
    s_m = 3790.0
    found = bound.look_up(s_m, 30.0, 100.0)
    assert found.force_n == pytest.approx(-section.train.electric_power_w / 30.0)
    assert found.speed_mps <= 20.0 + 1e-9


@pytest.mark.parametrize(
    ("s_m", "v_mps", "time_s", "error", "said"),
    [
        (-1.0, 10.0, 60.0, DasError, "position -1.0 m"),
        (LENGTH_M, 10.0, 60.0, DasError, "position 5000.0 m"),
        (100.0, -1.0, 60.0, DasError, "speed -1.0 m/s"),
        (100.0, 10.0, float("nan"), DasError, "time left nan s"),
        (LENGTH_M - 1.0, 0.0, 60.0, InfeasibleError, "no way on is known"),
    ],
)
def test_look_up_refuses(
    bound: SectionTable, s_m: float, v_mps: float, time_s: float, error: type[DasError], said: str
) -> None:
    with pytest.raises(error, match=said):
        bound.look_up(s_m, v_mps, time_s)


def test_nothing_is_compiled_after_the_warm_up(bound: SectionTable) -> None:
    kernels = (rollout_kernels.roll_out, rollout_kernels.one_step_totals, look_up_kernels.look_up)
    warm_up()
    before = [list(kernel.signatures) for kernel in kernels]
    bound.look_up(1000.0, 10.0, 150.0)
    bound.front.trajectory(300.0)
    assert [list(kernel.signatures) for kernel in kernels] == before


def test_ladder_spans_the_buffers(front: Front) -> None:
    ladder = table_ladder(front, 28)
    assert (len(ladder), ladder[0], ladder[-1]) == (28, 0.0, front.lambda_w[-1])
    assert (np.diff(ladder) > 0).all()
    times_s = solve_front(front.section, lambda_w=ladder).ladder_times_s()
    buffers = times_s / times_s[-1] - 1
    assert (np.diff(times_s) <= 1e-6).all()
    assert buffers[2] == pytest.approx(LONGEST_BUFFER_RATIO, rel=0.1)
    assert buffers[-2] == pytest.approx(SHORTEST_BUFFER_RATIO, rel=0.5)


def alter(name: str, place: int = -100) -> Callable[[Path], None]:
    def damage(folder: Path) -> None:
        content = bytearray((folder / name).read_bytes())
        content[place] ^= 1
        (folder / name).write_bytes(content)

    return damage


def cut(name: str) -> Callable[[Path], None]:
    return lambda folder: os.truncate(folder / name, (folder / name).stat().st_size - 1000)


def other_schema(folder: Path) -> None:
    manifest = json.loads((folder / "manifest.json").read_text())
    (folder / "manifest.json").write_text(json.dumps({**manifest, "schema_version": 2}))


def incomplete(folder: Path) -> None:
    manifest = json.loads((folder / "manifest.json").read_text())
    del manifest["lambda_w"], manifest["manifest_sha256"]
    body = json.dumps(manifest).encode()[:-1]
    seal = hashlib.sha256(body).hexdigest()
    (folder / "manifest.json").write_bytes(body + f',\n "manifest_sha256": "{seal}"}}'.encode())


def retouched(folder: Path) -> None:
    text = (folder / "manifest.json").read_text()
    (folder / "manifest.json").write_text(text.replace('"train": "test"', '"train": "best"'))


DAMAGES: dict[str, tuple[Callable[[Path], None], str]] = {
    "a bit of the values": (alter("value_j.npy"), "value_j.npy: was altered"),
    "a bit of the times": (alter("time_to_go_steps.npy"), "time_to_go_steps.npy: was altered"),
    "a bit of a header": (alter("run_v_mps.npy", 20), "run_v_mps.npy: was altered"),
    "cut values": (cut("value_j.npy"), "value_j.npy: .* bytes, expected .*: was it cut"),
    "cut trajectories": (cut("run_v_mps.npy"), "run_v_mps.npy: .* bytes, expected"),
    "empty array": (lambda folder: os.truncate(folder / "grid.npy", 0), "grid.npy: cannot be read"),
    "missing array": (lambda folder: (folder / "grid.npy").unlink(), "grid.npy: is missing"),
    "another schema": (other_schema, "schema_version = 2: expected 1"),
    "retouched manifest": (retouched, "manifest.json: was altered"),
    "incomplete manifest": (incomplete, "manifest.json: lambda_w is missing"),
    "cut manifest": (cut("manifest.json"), "manifest.json: not valid JSON"),
    "manifest that is a list": (lambda folder: (folder / "manifest.json").write_text("[]"), "schema_version = None"),
    "manifest in bytes": (lambda folder: (folder / "manifest.json").write_bytes(b"\xff\xfe"), "not valid JSON"),
    "no manifest": (lambda folder: (folder / "manifest.json").unlink(), "not a table"),
    "no folder": (shutil.rmtree, "not a table"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_table_is_refused(copied: Path, damage: str) -> None:
    damaged, said = DAMAGES[damage]
    Table.open(copied).verify()
    damaged(copied)
    with pytest.raises(TableError, match=said):
        Table.open(copied).verify()


def with_mass(mass_kg: float) -> Vehicle:
    return replace(train(), mass_kg=mass_kg)


OTHERS: dict[str, tuple[Callable[[], Section], str]] = {
    "a limit": (
        lambda: build_section(make_route(LENGTH_M, [*LIMITS[:2], (3800.0, 21.0)], GRADES), train()),
        "other line$",
    ),
    "a gradient": (
        lambda: build_section(make_route(LENGTH_M, LIMITS, [(0.0, 0.001), *GRADES[1:]]), train()),
        "other line$",
    ),
    "the mass": (lambda: build_section(line(), with_mass(110e3)), "other train .*mass_kg 100000.0, not 110000.0"),
    "the train's length": (lambda: build_section(line(), train(), point_mass=True), "other line, train|other train"),
    "the level": (lambda: build_section(line(), train(), level=Level.L1), "other losses .*level 'own', not 'l1'"),
    "the brakes": (lambda: build_section(line(), train(), level=Level.L0_NOREG), "other train, losses"),
    "the end": (lambda: build_section(line(), train(), end_m=4900.0), "ends .*end_m 5000.0, not 4900.0"),
    "the end speed": (lambda: build_section(line(), train(), end_speed_mps=5.0), "other ends"),
}


@pytest.mark.parametrize("other", OTHERS)
def test_a_table_of_another_section_is_refused(folder: Path, other: str) -> None:
    made, said = OTHERS[other]
    with pytest.raises(TableError, match=said):
        Table.open(folder).bind(made())


def test_a_table_of_another_solver_is_refused(folder: Path, section: Section, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tol, "MAX_STEP_M", 90.0)
    with pytest.raises(TableError, match="other solver"):
        Table.open(folder).bind(section)


def test_settings_of_journeys_do_not_matter(folder: Path, section: Section, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tol, "JOURNEY_TIME_TOLERANCE_S", 0.5, raising=False)
    Table.open(folder).bind(section)


def test_a_table_on_another_grid_is_refused(folder: Path, section: Section) -> None:
    shifted = replace(section, node_m=section.node_m + 1e-4)
    with pytest.raises(TableError, match="another grid"):
        Table.open(folder).bind(shifted)


def test_names_and_what_lies_outside_do_not_matter(folder: Path) -> None:
    longer = make_route(LENGTH_M + 2000.0, [*LIMITS, (LENGTH_M, 44.0)], [*GRADES, (LENGTH_M + 500.0, 0.02)])
    renamed = replace(
        longer, id="other", name="other", source="other", stops=(Stop(name="X", position_m=0.0), *longer.stops[1:])
    )
    vehicle = replace(train(), id="other", name="other", comfort_power_w=1e5)
    Table.open(folder).bind(build_section(renamed, vehicle, end_m=LENGTH_M))


def test_rounding_of_another_processor_does_not_matter(folder: Path, section: Section) -> None:
    Table.open(folder).bind(replace(section, vehicle=with_mass(100e3 * (1 + 1e-14))))


def test_unknown_buffer_is_refused(bound: SectionTable) -> None:
    with pytest.raises(TableError, match="no trajectory for a buffer of 3 %; it has 0, 2, 7, 20, max"):
        bound.trajectory_for(3.0)


def test_the_same_section_gives_the_same_bytes(folder: Path, section: Section) -> None:
    again = make_table(section, TableSettings(buffers_percent=BUFFERS), threads=2)
    assert {name: (folder / name).read_bytes() for name in again} == again


def test_writing_that_fails_leaves_what_was_there(
    folder: Path, copied: Path, section: Section, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []

    def full_disk(handle: int) -> None:
        calls.append(handle)
        if len(calls) == 3:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(writing.os, "fsync", full_disk)
    files = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(DasError, match=r"cannot be written .No space left"):
        write_table(copied, files)
    assert [path.name for path in copied.parent.iterdir()] == ["table"]
    Table.open(copied).verify()


def test_writing_replaces_a_table(copied: Path, folder: Path) -> None:
    cut("value_j.npy")(copied)
    write_table(copied, {path.name: path.read_bytes() for path in folder.iterdir()})
    Table.open(copied).verify()
    assert [path.name for path in copied.parent.iterdir()] == ["table"]


def test_a_31_km_section_fits_into_15_mb() -> None:
    """With the 41 trajectories and the least-energy run that a table holds by default."""
    route = load_route(str(track_path("CH_Fribourg_Bern")))
    vehicle = load_vehicle(str(train_path("CH_Stadler_FLIRT_TPF")))
    files = make_table(build_section(route, vehicle), threads=2)
    manifest = json.loads(files["manifest.json"])
    assert len(manifest["trajectories"]) == 42
    assert all(run["feasible"] for run in manifest["trajectories"])
    assert sum(map(len, files.values())) <= 15e6
