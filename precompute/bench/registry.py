"""The figures that the bench can measure, by name and in order."""

from __future__ import annotations

from collections.abc import Callable

from precompute.bench import figures, table_figures
from precompute.bench.figures import Reference
from precompute.bench.measuring import Figure

FIGURES: dict[str, Callable[[Reference], list[Figure]]] = {
    "front": figures.front_of_reference,
    "steps": figures.short_steps,
    "transitions": figures.transition_rate,
    "sweep": figures.sweep_rate,
    "trajectory": figures.trajectory,
    "re-solve": figures.resolve,
    "look-up": table_figures.look_up,
    "verify": table_figures.open_and_verify,
    "build": table_figures.build,
    "exact": figures.exact,
    "growth": figures.growth,
    "memory": figures.memory,
}
