"""Bounds that keep the exact front exact: dual values from below, known runs from above."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np
from numpy.typing import NDArray

from precompute.exact import kernels
from precompute.exact.grid import Graph, Layer, onward_arcs

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

BLOCKS = 24
"""Blocks of states of a node, shared out among the threads."""
LADDER = 90
FIRST_LADDER = 40
FIRST_RATIOS = (0.01, 30.0)
"""The first multipliers run between these multiples of the train's power."""
STEEPER = tuple(2.0**i for i in range(1, 11))
"""Beyond the steepest multiplier of the refined ladder: the front is very steep near the least time."""
ROUNDING_J = 1.0
"""Slack of every comparison with a bound: far above the rounding of its sums, far below any saving."""
ROUNDING_RATIO = 1e-12


def undominated(time_ns: Ints, energy_mj: Ints) -> Ints:
    """Indices of the runs that no other beats, by rising time; of equal ones the first."""
    order = np.lexsort((energy_mj, time_ns))
    energy = energy_mj[order]
    before = np.concatenate(([kernels.NEVER], np.minimum.accumulate(energy)[:-1]))
    kept: Ints = order[energy < before]
    return kept


@dataclass(frozen=True, kw_only=True, eq=False)
class Known:
    """Times (ns, rising) and energies (mJ, falling) of runs that exist: no other run above them is on the front."""

    time_ns: Ints
    energy_mj: Ints

    @classmethod
    def none(cls) -> Self:
        return cls(time_ns=np.empty(0, np.int64), energy_mj=np.empty(0, np.int64))

    def with_runs(self, time_ns: Ints, energy_mj: Ints) -> Known:
        """Those of both that no other beats."""
        time, energy = np.concatenate((self.time_ns, time_ns)), np.concatenate((self.energy_mj, energy_mj))
        keep = undominated(time, energy)
        return Known(time_ns=time[keep], energy_mj=energy[keep])

    @property
    def found(self) -> tuple[Ints, Ints]:
        """Times (ns) and energies (mJ)."""
        return self.time_ns, self.energy_mj


class Duals:
    """Least energy + λ·time (J) from every state to one end of the section, per node an array (states, multipliers).

    They lead to the end of the section, or `onward=False` to its start. `layer_done` is called after each interval.
    """

    def __init__(
        self,
        graph: Graph,
        layers: list[Layer],
        lambda_w: Floats,
        threads: int,
        layer_done: Callable[[], None] = lambda: None,
        *,
        onward: bool = True,
    ) -> None:
        self.lambda_w = lambda_w
        self.value_j = [np.zeros((len(layer.speed), len(lambda_w))) for layer in layers]
        self._layers = layers
        self._choice: list[NDArray[np.int32]] = []
        with ThreadPoolExecutor(threads) as pool:
            for k in range(graph.intervals)[:: -1 if onward else 1]:
                choice = self._step(graph, pool, k, onward=onward)
                if onward:
                    self._choice.append(choice)
                layer_done()
        self._choice.reverse()

    def _step(self, graph: Graph, pool: ThreadPoolExecutor, k: int, *, onward: bool) -> NDArray[np.int32]:
        """The values at one end of interval k from those at its other end; the rows that they lead to."""
        arcs = onward_arcs(graph, self._layers[k], self._layers[k + 1])
        at, beyond = (k, k + 1) if onward else (k + 1, k)
        speed, other = self._layers[at].speed, self._layers[beyond].speed
        arcs = arcs if onward else arcs.turned(len(speed))
        choice = np.empty(self.value_j[at].shape, np.int32)

        def block(part: tuple[int, int]) -> None:
            kernels.dual_values(
                *part, *arcs, speed, other, onward, graph.unit_mps, *graph.interval(k), graph.train(k),
                graph.section.loss_params, self.lambda_w, self.value_j[beyond], self.value_j[at], choice,
            )  # fmt: skip

        list(pool.map(block, pairwise([round(len(speed) * i / BLOCKS) for i in range(BLOCKS + 1)])))
        return choice

    def runs(self) -> Ints:
        """Speeds at the nodes (multipliers, nodes) of a run of least energy + λ·time for every multiplier."""
        every = np.arange(len(self.lambda_w))
        return self._followed(every, every, np.zeros_like(every))

    def bound_j(self, time_s: Floats) -> Floats:
        """Lower bound of the energy (J) of every run on the grid that takes at most these times (s)."""
        best = np.full(len(time_s), -np.inf)
        for lambda_w, value_j in zip(self.lambda_w, self.value_j[0][0], strict=True):
            np.maximum(best, value_j - lambda_w * time_s, out=best)
        return best

    def switched_runs(self) -> Ints:
        """Runs that follow one multiplier up to some node and the next one from there, for all neighbours and nodes."""
        count, nodes = len(self.lambda_w) - 1, len(self._layers) - 2
        first = np.repeat(np.arange(count), nodes)
        at = np.tile(np.arange(1, nodes + 1), count)
        return np.concatenate((self._followed(first, first + 1, at), self._followed(first + 1, first, at)))

    def forget_runs(self) -> None:
        """Free what only runs are made from."""
        self._choice = []

    def _followed(self, first: Ints, then: Ints, at: Ints) -> Ints:
        """Speeds at the nodes of runs that follow multiplier first[i] before node at[i] and then[i] from it on."""
        speeds = np.empty((len(at), len(self._layers)), np.int64)
        row: NDArray[np.integer] = np.zeros(len(at), np.int64)
        speeds[:, 0] = self._layers[0].speed[0]
        for k, choice in enumerate(self._choice):
            row = choice[row, np.where(k < at, first, then)]
            speeds[:, k + 1] = self._layers[k + 1].speed[row]
        return speeds


def first_ladder(power_w: float) -> Floats:
    """Multipliers (W) that span the front of any train."""
    return power_w * np.concatenate(([0.0, 1e-3], np.geomspace(*FIRST_RATIOS, FIRST_LADDER - 2)))


def refined_ladder(lambda_w: Floats, time_ns: Ints, least_ns: int, latest_ns: int) -> Floats:
    """Multipliers whose runs spread evenly over the times asked for."""
    order = np.argsort(time_ns, kind="stable")
    times = np.linspace(least_ns, latest_ns, LADDER)
    logs = np.interp(times, time_ns[order], np.log(np.maximum(lambda_w[order], 1.0)))
    inner = np.unique(np.exp(logs))
    return np.concatenate((inner, inner[-1] * np.array(STEEPER)))


def allowed_j(known: Known, latest_ns: int, duals: Duals) -> Floats:
    """For each λ the largest energy + λ·time (J) of a run that could still belong to the front.

    A run not yet known that belongs to the front lies between two neighbours of the known front: it takes less time
    than the later one and no more energy than the earlier one. Each such stretch is watched by the λ whose bound is
    highest at its end. A λ that watches nothing gets −inf.
    """
    allowed = np.full(len(duals.lambda_w), -np.inf)
    end_s = np.append(known.time_ns[1:], latest_ns) / kernels.NS
    watching = np.argmax(duals.value_j[0][0] - duals.lambda_w * end_s[:, np.newaxis], axis=1)
    np.maximum.at(allowed, watching, known.energy_mj / kernels.MJ + duals.lambda_w[watching] * end_s)
    watched = np.isfinite(allowed)
    allowed[watched] += ROUNDING_J + ROUNDING_RATIO * np.abs(allowed[watched])
    return allowed
