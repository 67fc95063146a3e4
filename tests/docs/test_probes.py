"""Probes of the dated results: a row of each study is as its page has it, or the study is to be made again."""

from __future__ import annotations

import pytest

from docs.studies import exact_front, hard, real_trips
from docs.studies.output import csv_lines
from tests.support.benchmark import shared_data
from tests.support.kept_figures import not_on_page


@pytest.mark.slow
def test_the_exact_front_of_the_shortest_line() -> None:
    *_, row = exact_front.growth_table(exact_front.LENGTHS_KM[:1])
    assert not_on_page(exact_front.PAGE.read_text(encoding="utf-8"), [row]) == []


@pytest.mark.slow
def test_the_first_hard_problem_of_the_solver() -> None:
    """Needs no data of others: the problem is drawn from its seed."""
    row = hard.hard_line(*next(hard.hard_rows()), None)
    assert not_on_page("\n".join(csv_lines(hard.HARD)), [row]) == []


@pytest.mark.nightly
def test_a_real_trip_with_a_train_that_is_possible_and_one_that_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    trip = next(iter(real_trips.TRIPS))
    monkeypatch.setattr(real_trips, "TRIPS", {trip: real_trips.TRIPS[trip]})
    monkeypatch.setattr(real_trips, "TRAINS", {name: real_trips.TRAINS[name] for name in ("KISS", "VIRM6")})
    rows = list(real_trips.above_table(list(real_trips.trip_attributions(shared_data()))))
    assert not_on_page(real_trips.PAGE.read_text(encoding="utf-8"), rows) == []
