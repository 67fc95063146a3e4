"""The bench: every figure with its baseline, plain witnesses of what it times; no test asserts a duration."""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path

import numpy as np
import pytest

from das.domain.losses import EfficiencyLoss
from das.solver.front import Front
from das.solver.section import Section, build_section
from das.solver.solution import Fit, trajectory_on
from das.solver.solve import solve_front
from precompute.bench.command import NAMES, bench, figures_by_name, longest_section, measure
from precompute.bench.figures import QUICK, Workload, made_up_section
from precompute.bench.measuring import CACHED_NUMBERS, CHAIN, REPEATS, Figure, Roofline, Times, in_turns, peak_bytes_of
from precompute.bench.plain import bisected, numpy_sweep, plain_front
from precompute.bench.table_figures import departures
from precompute.tables.synthetic import made_up_line
from tests.support.closeness import assert_close
from tests.support.making import in_a_process, make_route, make_train
from tests.support.transitions import all_moves

UNBOUNDED = {"trajectory", "look-up", "cold-start", "build", "exact", "memory"}
"""The figures for which no bound is known."""


@pytest.fixture(scope="module")
def section() -> Section:
    """Limits, hills that need a run-up, losses: some states cannot be finished from."""
    route = make_route(
        6_000.0,
        [(0.0, 30.0), (2_500.0, 22.0), (3_500.0, 40.0)],
        [(0.0, 0.0), (1_000.0, 0.012), (3_000.0, -0.01), (4_200.0, 0.12), (4_350.0, 0.0)],
    )
    train = make_train(resistance=(1500.0, 20.0, 4.0), loss=EfficiencyLoss.from_efficiencies(0.88, 0.85, 2e4))
    return build_section(route, train)


@pytest.fixture(scope="module")
def front(section: Section) -> Front:
    return solve_front(section)


# --- the solver's way and the plain way -------------------------------------------------------------------------


@pytest.mark.parametrize(("threads", "block_nodes"), [(1, 10_000), (2, 10_000), (1, 1), (3, 7), (2, 32)])
def test_blocks_and_threads_change_no_bit(section: Section, front: Front, threads: int, block_nodes: int) -> None:
    other = solve_front(section, threads=threads, block_nodes=block_nodes)
    assert np.array_equal(other.value_j, front.value_j)
    assert np.array_equal(other.time_to_go_s, front.time_to_go_s)


def test_the_sweep_is_the_plain_recursion(section: Section, front: Front) -> None:
    value_j, time_to_go_s = numpy_sweep(all_moves(section), front.lambda_w)
    unreachable = front.value_j > 1e29
    assert unreachable.any()
    assert np.array_equal(value_j > 1e29, unreachable)
    assert np.allclose(value_j[~unreachable], front.value_j[~unreachable], rtol=1e-12, atol=1e-6)
    # Where two landings cost the same the time may differ: the value does not say which it was.
    close = np.isclose(time_to_go_s[~unreachable], front.time_to_go_s[~unreachable], rtol=1e-4)
    assert close.mean() > 0.999


@pytest.mark.parametrize("buffer_ratio", [0.02, 0.05, 0.1, 0.2, 0.4])
def test_the_search_for_a_time_finds_what_bisection_finds(section: Section, front: Front, buffer_ratio: float) -> None:
    """The same energy, but for the price of the time between the two (bisection ends at either side of a jump)."""
    time_s = front.fastest().time_s * (1 + buffer_ratio)
    solution = front.trajectory(time_s)
    speeds, found_s = bisected(front, time_s)
    plain = trajectory_on(section, section, speeds)
    assert plain.time_s == pytest.approx(found_s)
    assert found_s == pytest.approx(time_s, rel=0.02)
    assert solution.fit is Fit.ON_TIME
    input_j = plain.balance(section.vehicle, section.loss).input + solution.lambda_w * (found_s - solution.time_s)
    assert solution.balance.input == pytest.approx(input_j, rel=3e-4)


def test_the_departures_that_are_looked_up_have_time_to_spare(section: Section) -> None:
    least_s = solve_front(section).fastest().time_s
    ratios = [one.left_s / least_s for one in itertools.islice(departures(section), 5)]
    assert ratios == pytest.approx([1.03, 1.05, 1.08, 1.12, 1.03], rel=1e-3)


def test_the_work_is_counted(section: Section) -> None:
    moves, load = all_moves(section), Workload.of(section)
    assert load.landings == moves.count.sum()
    assert (load.nodes, load.states) == moves.count.shape
    value_j = solve_front(section).value_j
    assert load.result_bytes == value_j.nbytes * 3 // 2


# --- made-up lines ----------------------------------------------------------------------------------------------


def test_a_seed_makes_the_same_line_again() -> None:
    line, again, other = made_up_line(20.0, 3), made_up_line(20.0, 3), made_up_line(20.0, 4)
    assert np.array_equal(line.breakpoints_m(), again.breakpoints_m())
    assert not np.array_equal(line.breakpoints_m(), other.breakpoints_m())
    assert len(line.breakpoints_m()) == 100
    assert line.breakpoints_m()[-1] < line.length_m == 20_000.0


@pytest.mark.parametrize("length_km", [*QUICK.lengths_km, 30.0, 300.0])
def test_the_bundled_train_can_run_on_the_made_up_lines(length_km: float) -> None:
    assert made_up_section(length_km).end_m == 1e3 * length_km


# --- measuring --------------------------------------------------------------------------------------------------


