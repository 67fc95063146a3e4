"""The figures of the bench, each beside its baseline and, where one is known, its bound."""

from __future__ import annotations

import itertools
import statistics
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from das.domain.files.load import load_route, load_vehicle
from das.domain.levels import Level
from das.domain.units import KM, KMH, MEGABYTE
from das.solver.front import Front
from das.solver.kernels.transitions import transitions
from das.solver.section import Section, SectionOptions, build_section
from das.solver.solve import BLOCK_NODES, DecisionGrid, Transitions, solve_front
from das.solver.tolerances import LADDER_SIZE
from precompute.bench.measuring import Figure, Roofline, Times, in_turns, peak_bytes_of, timed
from precompute.bench.plain import bisected, numpy_sweep, plain_front, plain_transitions
from precompute.exact.front import solve_exact
from precompute.tables.synthetic import made_up_line

DIVISIONS_PER_TRANSITION = 2
"""Divisions that each transition has to itself, in das/solver/kernels/transitions.py: 1 for its cost, 1 for its place
on the grid. Those that find the landing speeds of a state, and those of landings that are left out, come on top."""
FLOP_PER_RELAXATION = 6
"""Operations of a relaxation: three multiply-adds (das/solver/kernels/sweep.py)."""
MILLION = 1e6
BUFFERS = (0.005, 0.3)
"""The trajectories that are timed have buffers from the first to the second value, as shares of the least time."""
SHORT_STEP_M = 25.0
RESOLVED_BUFFER = 0.1
RESOLVED_SPEED_RATIO = 0.9
"""Share of the speed of the braking envelope at which the section is solved again from half-way."""
VEHICLE = "re460-ic"
EXACT_ROUTE, EXACT_LEVEL = "flat-6km", Level.L1
SHORT_KM = 30.0
"""Length (km) of a line up to which its front is solved in many rounds; those of longer lines in few."""
FRONT_BOUND = "the divisions of its transitions and the arithmetic of its sweep"


@dataclass(frozen=True, kw_only=True)
class BenchSize:
    """How much is measured: the rounds of each figure, the rounds of the slow figures, and the sizes of the tasks."""

    rounds: int
    slow_rounds: int
    trajectories: int
    built_sections: int
    lengths_km: tuple[float, ...]
    exact_buffer_ratio: float


FULL = BenchSize(
    rounds=9,
    slow_rounds=3,
    trajectories=24,
    built_sections=24,
    lengths_km=(10.0, 30.0, 100.0, 300.0),
    exact_buffer_ratio=0.02,
)
STATE_BYTES = 12
"""Size of the value and the time-to-go of a state under a multiplier (bytes)."""
QUICK = BenchSize(
    rounds=2,
    slow_rounds=1,
    trajectories=3,
    built_sections=2,
    lengths_km=(2.0, 5.0),
    exact_buffer_ratio=0.001,
)


