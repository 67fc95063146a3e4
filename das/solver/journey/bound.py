"""A lower bound of the energy of a journey: the dual of its time constraints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from das.domain.journey import Window
from das.solver.journey.chains import Chains, Parts, Solved, start_speeds
from das.solver.journey.hop_fronts import Ahead
from das.solver.journey.timeline import TightSpan

Floats = NDArray[np.float64]


def lower_bound_j(chains: Chains, solved: Sequence[Solved]) -> float:
    """A lower bound of the energy (J) of every run of this discretisation that keeps the windows of a journey.

    The bound is weak duality with one multiplier λ for each span of a plan: E ≥ min(E + Σ λ·time) − Σ λ·(time between
    the tight bounds). It holds for every run in the windows, as long as λ does not rise at a latest time nor fall at an
    earliest one. The bound is maximised over the ladder under these signs; the λ of a span that begins at a passing is
    that of the plan.
    """
    best_j = np.zeros(len(chains.fronts.ladder_w))
    parts: Parts = {}
    ahead: Ahead | None = None
    for part in reversed(solved):
        span = part.span
        after_j = _allowed(chains.timeline.events[span.end[0]].window, span.end[1], best_j)
        chains.add_parts(parts, span, ahead)
        if chains.timeline.is_passing(span.begin[0]):
            best_j, ahead = _at_passing(chains, part, parts, after_j)
        else:
            best_j, ahead = _from_stop(chains, span, parts) + after_j, None
            parts.clear()
    return float(best_j.max())


def _allowed(window: Window, time_s: float, after_j: Floats) -> Floats:
    """For every λ before a tight time, the largest of `after_j` (by λ after it) of the right sign."""
    if window.earliest_s == window.latest_s:
        return np.full_like(after_j, after_j.max())
    if time_s == window.latest_s:
        return np.maximum.accumulate(after_j)
    return np.maximum.accumulate(after_j[::-1])[::-1]


def _from_stop(chains: Chains, span: TightSpan, parts: Parts) -> Floats:
    """The dual of a span that begins at a stop, by λ (−inf where λ is not one of the span's)."""
    first_j = np.zeros(len(chains.fronts.ladder_w))
    if span.stretches:
        first_j = chains.fronts.table(span.stretches[0], parts.get(span.stretches[0]), 0.0).total_j
    dual_j = chains.dual_j(span, parts, first_j)
    dual_j[: chains.lowest(span)] = -np.inf
    return dual_j


def _at_passing(chains: Chains, part: Solved, parts: Parts, after_j: Floats) -> tuple[Floats, Ahead]:
    """What a span and all after it cost by the speed at its begin, at one λ; it is the only one that counts before."""
    usable = np.isfinite(after_j) & (np.arange(len(after_j)) >= chains.lowest(part.span))
    distance_w = np.abs(chains.fronts.ladder_w - min(part.lambda_w, chains.fronts.ladder_w[-1]))
    index = int(np.where(usable, distance_w, np.inf).argmin())
    front = parts[part.span.stretches[0]]
    value_j = chains.dual_j(part.span, parts, front.value_j[0])[:, index]
    alone_j = np.full_like(after_j, -np.inf)
    if usable[index]:
        alone_j[index] = after_j[index]
    return alone_j, Ahead(speed_mps=start_speeds(front), value_j=value_j, least_mps=0.0)
