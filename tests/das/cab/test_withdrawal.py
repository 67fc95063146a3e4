"""Withdrawals: every cause by its facts, and the one order in which they are decided."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from das.advice import wording
from das.advice.advice import OF_PROBLEM, Advice, Cause
from das.advice.goal import Goal
from das.cab.outputs import Event, Reporting, Severity
from das.cab.withdrawal import Trust, decide
from das.estimate.estimate import Estimate, Problem, ProblemKind
from docs.studies.reference import causes
from tests.support.making import REPOSITORY

HERE = Estimate(time_ns=100, fix_time_ns=100, s_m=500.0, speed_mps=10.0, problem=None)


def leg_of(departure_ns: int = 0, due_ns: int = 300, refusal: str = "", stood_short: bool = False) -> Any:
    """What the decision reads of a leg of 1000 m."""
    section = SimpleNamespace(start_m=0.0, end_m=1000.0)
    goal = Goal(departure_ns=departure_ns, due_ns=due_ns)
    return SimpleNamespace(section=section, goal=goal, refusal=refusal, stood_short=stood_short)


FACTS: dict[Cause, dict[str, Any]] = {
    Cause.TWO_PUBLISHERS: {"trust": {"two_publishers": "a and b"}},
    Cause.TWO_OPERATORS: {"trust": {"two_operators": "a and b"}},
    Cause.RESTRICTIONS_UNHEEDED: {"trust": {"unheeded": "one of -3 m/s"}},
    Cause.JOURNEY_REFUSED: {"trust": {"journey_refused": "it has 1 stops"}},
    Cause.INTERNAL_ERROR: {"trust": {"internal_error": "internal error: KeyError"}},
    Cause.NO_JOURNEY: {"leg": None},
    Cause.RESTRICTIONS_UNTOLD: {"trust": {"restrictions_received": False}},
    Cause.SECTION_IMPOSSIBLE: {"leg": {"refusal": "the train stalls"}},
    Cause.NO_POSITION: {"here": {"problem": Problem(ProblemKind.NO_POSITION)}},
    Cause.POSITION_REJECTED: {"here": {"problem": Problem(ProblemKind.JUMPED, 300.0)}},
    Cause.POSITION_STALE: {"here": {"problem": Problem(ProblemKind.STALE, 4.2)}},
    Cause.POSITION_AHEAD: {"here": {"problem": Problem(ProblemKind.AHEAD_OF_CLOCK, 4.2)}},
    Cause.POSITION_UNCERTAIN: {"here": {"problem": Problem(ProblemKind.POSITION_UNCERTAIN, 60.0)}},
    Cause.OUTSIDE_SECTION: {"here": {"s_m": 9000.0}},
    Cause.MOVING_UP: {"here": {"s_m": -20.0}, "leg": {"departure_ns": 200}},
    Cause.PAST_STOP: {"here": {"s_m": 1060.0}},
    Cause.NO_PLAN: {"no_plan": "the train stalls"},
    Cause.TWO_NODES: {"trust": {"two_nodes": "b"}},
    Cause.STANDS_ON_LINE: {"quiet": Cause.STANDS_ON_LINE},
    Cause.DRIVER_BRAKES: {"quiet": Cause.DRIVER_BRAKES},
}
"""The facts that lead to each cause when nothing else is wrong."""


def decided(*causes: Cause) -> Any:
    """What is decided where the facts of several causes hold at once; later ones do not undo those before."""
    here: dict[str, Any] = {}
    leg: dict[str, Any] | None = {}
    trust: dict[str, Any] = {}
    no_plan, quiet = "", Cause.NONE
    for cause in causes:
        facts = FACTS[cause]
        here = {**facts.get("here", {}), **here}
        trust = {**facts.get("trust", {}), **trust}
        leg = None if facts.get("leg", {}) is None or leg is None else {**facts.get("leg", {}), **leg}
        no_plan = facts.get("no_plan", no_plan)
        quiet = quiet or facts.get("quiet", Cause.NONE)
    legs = None if leg is None else leg_of(**leg)
    return decide(replace(HERE, **here), replace(Trust(), **trust), legs, no_plan=no_plan, quiet=quiet)


def test_with_nothing_wrong_there_is_advice() -> None:
    assert decide(HERE, Trust(), leg_of()) is None


@pytest.mark.parametrize("cause", [cause for cause in Cause if cause is not Cause.NONE])
def test_every_cause_follows_from_its_facts_and_has_words(cause: Cause) -> None:
    found = decided(cause)
    assert found is not None
    assert found.cause is cause
    assert wording.withdrawal(found)


def test_a_late_train_that_stood_clearly_short_of_its_stop_is_moving_up_until_it_is_there() -> None:
    late = leg_of(departure_ns=-200, stood_short=True)
    found = decide(replace(HERE, s_m=-20.0), Trust(), late)
    assert found is not None
    assert found.cause is Cause.MOVING_UP
    assert decide(replace(HERE, s_m=-20.0), Trust(), leg_of(departure_ns=-200)) is None
    assert decide(replace(HERE, s_m=5.0), Trust(), late) is None


def test_the_first_cause_in_the_order_of_their_numbers_decides() -> None:
    causes = [cause for cause in Cause if cause is not Cause.NONE]
    for i, first in enumerate(causes):
        for later in causes[i + 1 :]:
            assert decided(first, later).cause is first, (first, later)


def test_a_leg_without_a_timetable_is_no_journey() -> None:
    found = decide(HERE, Trust(), leg_of(due_ns=0))
    assert found is not None
    assert found.cause is Cause.NO_JOURNEY


@pytest.mark.parametrize("cause", [cause for cause in Cause if cause is not Cause.NONE])
def test_every_withdrawal_but_a_quiet_display_is_a_warning(cause: Cause) -> None:
    reporting = Reporting()
    reporting.changes(Advice(time_ns=1, cause=cause), "why")
    quiet = cause in (Cause.STANDS_ON_LINE, Cause.DRIVER_BRAKES)
    severity = Severity.INFO if quiet else Severity.WARNING
    assert reporting.take() == [Event(time_ns=1, severity=severity, text="no advice: why")]


WITHOUT_A_FIGURE = {
    ProblemKind.NO_POSITION,
    ProblemKind.MARKED_UNUSABLE,
    ProblemKind.NOT_A_NUMBER,
    ProblemKind.SPEED_UNCONFIRMED,
}


@pytest.mark.parametrize("kind", ProblemKind)
def test_every_problem_of_a_position_has_words_with_its_figure_and_a_cause(kind: ProblemKind) -> None:
    """The words hold the figure where the kind has one: 36 m, 36 s, or 36 m/s as 130 km/h."""
    words = wording.problem(Problem(kind, 36.0))
    assert ("36" in words or "130" in words or "129.6" in words) == (kind not in WITHOUT_A_FIGURE)
    found = decide(replace(HERE, problem=Problem(kind, 36.0)), Trust(), leg_of())
    assert found is not None
    assert (found.cause, wording.withdrawal(found)) == (OF_PROBLEM[kind], words)
    assert math.isnan(Problem(kind).value)
    assert kind not in WITHOUT_A_FIGURE or "nan" not in wording.problem(Problem(kind))


def test_the_problems_of_a_position_have_different_words_and_all_causes_of_a_position() -> None:
    assert len({wording.problem(Problem(kind, 36.0)) for kind in ProblemKind}) == len(ProblemKind)
    assert set(OF_PROBLEM) == set(ProblemKind)
    assert set(OF_PROBLEM.values()) == {cause for cause in FACTS if "problem" in FACTS[cause].get("here", {})}


def test_the_documentation_lists_every_cause() -> None:
    assert "docs.studies.reference -> causes.md }}" in (REPOSITORY / "docs" / "reference" / "bus.md").read_text()
    for cause in Cause:
        assert f"| {int(cause)} | `{cause.label}` |" in causes()