@dataclass(frozen=True, kw_only=True)
class Workload:
    """The size of a front: its decision steps, speeds, and transitions."""

    nodes: int
    states: int
    landings: int

    @classmethod
    def of(cls, section: Section) -> Workload:
        """Count a section's transitions."""
        grid = DecisionGrid.of(section)
        nodes, states = len(grid.node_m) - 1, grid.speed_steps + 1
        moves, landings = Transitions.empty(1, states), 0
        for k in range(nodes):
            grid.fill(0, 1, k, moves)
            landings += int(moves.count.sum())
        return cls(nodes=nodes, states=states, landings=landings)

    @property
    def relaxations(self) -> int:
        return self.landings * LADDER_SIZE

    @property
    def result_bytes(self) -> int:
        """Size of the policies."""
        return (self.nodes + 1) * self.states * LADDER_SIZE * STATE_BYTES

    def least_s(self, roofline: Roofline) -> float:
        """Least time of the front: that of arithmetic which every front of this size does."""
        return roofline.least_s(
            divisions=self.landings * DIVISIONS_PER_TRANSITION, flop=self.relaxations * FLOP_PER_RELAXATION
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Reference:
    """The section of most figures, solved, and the machine's rates with one thread and with all."""

    section: Section
    front: Front
    workload: Workload
    effort: BenchSize
    threads: int
    one_thread: Roofline
    all_threads: Roofline


def front_of_reference(reference: Reference) -> Iterator[Figure]:
    """The front of the reference section."""
    section, threads = reference.section, reference.threads
    times = in_turns(
        lambda: solve_front(section, threads=threads),
        lambda: plain_front(section, threads),
        rounds=reference.effort.rounds,
    )
    yield times.figure(
        "front",
        f"front of {LADDER_SIZE} multipliers, {section.name}",
        "ms",
        "transitions of one speed after the other",
        (FRONT_BOUND, reference.workload.least_s(reference.all_threads)),
    )


def short_steps(reference: Reference) -> Iterator[Figure]:
    """The solving time with shorter decision steps, against the time with the solver's own steps."""
    section, threads = reference.section, reference.threads
    options = SectionOptions(
        start_speed_mps=section.start_speed_mps, end_speed_mps=section.end_speed_mps,
        point_mass=section.train_length_m == 0, longest_step_m=SHORT_STEP_M,
    )  # fmt: skip
    fine = build_section(
        section.route, section.vehicle, level=section.level, start_m=section.start_m, end_m=section.end_m,
        options=options,
    )  # fmt: skip
    times = in_turns(
        lambda: solve_front(fine, threads=threads),
        lambda: solve_front(section, threads=threads),
        rounds=reference.effort.rounds,
    )
    time_s = reference.front.fastest().time_s * (1 + RESOLVED_BUFFER)
    usual_j, fine_j = (front.trajectory(time_s).balance.input for front in (reference.front, solve_front(fine)))
    yield times.figure(
        "steps",
        f"front with decision steps of {SHORT_STEP_M:g} m, {len(fine.decision) - 1} instead of "
        f"{len(section.decision) - 1}; a run with {RESOLVED_BUFFER:.0%} more time needs "
        f"{fine_j / usual_j - 1:+.3%} energy",
        "ms",
        "the solver's own steps",
        (FRONT_BOUND, Workload.of(fine).least_s(reference.all_threads)),
    )


def all_at_once(section: Section) -> Front:
    """Solve the front with one thread: first all transitions, then the sweeps."""
    return solve_front(section, threads=1, block_nodes=len(section.decision))


def transition_rate(reference: Reference) -> Iterator[Figure]:
    """Transitions of the reference section per second, by one thread."""
    section, load = reference.section, reference.workload
    grid, moves = DecisionGrid.of(section), Transitions.empty(BLOCK_NODES, load.states)

    def fill(kernel: Callable[..., None]) -> None:
        for start in range(0, load.nodes, BLOCK_NODES):
            end = min(start + BLOCK_NODES, load.nodes)
            kernel(
                start, end, grid.line, grid.bounds, grid.speed_steps, section.train, section.loss_params, moves.moves
            )

    times = in_turns(lambda: fill(transitions), lambda: fill(plain_transitions), rounds=reference.effort.rounds)
    least_s = reference.one_thread.least_s(divisions=load.landings * DIVISIONS_PER_TRANSITION)
    yield times.figure(
        "transitions",
        f"transitions, {load.nodes} nodes × {load.states} speeds, one thread",
        "million/s",
        "one speed after the other",
        ("their divisions", least_s),
        amount=load.landings / MILLION,
    )


def sweep_rate(reference: Reference) -> Iterator[Figure]:
    """Relaxations (a landing tried for a multiplier) per second, by one thread."""
    load, ladder = reference.workload, reference.front.lambda_w
    moves = Transitions.empty(load.nodes, load.states)
    DecisionGrid.of(reference.section).fill(0, load.nodes, 0, moves)
    assert isinstance(reference.front.time_to_go_s, np.ndarray)
    value, time_to_go = reference.front.value_j.astype(np.float64), reference.front.time_to_go_s.copy()
    times = in_turns(
        lambda: moves.sweep(0, len(ladder), ladder, value, time_to_go),
        lambda: numpy_sweep(moves, ladder),
        rounds=reference.effort.rounds,
        baseline_rounds=1,
    )
    least_s = reference.one_thread.least_s(flop=load.relaxations * FLOP_PER_RELAXATION)
    yield times.figure(
        "sweep",
        f"relaxations of {LADDER_SIZE} multipliers, one thread",
        "million/s",
        "the same in numpy",
        ("their arithmetic", least_s),
        amount=load.relaxations / MILLION,
    )


def trajectory(reference: Reference) -> Iterator[Figure]:
    """The time to get one trajectory from a front, over many trip times."""
    front = reference.front
    buffers = np.linspace(*BUFFERS, reference.effort.trajectories)
    wanted, wanted_plainly = (itertools.cycle(front.fastest().time_s * (1 + buffers)) for _ in range(2))
    times = in_turns(
        lambda: front.trajectory(next(wanted)),
        lambda: bisected(front, next(wanted_plainly)),
        rounds=len(buffers),
    )
    yield times.figure(
        "trajectory",
        f"run for one time from the front, {len(buffers)} times, {BUFFERS[0]:.1%} to {BUFFERS[1]:.0%} above the least",
        "ms",
        "bisection of λ from end to end of the ladder",
    )


def resolve(reference: Reference) -> Iterator[Figure]:
    """Solving again from half-way (section, front and run), against a run from the existing front."""
    section = reference.section
    i = len(section.node_m) // 2
    s_m, v_mps = float(section.node_m[i]), RESOLVED_SPEED_RATIO * float(section.envelope_mps[i])
    time_s = reference.front.fastest(s_m, v_mps).time_s * (1 + RESOLVED_BUFFER)

    def rest() -> Section:
        options = SectionOptions(
            start_speed_mps=v_mps, end_speed_mps=section.end_speed_mps, point_mass=section.train_length_m == 0
        )
        return build_section(
            section.route, section.vehicle, level=section.level, start_m=s_m, end_m=section.end_m, options=options
        )

    times = in_turns(
        lambda: solve_front(rest(), threads=reference.threads).trajectory(time_s),
        lambda: reference.front.trajectory(time_s, s_m, v_mps),
        rounds=reference.effort.rounds,
    )
    yield times.figure(
        "re-solve",
        f"new front and run from km {s_m / KM:.1f} at {v_mps / KMH:.0f} km/h",
        "ms",
        "the run from the front at hand",
        (FRONT_BOUND, Workload.of(rest()).least_s(reference.all_threads)),
    )


def exact(reference: Reference) -> Iterator[Figure]:
    """The exact front of the paper's section, against the solver's front and a run from it."""
    section = build_section(load_route(EXACT_ROUTE), load_vehicle(VEHICLE), level=EXACT_LEVEL)
    buffer_ratio, labels = reference.effort.exact_buffer_ratio, 0

    def search() -> None:
        nonlocal labels
        labels = solve_exact(section, buffer_ratio, threads=reference.threads).labels

    def supported() -> None:
        front = solve_front(section, threads=reference.threads)
        front.trajectory(front.fastest().time_s * (1 + buffer_ratio))

    times = in_turns(search, supported, rounds=reference.effort.slow_rounds)
    yield times.figure(
        "exact",
        f"exact front of {EXACT_ROUTE} + {VEHICLE}, {EXACT_LEVEL}, to {buffer_ratio:.1%}: "
        f"{labels / MILLION:.2f} million partial runs",
        "ms",
        "the solver's front and one run",
    )


def growth(reference: Reference) -> Iterator[Figure]:
    """Fronts of made-up lines of growing length, against the time per transition of the shortest line."""
    baseline_s_per_landing = 0.0
    for length_km in reference.effort.lengths_km:
        section = made_up_section(length_km)
        load = Workload.of(section)
        rounds = reference.effort.rounds if length_km <= SHORT_KM else reference.effort.slow_rounds
        seconds = timed(partial(solve_front, section, threads=reference.threads), rounds)
        if not baseline_s_per_landing:
            baseline_s_per_landing = statistics.median(seconds) / load.landings
        times = Times(seconds=seconds, baseline_seconds=[baseline_s_per_landing * load.landings])
        yield times.figure(
            f"growth-{length_km:g}km",
            f"front of a made-up line, {length_km:g} km, {len(section.route.breakpoints_m())} breakpoints, "
            f"{load.nodes} nodes × {load.states} speeds, {load.landings / MILLION:.1f} million transitions",
            "ms",
            f"as long per transition as at {reference.effort.lengths_km[0]:g} km",
            (FRONT_BOUND, load.least_s(reference.all_threads)),
        )


def memory(reference: Reference) -> Iterator[Figure]:
    """Memory that the front of the longest made-up line needs."""
    length_km = reference.effort.lengths_km[-1]
    section = made_up_section(length_km)
    own = peak_bytes_of(lambda: solve_front(section, threads=reference.threads))
    plain = peak_bytes_of(lambda: all_at_once(section))
    if own is None or plain is None:
        return
    result_mb = Workload.of(section).result_bytes / MEGABYTE
    yield Figure(
        name="memory",
        what=f"memory for the front of {length_km:g} km, whose result has {result_mb:.0f} MB",
        unit="MB", value=own / MEGABYTE, least=own / MEGABYTE, most=own / MEGABYTE, rounds=1,
        baseline="all transitions first", baseline_value=plain / MEGABYTE,
    )  # fmt: skip


def made_up_section(length_km: float) -> Section:
    """The bundled train on a made-up line."""
    return build_section(made_up_line(length_km), load_vehicle(VEHICLE))
