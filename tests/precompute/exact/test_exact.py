"""The exact front against brute force over every path of tiny grids, and the fast solver against the exact front."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from das.domain.errors import DasError, InfeasibleError
from das.domain.files.load import load_route, load_vehicle
from das.domain.levels import Level
from das.domain.losses import EfficiencyLoss, LossModel
from das.domain.vehicle import BrakePolicy
from das.solver.section import Section, SectionOptions, build_section
from das.solver.solve import solve_front
from precompute.exact.front import ExactFront, Limits, solve_exact
from precompute.exact.grid import Grid
from tests.support.making import make_route, make_train

KMH = 1 / 3.6
TINY = Grid(step_m=500.0, speed_kmh=10.0, coast_kmh=1.0, lowest_kmh=20.0)


class BruteForce:
    """Every run on a grid, one after the other, with physics of its own (no tunnels, point mass)."""

    def __init__(self, section: Section, grid: Grid) -> None:
        self.section, self.grid = section, grid
        self.nodes = [
            section.start_m + grid.step_m * i for i in range(round((section.end_m - section.start_m) / grid.step_m))
        ]
        self.nodes.append(section.end_m)

    def force_n(self, k: int, a: float, b: float) -> float:
        """Mean wheel force over segment k at constant acceleration from a to b (m/s); Simpson's rule for the drag."""
        section, vehicle = self.section, self.section.vehicle
        h = self.nodes[k + 1] - self.nodes[k]
        grade = np.mean([section.route.gradients_ratio.at(self.nodes[k] + h * x) for x in (0.25, 0.75)])
        # Drag averaged over the way: v² is linear in s, so the mean over s of v is a mean over v²; many points do.
        v = np.sqrt(a * a + (b * b - a * a) * (np.arange(2_000) + 0.5) / 2_000)
        r = vehicle.resistance
        drag = float(np.mean(r.c0_n + r.c1_n_per_mps * v + r.c2_n_per_mps2 * v * v))
        return vehicle.inertial_mass_kg * (b * b - a * a) / (2 * h) + drag + vehicle.mass_kg * 9.81 * float(grade)

    def possible(self, k: int, a: float, b: float) -> bool:
        vehicle, mid, force = self.section.vehicle, 0.5 * (a + b), self.force_n(k, a, b)
        if force >= 0:
            return force <= min(vehicle.traction.max_force_n, vehicle.traction.max_power_w / mid) * (1 + 1e-9)
        brake = min(vehicle.electric_brake.max_force_n, vehicle.electric_brake.max_power_w / mid)
        return -force <= (brake + self.section.train.friction_force_n) * (1 + 1e-9)

    def cost(self, k: int, a: float, b: float) -> tuple[float, float]:
        h, mid, force = self.nodes[k + 1] - self.nodes[k], 0.5 * (a + b), self.force_n(k, a, b)
        electric = max(force, 0.0) if self.section.brakes is BrakePolicy.FRICTION else force
        return h / mid, electric * h + float(self.section.loss.loss_w(electric, mid)) * h / mid

    def coasts_to(self, k: int, a: float) -> int | None:
        """The speed (units of the coasting grid) that needs no force, by bisection."""
        low, high = 0.0, 80.0
        if self.force_n(k, a, low) > 0:
            return None
        for _ in range(60):
            mid = 0.5 * (low + high)
            low, high = (mid, high) if self.force_n(k, a, mid) < 0 else (low, mid)
        return round(low / (self.grid.coast_kmh * KMH))

    def landings(self, k: int, speed: int) -> Iterator[int]:
        unit, ratio = self.grid.coast_kmh * KMH, self.grid.ratio
        last = k == len(self.nodes) - 2
        limit = round(float(self.section.route.limits_mps.at(self.nodes[k] + 1.0)) / unit)
        if not last:
            limit = min(limit, round(float(self.section.route.limits_mps.at(self.nodes[k + 1] + 1.0)) / unit))
        lowest = round(self.grid.lowest_kmh / self.grid.coast_kmh)
        end = round(self.section.end_speed_mps / unit)
        allowed = [end] if last else list(range(lowest, limit + 1))
        coast = self.coasts_to(k, speed * unit)
        for target in allowed:
            if (target % ratio == 0 or target == coast) and self.possible(k, speed * unit, target * unit):
                yield target

    def runs(self) -> list[tuple[float, float]]:
        unit = self.grid.coast_kmh * KMH
        states = [(round(self.section.start_speed_mps / unit), 0.0, 0.0)]
        for k in range(len(self.nodes) - 1):
            moves = {}
            for speed in {state[0] for state in states}:
                moves[speed] = [(b, *self.cost(k, speed * unit, b * unit)) for b in self.landings(k, speed)]
            states = [(b, t + dt, e + de) for speed, t, e in states for b, dt, de in moves[speed]]
            assert len(states) < 2_000_000
        return [(t, e) for _, t, e in states]


