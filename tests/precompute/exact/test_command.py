"""How long the exact front will still take: ranges that hold what then comes, for growth as it was measured."""

from __future__ import annotations

import pytest

from precompute.exact.command import Forecast, in_words

LAYERS = 60


class Clock:
    """A clock that the test moves."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def passes(totals_s: tuple[float, ...]) -> list[list[float]]:
    """Durations of layers: each pass rises towards its end, the finer the steeper."""
    found = []
    for number, total_s in enumerate(totals_s):
        shape = [(i + 1) ** (1.0 + 0.5 * number) for i in range(LAYERS)]
        found.append([total_s * one / sum(shape) for one in shape])
    return found


@pytest.mark.parametrize("totals_s", [(8.4, 3.3, 5.6, 30.5), (0.4, 0.3, 0.35, 0.65)], ids=["10 %", "2 %"])
def test_the_range_holds_what_comes(totals_s: tuple[float, ...]) -> None:
    """Pass times as measured on the 6 km line."""
    clock, layers = Clock(), passes(totals_s)
    forecast = Forecast(passes=4, clock=clock)
    clock.now_s += 5.0
    forecast.begin()
    ranges = []
    for number, durations in enumerate(layers):
        for i, duration_s in enumerate(durations):
            clock.now_s += duration_s
            forecast.layer_done(LAYERS)
            left = sum(durations[i + 1 :]) + sum(map(sum, layers[number + 1 :]))
            if number == 0 and i < LAYERS - 1:
                assert forecast.left_s() is None
            elif number > 0 and i > 5:
                ranges.append((*forecast.left_s(), left))
    held = [low <= left + 0.1 and left <= 1.1 * high + 0.1 for low, high, left in ranges]
    assert sum(held) >= 0.9 * len(held)
    low, high, _ = ranges[-1]
    assert low == high == 0


def test_layers_that_all_take_the_same_are_forecast_well() -> None:
    clock = Clock()
    forecast = Forecast(passes=2, clock=clock)
    for _ in range(LAYERS + LAYERS // 2):
        clock.now_s += 0.1
        forecast.layer_done(LAYERS)
    low, high = forecast.left_s()
    assert low == pytest.approx(3.0)
    assert 3.0 <= high <= 9.0


@pytest.mark.parametrize(
    ("left_s", "words"),
    [
        (None, ""),
        ((3.2, 3.4), ", about 3 s left"),
        ((2.0, 9.0), ", 2 to 9 s left"),
        ((13.0, 48.0), ", 15 to 50 s left"),
        ((50.0, 200.0), ", 1 to 3 min left"),
    ],
)
def test_ranges_are_said_as_people_say_them(left_s: tuple[float, float] | None, words: str) -> None:
    assert in_words(left_s) == words
