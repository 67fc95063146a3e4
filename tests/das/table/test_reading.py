"""Reading tables: what is written comes back, the damaged and the foreign are refused."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from das.cab.warm_up import warm_up_tables
from das.domain.levels import Level
from das.domain.route import Stop
from das.domain.vehicle import Vehicle
from das.solver import tolerances as tol
from das.solver.front import Front
from das.solver.kernels.policy_values import UNKNOWN_STEP
from das.solver.kernels.roll_out import one_step_totals, roll_out
from das.solver.section import Section, SectionOptions, build_section
from das.solver.solution import Fit
from das.solver.solve import solve_front
from das.table.format import TableError
from das.table.reading import Table, read_front
from tests.support.making import make_route
from tests.support.small_tables import BUFFERS, GRADES, LENGTH_M, LIMITS, line, seal_anew, states, train


@pytest.fixture(scope="module")
def table(folder: Path) -> Table:
    return Table.open(folder)


@pytest.fixture(scope="module")
def stored(table: Table, section: Section) -> Front:
    """The front that the table holds."""
    return table.front(section)


@pytest.fixture
def copied(folder: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(folder, tmp_path / "table"))


def test_every_trajectory_comes_back_as_it_was_solved(table: Table, front: Front) -> None:
    runs = table.manifest["trajectories"]
    arrays = table.arrays()
    assert [run["buffer_percent"] for run in runs] == [*BUFFERS, None]
    least_time_s = front.fastest().time_s
    for index, run in enumerate(runs):
        buffer = run["buffer_percent"]
        solved = front.trajectory(1e9 if buffer is None else least_time_s * (1 + buffer / 100))
        stored = table.trajectory(front.section, buffer)
        for name in ("s_m", "t_s", "v_mps", "force_el_n", "force_friction_n", "limit_mps"):
            np.testing.assert_array_equal(getattr(stored, name), getattr(solved.trajectory, name))
        np.testing.assert_allclose(arrays["run_t_s"][index], stored.t_s, rtol=1e-6)
        np.testing.assert_allclose(arrays["run_force_el_n"][index], stored.force_el_n, rtol=1e-6, atol=1e-2)
        np.testing.assert_array_equal(arrays["run_s_m"], stored.s_m)
        assert run["time_s"] == stored.time_s
        assert run["energy_input_j"] == pytest.approx(stored.balance(train(), front.section.loss).input, rel=1e-12)
        assert run["fit"] == str(solved.fit)
    assert runs[-1]["fit"] == str(Fit.EARLY)
    energies = [run["energy_input_j"] for run in runs]
    assert energies == sorted(energies, reverse=True)


def test_what_was_read_does_not_change_with_the_files(copied: Path, section: Section) -> None:
    """The files are not mapped: a cut file would end a process that has it mapped."""
    front = read_front(copied, section)
    before = front.trajectory(250.0).balance.input
    for path in copied.glob("*.npy"):
        os.truncate(path, 100)
    assert front.trajectory(250.0).balance.input == before
    assert not front.value_j.flags.writeable
    assert front.value_j.dtype == np.float32


def test_stored_policies_are_those_of_their_multipliers(table: Table, stored: Front, section: Section) -> None:
    """Values to float32; times to half a step of their 16 bits; infeasible states are marked as such."""
    solved = solve_front(section, lambda_w=stored.lambda_w)
    assert isinstance(solved.time_to_go_s, np.ndarray)
    known = solved.value_j < tol.UNREACHABLE
    np.testing.assert_allclose(stored.value_j[known], solved.value_j[known], rtol=1e-7)
    assert (stored.value_j[~known] > tol.UNREACHABLE).all()
    steps = table.arrays()["time_to_go_steps"]
    np.testing.assert_array_equal(steps == UNKNOWN_STEP, ~known)
    low_s, step_s = table.arrays()["time_to_go_scale_s"]
    times_s = low_s[:, np.newaxis] + step_s[:, np.newaxis] * steps.astype(float)
    half_step_s = 0.5 * np.broadcast_to(step_s[:, np.newaxis], times_s.shape)
    assert (np.abs(times_s - solved.time_to_go_s) <= half_step_s + 1e-4)[known].all()


def test_table_answers_as_the_full_front_does(stored: Front, front: Front) -> None:
    """From the start and from mid-route: the time is hit, and the energy is nearly that of 64 multipliers."""
    start = (front.section.start_m, 0.0)
    cases = [(*start, front.fastest().time_s * (1 + b)) for b in (0.003, 0.01, 0.035, 0.12, 0.3)] + states(front, 12)
    scale_j = abs(front.fastest().balance.input)
    for s_m, v_mps, time_s in cases:
        full, by_table = front.trajectory(time_s, s_m, v_mps), stored.trajectory(time_s, s_m, v_mps)
        assert (by_table.fit, by_table.feasible) == (full.fit, True)
        assert by_table.fit is Fit.EARLY or abs(by_table.time_s - time_s) <= 2 * tol.TIME_TOLERANCE_S
        later_j = full.lambda_w * (by_table.time_s - full.time_s)
        assert by_table.balance.input + later_j - full.balance.input < 2e-3 * scale_j


def test_nothing_is_compiled_after_the_warm_up(stored: Front) -> None:
    kernels = (roll_out, one_step_totals)
    warm_up_tables()
    before = [list(kernel.signatures) for kernel in kernels]
    stored.trajectory(300.0)
    assert [list(kernel.signatures) for kernel in kernels] == before


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
    (folder / "manifest.json").write_text(json.dumps({**manifest, "schema_version": 1}))


def incomplete(folder: Path) -> None:
    seal_anew(folder, lambda manifest: manifest.pop("lambda_w"))


def retouched(folder: Path) -> None:
    text = (folder / "manifest.json").read_text()
    (folder / "manifest.json").write_text(text.replace('"train": "test"', '"train": "best"'))


DAMAGES: dict[str, tuple[Callable[[Path], None], str]] = {
    "a bit of the values": (alter("value_j.npy"), "value_j.npy: was altered"),
    "a bit of the times": (alter("time_to_go_steps.npy"), "time_to_go_steps.npy: was altered"),
    "a bit of a header": (alter("run_v_mps.npy", 20), "run_v_mps.npy: was altered"),
    "cut values": (cut("value_j.npy"), "value_j.npy: .* bytes, expected .*: was it cut"),
    "cut trajectories": (cut("run_v_mps.npy"), "run_v_mps.npy: .* bytes, expected"),
    "empty array": (lambda folder: os.truncate(folder / "grid.npy", 0), "grid.npy: 0 bytes, expected .*: was it cut"),
    "missing array": (lambda folder: (folder / "grid.npy").unlink(), "grid.npy: is missing"),
    "another schema": (other_schema, "schema_version = 1: expected 3"),
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
    "the train's length": (
        lambda: build_section(line(), train(), options=SectionOptions(point_mass=True)),
        "other line, train|other train",
    ),
    "the level": (lambda: build_section(line(), train(), level=Level.L1), "other losses .*level 'own', not 'l1'"),
    "the brakes": (lambda: build_section(line(), train(), level=Level.L0_NOREG), "other train, losses"),
    "the end": (lambda: build_section(line(), train(), end_m=4900.0), "ends .*end_m 5000.0, not 4900.0"),
    "the end speed": (lambda: build_section(line(), train(), options=SectionOptions(end_speed_mps=5.0)), "other ends"),
}


@pytest.mark.parametrize("other", OTHERS)
def test_a_table_of_another_section_is_refused(folder: Path, other: str) -> None:
    made, said = OTHERS[other]
    with pytest.raises(TableError, match=said):
        Table.open(folder).front(made())


def test_a_table_of_another_solver_is_refused(folder: Path, section: Section, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tol, "STEP_S", 2.9)
    with pytest.raises(TableError, match="other solver settings"):
        Table.open(folder).front(section)


def test_settings_of_journeys_do_not_matter(folder: Path, section: Section, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tol, "JOURNEY_TIME_TOLERANCE_S", 0.5, raising=False)
    Table.open(folder).front(section)


def test_a_table_on_another_grid_is_refused(folder: Path, section: Section) -> None:
    shifted = replace(section, node_m=section.node_m.copy())
    shifted.node_m[1:-1] += 1e-4
    with pytest.raises(TableError, match="another grid"):
        Table.open(folder).front(shifted)


def test_names_and_what_lies_outside_do_not_matter(folder: Path) -> None:
    longer = make_route(LENGTH_M + 2000.0, [*LIMITS, (LENGTH_M, 44.0)], [*GRADES, (LENGTH_M + 500.0, 0.02)])
    renamed = replace(
        longer, id="other", name="other", source="other", stops=(Stop(name="X", position_m=0.0), *longer.stops[1:])
    )
    vehicle = replace(train(), id="other", name="other", comfort_power_w=1e5)
    Table.open(folder).front(build_section(renamed, vehicle, end_m=LENGTH_M))


def test_rounding_of_another_processor_does_not_matter(folder: Path, section: Section) -> None:
    Table.open(folder).front(replace(section, vehicle=with_mass(100e3 * (1 + 1e-14))))


def test_unknown_buffer_is_refused(table: Table, section: Section) -> None:
    with pytest.raises(TableError, match="no trajectory for a buffer of 3 %; it has 0, 2, 7, 20, max"):
        table.trajectory(section, 3.0)
