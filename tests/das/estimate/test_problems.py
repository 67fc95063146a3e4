"""Every problem of a position has words for people and a cause for programs."""

from __future__ import annotations

import math

import pytest

from das.advice import wording
from das.advice.cause import OF_PROBLEM, Cause, Withdrawal
from das.estimate.estimate import Problem, ProblemKind

WITHOUT_A_FIGURE = {ProblemKind.NO_POSITION, ProblemKind.MARKED_UNUSABLE, ProblemKind.NOT_A_NUMBER}
POSITION_CAUSES = {
    Cause.NO_POSITION,
    Cause.POSITION_REJECTED,
    Cause.POSITION_STALE,
    Cause.POSITION_AHEAD,
    Cause.POSITION_UNCERTAIN,
}


@pytest.mark.parametrize("kind", ProblemKind)
def test_every_problem_has_words(kind: ProblemKind) -> None:
    """The words hold the figure where the kind has one: 36 m, 36 s, or 36 m/s as 130 km/h."""
    words = wording.problem(Problem(kind, 36.0))
    assert ("36" in words or "130" in words or "129.6" in words) == (kind not in WITHOUT_A_FIGURE)
    assert wording.withdrawal(Withdrawal(OF_PROBLEM[kind], problem=Problem(kind, 36.0))) == words


def test_no_two_problems_have_the_same_words() -> None:
    words = [wording.problem(Problem(kind, 36.0)) for kind in ProblemKind]
    assert len(set(words)) == len(ProblemKind)


def test_every_problem_has_a_cause_of_the_position() -> None:
    assert set(OF_PROBLEM) == set(ProblemKind)
    assert set(OF_PROBLEM.values()) == POSITION_CAUSES


@pytest.mark.parametrize("kind", sorted(WITHOUT_A_FIGURE))
def test_a_problem_without_a_figure_says_no_number(kind: ProblemKind) -> None:
    assert math.isnan(Problem(kind).value)
    assert "nan" not in wording.problem(Problem(kind))