def pareto(runs: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """The undominated ones; those equal but for rounding are one."""
    front: list[tuple[float, float]] = []
    for t, e in sorted(runs):
        if not front or e < front[-1][1] - 1e-2:
            if front and t - front[-1][0] < 1e-6:
                front.pop()
            front.append((t, e))
    return front


def assert_front(exact: ExactFront, section: Section, grid: Grid, max_buffer_ratio: float) -> None:
    runs = BruteForce(section, grid).runs()
    latest = min(t for t, _ in runs) * (1 + max_buffer_ratio)
    expected = np.array(pareto([run for run in runs if run[0] <= latest + 1e-7]))
    assert len(exact.time_s) == len(expected)
    assert np.allclose(exact.time_s, expected[:, 0], rtol=0, atol=1e-6)
    assert np.allclose(exact.energy_j, expected[:, 1], rtol=1e-6, atol=20.0)  # 20 J: the brute force's mean drag


def hills(length_m: float = 3_000.0) -> Section:
    route = make_route(
        length_m,
        [(0.0, 80 * KMH), (1_500.0, 60 * KMH)],
        [(0.0, 0.0), (500.0, 0.008), (1_500.0, -0.012), (2_000.0, 0.0)],
    )
    train = make_train(
        resistance=(2e3, 30.0, 6.0), power_w=1.2e6, loss=EfficiencyLoss.from_efficiencies(0.85, 0.8, 3e4)
    )
    return build_section(route, train)


def dissipating() -> Section:
    section = build_section(hills().route, replace(hills().vehicle, losses={}, default_level=Level.L0_NOREG))
    assert section.brakes is BrakePolicy.FRICTION
    return section


def run_up() -> Section:
    return build_section(hills().route, hills().vehicle, options=SectionOptions(end_speed_mps=60 * KMH))


def of_the_paper() -> Section:
    return build_section(load_route("flat-6km"), load_vehicle("re460-ic"), level=Level.L3, end_m=2_000.0)


COARSE = Grid(step_m=500.0, speed_kmh=5.0, coast_kmh=1.0, lowest_kmh=60.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("made", "buffer_ratio", "grid"),
    [(hills, 0.4, TINY), (dissipating, 1.0, TINY), (run_up, 0.5, TINY), (of_the_paper, 0.15, COARSE)],
)
def test_brute_force(made: Callable[[], Section], buffer_ratio: float, grid: Grid) -> None:
    """Hills with a lower limit, everything dissipated, a run-up, and the loss map of the paper."""
    section = made()
    assert_front(solve_exact(section, buffer_ratio, grid=grid), section, grid, buffer_ratio)


@pytest.mark.nightly
@settings(max_examples=12, deadline=None)
@given(
    traction=st.floats(0.7, 1.0),
    brake=st.floats(0.5, 1.0),
    idle_w=st.floats(0, 2e5),
    grade=st.floats(-0.01, 0.01),
    buffer_ratio=st.floats(0.0, 1.5),
)
def test_brute_force_of_random_trains(
    traction: float, brake: float, idle_w: float, grade: float, buffer_ratio: float
) -> None:
    route = make_route(2_500.0, [(0.0, 70 * KMH)], [(0.0, 0.0), (1_000.0, grade)])
    loss: LossModel = EfficiencyLoss.from_efficiencies(traction, brake, idle_w)
    section = build_section(route, make_train(resistance=(2e3, 20.0, 5.0), power_w=1.5e6, loss=loss))
    assert_front(solve_exact(section, buffer_ratio, grid=TINY), section, TINY, buffer_ratio)


@pytest.fixture(scope="module")
def paper() -> ExactFront:
    """The paper's complete case at L3 on its grid, over its first 2 km."""
    return solve_exact(of_the_paper(), 0.1)


def test_every_point_is_a_run(paper: ExactFront) -> None:
    section = paper.section
    assert (np.diff(paper.time_s) > 0).all()
    assert (np.diff(paper.energy_j) < 0).all()
    for index in np.linspace(0, len(paper.time_s) - 1, 25).astype(int):
        run = paper.trajectory(int(index))
        balance = run.balance(section.vehicle, section.loss)
        assert run.time_s == pytest.approx(float(paper.time_s[index]), abs=1e-6)
        assert balance.input == pytest.approx(float(paper.energy_j[index]), abs=1.0)
        assert balance.residual_ratio < 1e-9
        mid = run.mean_speed_mps()
        assert (run.force_el_n <= section.vehicle.traction.force_n(mid) * (1 + 1e-6)).all()
        assert (run.v_mps <= 160 * KMH + 1e-9).all()
        speeds = run.v_mps[1:-1] / KMH
        assert (speeds >= 20 - 1e-9).all()
        assert np.allclose(speeds / 0.01, np.round(speeds / 0.01), atol=1e-6)
        coasting = np.abs(run.force_el_n) < 1.1 * 440e3 * 0.005 * KMH * mid / 100  # half a step of the sub-grid
        off_grid = ~np.isclose(speeds / 0.25, np.round(speeds / 0.25), atol=1e-6)
        assert (coasting[:-1] | ~off_grid).all(), "only coasting leads off the coarse grid"


def test_the_fast_solver_agrees_with_the_exact_front(paper: ExactFront) -> None:
    # The fast solver is not bound to the grid: it may be a little better, never much, and must not be worse.
    front = solve_front(paper.section)
    for buffer_ratio in (0.02, 0.05, 0.07, 0.09):
        time_s = paper.least_time_s * (1 + buffer_ratio)
        exact_j = float(paper.energy_j[paper.index_at(time_s)])
        fast_j = front.trajectory(time_s).balance.input
        assert fast_j < exact_j * 1.001
        assert fast_j > exact_j * 0.98


def test_supported_and_swept_runs_are_close_and_nothing_is_below_the_front_or_its_bound(paper: ExactFront) -> None:
    assert (paper.gap_ratio >= -1e-12).all()
    assert paper.gap_ratio.max() < 0.005
    assert paper.gap_ratio[0] == pytest.approx(0, abs=1e-12)
    swept = paper.swept_gap_ratio
    assert len(swept) > 100
    assert swept.min() >= 0
    assert swept.min() == pytest.approx(0, abs=1e-12), "supported runs are on the front"
    assert np.median(swept) < 1e-4
    assert swept.max() < 0.005
    assert (paper.bound_j <= np.minimum(paper.energy_j, paper.supported_j) + 1e-2).all()
    assert ((paper.energy_j - paper.bound_j) / paper.energy_j).mean() < 0.001


@pytest.mark.nightly
def test_buckets_give_runs_between_the_exact_front_and_a_little_more(paper: ExactFront) -> None:
    near = solve_exact(paper.section, 0.1, limits=Limits(bucket_ms=20.0))
    exact_j = paper.energy_j[[paper.index_at(time_s) for time_s in near.time_s]]
    assert (near.energy_j >= exact_j - 1e-3).all()
    assert (near.energy_j / exact_j - 1).mean() < 1e-3
    assert near.swept_gap_ratio.min() >= 0
    assert near.labels < paper.labels
    for index in np.linspace(0, len(near.time_s) - 1, 25).astype(int):
        run = near.trajectory(int(index))
        assert run.time_s == pytest.approx(float(near.time_s[index]), abs=1e-6)
        energy_j = run.balance(paper.section.vehicle, paper.section.loss).input
        assert energy_j == pytest.approx(float(near.energy_j[index]), abs=1.0)


def test_a_larger_buffer_only_adds_points() -> None:
    section = hills()
    small, large = (solve_exact(section, ratio, grid=TINY) for ratio in (0.2, 0.6))
    count = len(small.time_s)
    assert len(large.time_s) > count
    assert np.array_equal(small.time_s, large.time_s[:count])
    assert np.array_equal(small.energy_j, large.energy_j[:count])


def test_the_time_asked_for_is_kept(paper: ExactFront) -> None:
    index = paper.index_at(paper.least_time_s * 1.05)
    assert paper.time_s[index] <= paper.least_time_s * 1.05 < paper.time_s[index + 1]
    with pytest.raises(DasError, match="expected at least"):
        paper.index_at(paper.least_time_s - 1.0)


def test_what_cannot_be_done_is_refused() -> None:
    section = hills()
    with pytest.raises(DasError, match=r"needs more than 0\.0 GB after 2 of 6 intervals"):
        solve_exact(section, 0.4, grid=TINY, limits=Limits(max_memory_bytes=500.0))
    with pytest.raises(DasError, match=r"a speed of 36 km/h at an end of the section, expected a multiple of 10 km/h"):
        solve_exact(
            build_section(section.route, section.vehicle, options=SectionOptions(start_speed_mps=10.0)), 0.4, grid=TINY
        )
    with pytest.raises(InfeasibleError, match="no run on the exact front's grid beyond"):
        solve_exact(section, 0.4, grid=replace(TINY, step_m=20.0, speed_kmh=30.0))  # 23 km/h after 20 m


def test_without_losses_time_is_free() -> None:
    # Regenerative, lossless, no resistance: every run needs nothing, so that the front is one point but for rounding.
    section = build_section(make_route(2_000.0, [(0.0, 60 * KMH)], [(0.0, 0.0)]), make_train())
    exact = solve_exact(section, 0.5, grid=TINY)
    assert len(exact.time_s) <= 3
    assert np.abs(exact.energy_j).max() < 0.01
