"""Orders of conditions: who meets what when."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice, permutations
from math import factorial
from typing import Final

import numpy as np

from das.domain.errors import DasError
from sim.experiment.design import ConditionOrder

MOST_PERMUTED: Final = 6
"""Most conditions whose permutations are all used: 720 orders."""
ORDER_STREAM: Final = 1
"""Number of the stream of a design's seed from which orders are drawn."""


def order_count(order: ConditionOrder, conditions: int) -> int | None:
    """After how many participants the orders begin again; None where every participant's is drawn.

    Raises DasError where all permutations would be too many.
    """
    if order is ConditionOrder.FULL and conditions > MOST_PERMUTED:
        most = f"at most {MOST_PERMUTED} conditions, whose {factorial(MOST_PERMUTED)} orders can be used"
        raise DasError(f"procedure.order = 'full': the design has {conditions} conditions, expected {most}")
    counts = {
        ConditionOrder.WILLIAMS: conditions * (1 if conditions % 2 == 0 or conditions == 1 else 2),
        ConditionOrder.FULL: factorial(min(conditions, MOST_PERMUTED)),
        ConditionOrder.LISTED: 1,
    }
    return counts.get(order)


def order_of(order: ConditionOrder, conditions: int, row: int, seed: Sequence[int]) -> list[int]:
    """The order of a participant: the numbers of the conditions, from 0.

    `row` counts participants, and repetitions of each; `seed` decides an order that is drawn. Raises DasError as
    `order_count` does.
    """
    if order is ConditionOrder.RANDOM:
        return [int(one) for one in np.random.default_rng([*seed, ORDER_STREAM]).permutation(conditions)]
    count = order_count(order, conditions)
    assert count is not None
    if order is ConditionOrder.WILLIAMS:
        return williams(conditions)[row % count]
    if order is ConditionOrder.FULL:
        return list(next(islice(permutations(range(conditions)), row % count, None)))
    return list(range(conditions))


def williams(count: int) -> list[list[int]]:
    """The rows of a Williams design for a number of conditions: a Latin square, with its mirror if the number is odd.

    Every condition stands once in every place (twice with the mirror), and follows every other equally often: Williams
    (1949), Australian Journal of Scientific Research A 2, 149–168.
    """
    first = [0]
    for step in range(1, count):
        first.append((first[-1] + (step if step % 2 else -step)) % count)
    rows = [[(one + shift) % count for one in first] for shift in range(count)]
    return rows if count % 2 == 0 or count == 1 else rows + [row[::-1] for row in rows]
