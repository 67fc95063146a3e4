"""How long the exact front will still take: a range, from how the work has grown so far.

The front is found in passes over the layers of the grid, each finer than the one before it. Within a pass, a layer
takes a multiple of what it took in the pass before, and that multiple grows along the way. A pass as a whole takes a
multiple of the pass before it (`FACTORS`, measured on the 6 km line with buffers of 2 to 10 %).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

RECENT = 6
"""Number of the last layers that tell how much slower the pass is than the one before it."""
MOST_GROWTH, MOST_MULTIPLE = 1.15, 12.0
"""How fast the multiple of a layer may grow from one layer to the next, and to what at most."""
FACTORS = ((0.2, 1.5), (0.9, 2.0), (1.8, 6.0))
"""Range of what the second, third and fourth pass take, as a multiple of the pass before."""


@dataclass
class Forecast:
    """Learns how long the layers take; `clock` gives the time in s, `passes` is how many there will be.

    `passes` is at most one more than there are `FACTORS`.
    """

    passes: int
    clock: Callable[[], float]
    _began_s: float = field(init=False)
    _done: list[list[float]] = field(init=False)

    def __post_init__(self) -> None:
        self._done = [[]]
        self.begin()

    def begin(self) -> None:
        """Note that the first layer begins now, after work that is not repeated."""
        self._began_s = self.clock()

    def layer_done(self, layers: int) -> None:
        """Note that one more layer out of `layers` is done."""
        if len(self._done[-1]) == layers:
            self._done.append([])
        now_s = self.clock()
        self._done[-1].append(now_s - self._began_s)
        self._began_s = now_s

    def left_s(self) -> tuple[float, float] | None:
        """The least and the most time (s) that is likely to be left; None before the first pass has ended."""
        if len(self._done) == 1:
            return None
        before, now = self._done[-2], self._done[-1]
        low_s, high_s = _rest_of_pass(before, now, FACTORS[len(self._done) - 2])
        low_whole_s, high_whole_s = sum(now) + low_s, sum(now) + high_s
        for least, most in FACTORS[len(self._done) - 1 : self.passes - 1]:
            low_whole_s, high_whole_s = least * low_whole_s, most * high_whole_s
            low_s, high_s = low_s + low_whole_s, high_s + high_whole_s
        return low_s, high_s


def _rest_of_pass(before: Sequence[float], now: Sequence[float], factors: tuple[float, float]) -> tuple[float, float]:
    """The range of time for the layers that are left of a pass, from all layers of the one before it."""
    left = before[len(now) :]
    least, most = factors
    known = range(max(len(now) - RECENT, 1), len(now))  # the first layer may have had something to load
    if not left or not known:
        return least * sum(left), most * sum(left)
    multiple = sum(now[i] for i in known) / max(sum(before[i] for i in known), 1e-9)
    # In the beginning the layers are small and tell little, so the pass is thought of as a whole.
    high_s = sum(min(multiple * MOST_GROWTH**i, max(multiple, MOST_MULTIPLE)) * one for i, one in enumerate(left, 1))
    whole_s = most * sum(before)
    return min(multiple * sum(left), whole_s), max(multiple * sum(left), min(high_s, whole_s))


def in_words(left_s: tuple[float, float] | None) -> str:
    """The range as people say it; empty while nothing is known."""
    if left_s is None:
        return ""
    low, high = (_rounded(one) for one in left_s)
    unit = "s" if high < 120 else "min"
    if unit == "min":
        low, high = round(low / 60), round(high / 60)
    return f", about {high} {unit} left" if low == high else f", {low} to {high} {unit} left"


def _rounded(time_s: float) -> int:
    """To the second up to 10 s, then to 5 s."""
    return round(time_s) if time_s < 10 else 5 * round(time_s / 5)