def test_both_are_timed_in_turns() -> None:
    calls: list[str] = []
    times = in_turns(lambda: calls.append("own"), lambda: calls.append("other"), rounds=3, baseline_rounds=2)
    assert calls == ["own", "other", "own", "other", "own", "other", "own"]
    assert (len(times.seconds), len(times.baseline_seconds)) == (3, 2)


def test_a_duration_and_a_rate_say_how_many_times_better() -> None:
    times = Times(seconds=[0.3, 0.2, 0.1], baseline_seconds=[0.8, 0.8])
    duration = times.figure("a", "what", "ms", "other", ("bound", 0.05))
    rate = times.figure("b", "what", "million/s", "other", ("bound", 0.05), amount=10.0)
    assert (duration.value, duration.least, duration.most, duration.baseline_value) == pytest.approx(
        (200, 100, 300, 800)
    )
    assert (rate.value, rate.least, rate.most, rate.baseline_value) == pytest.approx((50, 100 / 3, 100, 12.5))
    for figure in (duration, rate):
        assert figure.ratio == pytest.approx(4.0)
        assert figure.bound_ratio == pytest.approx(0.25)


def test_peak_memory_sees_what_a_call_allocates() -> None:
    peak = peak_bytes_of(lambda: np.ones(10_000_000).sum())
    if peak is None:
        pytest.skip("this system does not say how much memory a process has had")
    assert 75e6 < peak < 120e6


def test_the_roofline_adds_arithmetic_and_threads_share_it() -> None:
    roofline = Roofline(threads=1, flops=1e10, divisions_ps=1e9)
    assert roofline.least_s(flop=1e10, divisions=1e9) == pytest.approx(2.0)
    assert roofline.of_threads(2).least_s(flop=1e10, divisions=1e9) == pytest.approx(1.0)
    assert roofline.of_threads(2).of_threads(1) == roofline
    measured = Roofline.measured()
    assert all(math.isfinite(rate) and rate > 0 for rate in vars(measured).values())


def test_rates_are_operations_by_the_time_that_they_took(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("precompute.bench.measuring.timed", lambda _work, _rounds: [4.0, 2.0])
    measured = Roofline.measured()
    assert measured.divisions_ps == REPEATS * CACHED_NUMBERS / 2.0
    assert measured.flops == 2.0 * CHAIN * measured.divisions_ps


def test_the_bound_of_a_front_is_below_the_quickest_of_300_fronts() -> None:
    """Rates of `Roofline.measured` and least times of `solve_front`, measured on a busy AMD EPYC on 2026-11-26."""
    roofline = Roofline(threads=1, flops=59.1e9, divisions_ps=3.28e9)
    work = Workload.of(longest_section("flat-6km", "re460-ic"))
    for threads, quickest_s in ((1, 17.28e-3), (2, 18.37e-3)):
        bound_s = work.least_s(roofline.of_threads(threads))
        assert 0.05 * quickest_s < bound_s < quickest_s


def test_the_plain_front_is_the_front() -> None:
    """Transitions of one speed after the other give the same values, to rounding, in any number of threads."""
    section = longest_section("flat-6km", "re460-ic")
    plain, front = plain_front(section, 2), solve_front(section)
    reached = front.value_j < 1e16
    assert_close(np.asarray(plain.value_j)[reached], np.asarray(front.value_j)[reached], rel=1e-6, absolute=10.0)


# --- the command ------------------------------------------------------------------------------------------------


@pytest.mark.nightly
def test_every_figure_has_a_baseline_and_a_true_bound_or_none() -> None:
    assert list(figures_by_name()) == list(NAMES)
    result = measure(list(NAMES), longest_section("flat-6km", "re460-ic"), 2, quick=True)
    figures = json.loads(json.dumps(result))["figures"]
    names = [figure["name"] for figure in figures if figure["name"] != "cold-start"]
    expected = [name for name in NAMES if name not in {"growth", "memory"}]
    assert names[: len(expected)] == expected
    assert names[len(expected) :][:2] == ["growth-2km", "growth-5km"]
    for figure in figures:
        assert set(Figure.__dataclass_fields__) < set(figure)
        assert figure["baseline"]
        assert 0 < figure["least"] <= figure["value"] <= figure["most"]
        for key in ("baseline_value", "ratio"):
            assert 0 < figure[key] < math.inf
        bounds = {figure[key] is None for key in ("bound", "bound_value", "bound_ratio")}
        assert bounds == {figure["name"] in UNBOUNDED}
        assert figure["bound_ratio"] is None or 0 < figure["bound_ratio"] < 1
    assert {"cpu", "cores", "numba", "date"} <= set(result["machine"])
    assert result["roofline"]["threads"] == 1


@pytest.mark.nightly
def test_the_command_prints_json(tmp_path: Path) -> None:
    words = ("bench", "--quick", "--only", "memory,trajectory", "--threads", "1", "--json")
    run = in_a_process("precompute.cli", *words, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    result = json.loads(run.stdout)
    assert result["figures"][0]["name"] == "trajectory"
    assert result["took_s"] > 0


def test_the_command_prints_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    bench(only="re-solve", quick=True, threads=2)
    printed = capsys.readouterr().out
    assert "re-solve" in printed
    assert "× better" in printed
    assert "one thread at best:" in printed
    assert "× better: how many times better than the baseline" in printed
    assert max(map(len, printed.splitlines())) <= 80


def test_the_longest_section_is_taken() -> None:
    section = longest_section("zurich-luzern", "re460-ic")
    stops = [stop.position_m for stop in section.route.stops]
    assert section.end_m - section.start_m == max(b - a for a, b in itertools.pairwise(stops))
