"""Made-up lines from a seed: a network of many sections for builds, and one long section for the bench."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from das.domain.route import Floats, Route, Stop, Stretches
from das.domain.units import KM, KMH, PERMILLE

SECTIONS_PER_LINE = 10
SHORTEST_SECTION_M, LONGEST_SECTION_M = 1.0 * KM, 40.0 * KM
"""Range of a section's length, which is drawn with a uniform logarithm."""
ROUNDING_M = 10.0
LIMITS_KMH = (80.0, 90.0, 100.0, 110.0, 120.0, 125.0, 140.0, 160.0)
TOWN_LIMITS_KMH = (60.0, 70.0, 80.0, 90.0)
TOWN_M = 800.0
"""Distance (m) from a stop within which one of the town limits holds."""
LIMIT_EVERY_M = 3.5 * KM
"""Mean length of the stretches with one limit between towns."""
GRADIENT_EVERY_M = 1.2 * KM
GRADIENT_SPREAD_RATIO = 6.0 * PERMILLE
STEEPEST_RATIO = 12.0 * PERMILLE
CURVE_EVERY_M = 2.5 * KM
CURVE_MPS2 = 0.9
"""Lateral acceleration at the limit in the tightest curves drawn; most are wider."""


def synthetic_routes(sections: int, seed: int) -> list[Route]:
    """Lines with `sections` sections in total and stops 1 to 40 km apart; the same seed gives the same lines."""
    rng = np.random.default_rng(seed)
    counts = [SECTIONS_PER_LINE] * (sections // SECTIONS_PER_LINE)
    rest = sections % SECTIONS_PER_LINE
    return [_line(rng, f"synthetic-{seed}-{i:03d}", n) for i, n in enumerate([*counts, *([rest] if rest else [])], 1)]


def _line(rng: np.random.Generator, name: str, sections: int) -> Route:
    spread = math.log(LONGEST_SECTION_M / SHORTEST_SECTION_M)
    lengths_m = _rounded(SHORTEST_SECTION_M * np.exp(spread * rng.random(sections)), ROUNDING_M)
    stops_m = np.concatenate(([0.0], np.cumsum(lengths_m)))
    length_m = float(stops_m[-1])
    limits = _limits(rng, stops_m, length_m)
    return Route(
        id=name,
        name=f"{name}, {sections} sections from a seed",
        source=name,
        illustrative=True,
        length_m=length_m,
        stops=tuple(Stop(name=f"stop {i}", position_m=float(x)) for i, x in enumerate(stops_m, 1)),
        limits_mps=limits,
        gradients_ratio=_gradients(rng, length_m),
        curvature_per_m=_curves(rng, limits, length_m),
    )


def _limits(rng: np.random.Generator, stops_m: Floats, length_m: float) -> Stretches:
    """A town limit around each stop, other limits between."""
    starts, values = [0.0], [rng.choice(TOWN_LIMITS_KMH)]
    for here, there in pairwise(stops_m):
        half = min(TOWN_M, (there - here) / 3)
        between = np.concatenate(([here + half], here + half + _places(rng, there - here - 2 * half, LIMIT_EVERY_M)))
        starts += [*between.tolist(), float(there - half)]
        values += [*rng.choice(LIMITS_KMH, len(between)), rng.choice(TOWN_LIMITS_KMH)]
    return _stretches(starts, KMH * np.array(values), length_m)


def _gradients(rng: np.random.Generator, length_m: float) -> Stretches:
    """Random gradients that tend back towards level, so that a line does not climb for ever."""
    starts = np.concatenate(([0.0], _places(rng, length_m, GRADIENT_EVERY_M)))
    drawn = rng.normal(0.0, GRADIENT_SPREAD_RATIO, len(starts))
    drawn[1:] -= 0.3 * drawn[:-1]
    return _stretches(starts, _rounded(np.clip(drawn, -STEEPEST_RATIO, STEEPEST_RATIO), 0.1 * PERMILLE), length_m)


def _curves(rng: np.random.Generator, limits: Stretches, length_m: float) -> Stretches:
    """Curvature (1/m): every other stretch is curved, at most as tightly as its limit allows."""
    starts = np.concatenate(([0.0], _places(rng, length_m, CURVE_EVERY_M)))
    tightest = CURVE_MPS2 / limits.at(starts) ** 2
    curved = np.arange(len(starts)) % 2 == 1
    return _stretches(starts, np.where(curved, tightest * rng.uniform(0.2, 1.0, len(starts)), 0.0), length_m)


def _places(rng: np.random.Generator, length_m: float, every_m: float) -> Floats:
    """Random positions within a length, on average `every_m` apart."""
    return _rounded(np.sort(rng.uniform(0.0, length_m, rng.poisson(length_m / every_m))), ROUNDING_M)


def _stretches(starts: list[float] | Floats, values: Floats, length_m: float) -> Stretches:
    """Stretches inside the line; where several start at one place, the first value counts."""
    rounded = _rounded(np.asarray(starts, dtype=float), ROUNDING_M)
    rounded, first = np.unique(rounded, return_index=True)
    inside = rounded < length_m
    return Stretches(start_m=rounded[inside], value=np.asarray(values)[first][inside])


def _rounded(values: Floats, step: float) -> Floats:
    return np.asarray(np.round(values / step) * step)


BREAKPOINTS_PER_KM = 5
"""Changes of limit or gradient per km; a real main line has three to six."""
LIMIT_SHARE = 0.3
"""The share of the breakpoints that are changes of limit."""
LONG_LINE_LIMITS_KMH = np.arange(80.0, 165.0, 10.0)
STEEPEST_PERMILLE = 8.0
CLEAR_OF_STOPS_M = 50.0


def made_up_line(length_km: float, seed: int = 1) -> Route:
    """A line between two stops with random limits and gradients; the same seed gives the same line."""
    draw = np.random.default_rng(seed)
    breakpoints = round(BREAKPOINTS_PER_KM * length_km)
    limits = max(round(LIMIT_SHARE * breakpoints), 1)
    gradients = breakpoints + 1 - limits  # both lists begin at 0
    length_m = length_km * KM

    def stretches(values: np.ndarray) -> Stretches:
        inner = np.sort(draw.uniform(CLEAR_OF_STOPS_M, length_m - CLEAR_OF_STOPS_M, len(values) - 1))
        return Stretches(start_m=np.concatenate(([0.0], inner)), value=values)

    name = f"made up, {length_km:g} km, seed {seed}"
    return Route(
        id="made-up",
        name=name,
        source=name,
        illustrative=True,
        length_m=length_m,
        stops=(Stop(name="A", position_m=0.0), Stop(name="B", position_m=length_m)),
        limits_mps=stretches(draw.choice(LONG_LINE_LIMITS_KMH, limits) * KMH),
        gradients_ratio=stretches(draw.uniform(-STEEPEST_PERMILLE, STEEPEST_PERMILLE, gradients) * PERMILLE),
    )
