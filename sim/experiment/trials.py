"""The trials of a design: who drives what under which condition, on which day, in which place of the order."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import islice, permutations
from math import factorial
from typing import Final

import numpy as np

from das.domain.errors import DasError
from sim.experiment.design import Chances, ConditionOrder, Days, Design
from sim.experiment.driving import StudyTrial

MOST_PERMUTED: Final = 6
"""Most conditions whose permutations are all used: 720 orders."""
ORDER_STREAM: Final = 1
"""Number of the stream of a design's seed from which orders are drawn."""
DAY_STREAM: Final = 2
"""Number of the stream of a design's seed from which the seeds of days are drawn."""
EVERYBODY: Final = 2**32 - 1
"""Stands for the participant where all participants meet the same days."""


def trials_of(design: Design) -> list[StudyTrial]:
    """All trials, by participant and then in the order of the participant; raises DasError for too many orders."""
    found: list[StudyTrial] = []
    for who in range(design.people.count):
        found += _of_participant(design, who, len(found))
    return found


def _of_participant(design: Design, who: int, before: int) -> Iterator[StudyTrial]:
    groups = design.conditions(within=False)
    between, row = groups[who % len(groups)], who // len(groups)
    inside = design.conditions(within=True)
    people, procedure = design.people, design.procedure
    orders = [
        order_of(procedure.order, len(inside), row * procedure.repetitions + turn, (design.seed, who, turn))
        for turn in range(procedure.repetitions)
    ]
    practice = [(orders[0][i % len(inside)], -1 - i // len(inside)) for i in range(procedure.practice_trials)]
    planned = practice + [(number, turn) for turn, order in enumerate(orders) for number in order]
    for place, (number, turn) in enumerate(planned):
        condition = between | inside[number]
        yield StudyTrial(
            number=before + place + 1,
            who=who + 1,
            person=people.first + who,
            session=1 + (place // procedure.break_after if procedure.break_after else 0),
            position=place + 1,
            practice=turn < 0,
            levels=tuple(condition[factor.name].text for factor in design.factors),
            setting=design.setting(condition),
            seed=_day_seed(design, who, turn, place),
            chance=place if procedure.chances is Chances.NEW else 0,
            trips=people.trips_before + place if people.learning else None,
        )


def _day_seed(design: Design, who: int, turn: int, place: int) -> int:
    """The seed of a trial's day, below 2**31; a practice turn is below 0."""
    days = design.procedure.days
    key = (
        EVERYBODY if days is Days.COMMON else who,
        1 + 2 * turn if turn >= 0 else -2 * turn,
        place if days is Days.NEW else 0,
    )
    drawn = np.random.SeedSequence([design.seed, DAY_STREAM], spawn_key=key)
    return int(drawn.generate_state(1)[0] >> 1)


def imbalances(design: Design, trials: Sequence[StudyTrial]) -> list[str]:
    """Sentences about what is not balanced: groups of unequal size, orders that are not used equally often."""
    found = []
    groups = len(design.conditions(within=False))
    if design.people.count % groups:
        found.append(f"{design.people.count} participants cannot be divided equally among {groups} groups")
    conditions = len(design.conditions(within=True))
    turns = -(-design.people.count // groups) * design.procedure.repetitions
    count = order_count(design.procedure.order, conditions)
    if conditions > 1 and count is not None and count > 1 and turns % count:
        found.append(f"{turns} orders in each group, expected a multiple of {count} for order {design.procedure.order}")
    uneven = set(Counter(trial.condition for trial in trials if not trial.practice).values())
    if len(uneven) > 1:
        found.append(f"conditions have between {min(uneven)} and {max(uneven)} trials")
    return found


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
