"""All tracks × trains of the public benchmark library: solved and verified, or refused for the true reason.

`python -m tests.reference.test_ttobench_matrix` prints docs/results/0.2/solver/tracks.csv.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from das.domain.errors import InfeasibleError
from das.domain.files.load import load_route, load_vehicle
from das.domain.route import Route
from das.domain.vehicle import BrakePolicy, Vehicle
from das.solver.front import Front
from das.solver.section import Section, build_section
from das.solver.solve import solve_front
from docs.studies.output import DOCS, csv_text
from precompute.cli.report import solution_json
from tests.support.benchmark import TRACKS, TRAINS, track_path, tracks_here, train_path
from tests.support.crossing import crossed
from tests.support.making import csv_rows
from tests.support.raw_data import Floats, G, Line, Train
from tests.support.verifier import Finding, verify

BUFFERS_RATIO = (0.0, 0.05, 0.15)
AMPLE_RATIO = 1e4
"""So much buffer that the least-energy run results. These trains idle for nothing, so it creeps: see `verify`."""
HILLY = [track for track in tracks_here() if track.endswith("_10") or not track.startswith("00")]
OVERLOADS = ((4, True), (8, True), (15, False))
"""Times the mass, and whether only the motors brake."""
PUBLISHED_RATIO = 2e-3
"""The published figures hold to this."""
STEP_M = 10.0
"""Of the independent check whether a section can be driven at all."""
NEAR_M = 200.0
"""A place that is named is as near to the true one: a step of decision of up to 150 m, and what it is rougher."""


@dataclass(frozen=True)
class Case:
    """A track and a train, as the project reads them and as the verifier does."""

    route: Route
    vehicle: Vehicle
    line: Line
    train: Train

    @classmethod
    def read(cls, track: str, train: str) -> Case:
        line, own = track_path(track), train_path(train)
        return cls(load_route(str(line)), load_vehicle(str(own)), Line.read(line), Train.read(own))

    def heavier(self, factor: float, *, motors_only: bool) -> Case:
        """With so many times the mass behind the same motors and brakes."""
        vehicle = replace(self.vehicle, mass_kg=factor * self.vehicle.mass_kg)
        train = replace(self.train, mass_kg=factor * self.train.mass_kg, rotating_kg=factor * self.train.rotating_kg)
        if motors_only:
            vehicle = replace(vehicle, brake_policy=BrakePolicy.ELECTRIC)
            train = replace(train, brakes="electric", friction_n=0.0)
        return replace(self, vehicle=vehicle, train=train)

    def sections(self) -> Iterator[tuple[float, float]]:
        return pairwise(self.line.stops_m)

    def findings(self, front: Front, time_s: float, ends_m: tuple[float, float], **how: bool) -> list[Finding]:
        """What the verifier says of the run of a time, and of what the command would print."""
        solution = front.trajectory(time_s)
        claim = solution_json(solution, solution.least_time_s, 0.0)
        rows = csv_rows(solution.trajectory)
        return verify(rows, self.line, self.train, self.train.own_loss(), ends_m=ends_m, claim=claim, **how)


@dataclass(frozen=True)
class Answer:
    """Sums over the sections of a case: least time, and energy with 5 % more."""

    sections: int
    least_time_s: float
    energy_kwh: float

    def __str__(self) -> str:
        return f"{self.least_time_s:.1f} s, {self.energy_kwh:.2f} kWh"


def solve_and_verify(case: Case) -> Answer:
    """Every section at every buffer; fails with the findings of the first run that is wrong."""
    times_s, energies_kwh = [], []
    for ends_m in case.sections():
        front = solve_front(build_section(case.route, case.vehicle, start_m=ends_m[0], end_m=ends_m[1]))
        least_s = front.fastest().time_s
        for buffer_ratio in (*BUFFERS_RATIO, AMPLE_RATIO):
            creeping = buffer_ratio == AMPLE_RATIO
            findings = case.findings(front, least_s * (1 + buffer_ratio), ends_m, driven=not creeping)
            assert findings == [], (ends_m, buffer_ratio, [str(finding) for finding in findings])
        times_s.append(least_s)
        energies_kwh.append(front.trajectory(least_s * 1.05).balance.input / 3.6e6)
    return Answer(len(times_s), sum(times_s), sum(energies_kwh))


def published() -> dict[str, list[str]]:
    """Rows of docs/results/0.2/solver/tracks.csv by track: the number of sections, then one cell a train."""
    with (DOCS / "results" / "0.2" / "solver" / "tracks.csv").open(encoding="utf-8", newline="") as file:
        return {row[0]: row[1:] for row in csv.reader(file)}


@pytest.mark.slow
@pytest.mark.parametrize(("track", "train"), crossed(tracks_here(), TRAINS))
def test_every_track_and_train_is_solved_and_verified(track: str, train: str) -> None:
    """Every run against the independent verifier; times and energies against the table of the page."""
    answer = solve_and_verify(Case.read(track, train))
    row = published()[track]
    said = [float(number) for number in re.findall(r"[\d.]+", row[1 + TRAINS.index(train)])]
    assert int(row[0]) == answer.sections
    assert said == pytest.approx([answer.least_time_s, answer.energy_kwh], rel=PUBLISHED_RATIO)


# --- refused, or not --------------------------------------------------------------------------------------------


def obstacle(case: Case, start_m: float, end_m: float) -> tuple[str, float] | None:
    """What makes a section impossible and where, from raw data: v² stepwise backwards at full brake, then forwards."""
    line, train, length = case.line, case.train, case.train.length_m
    s = np.linspace(start_m, end_m, int(np.ceil((end_m - start_m) / STEP_M)) + 1)
    step = s[1] - s[0]
    weight = train.mass_kg * np.diff(G * line.gradients.driven(s, length) + line.curves.driven(s, length)) / step
    tunnel = np.diff(train.tunnel_profile(line).driven(s, length)) / step
    cap = limits_under(line, train, s)

    def resisted(i: int, square: float) -> float:
        v = square**0.5
        return float(weight[i] + train.r0_n + train.r1_n_per_mps * v + (train.r2_n_per_mps2 + tunnel[i]) * square)

    envelope = np.zeros(len(s))
    for i in reversed(range(len(s) - 1)):
        square = envelope[i + 1]
        brake = float(train.both_brakes_n(np.sqrt(square)))
        slowing = min((brake + resisted(i, square)) / train.inertia_kg, train.max_deceleration_mps2)
        envelope[i] = min(square + 2 * step * slowing, cap[i] ** 2)
        if envelope[i] <= 0:
            return "cannot brake on the descent", float(s[i])
    square = 0.0
    for i in range(len(s) - 1):
        traction = float(train.motors_n(np.sqrt(square))[0])
        gaining = min((traction - resisted(i, square)) / train.inertia_kg, train.max_acceleration_mps2)
        square = min(square + 2 * step * gaining, envelope[i + 1])
        if square <= 0 and i < len(s) - 2:
            return "stalls", float(s[i])
    return None


def limits_under(line: Line, train: Train, s: Floats) -> Floats:
    """Lowest limit over the train in each step."""
    lowest = np.full(len(s) - 1, train.max_speed_mps)
    starts = line.limits.start_m
    for a, b, limit in zip(starts, (*starts[1:], np.inf), line.limits.value, strict=True):
        touched = (s[1:] > a) & (s[:-1] < b + train.length_m)
        lowest = np.where(touched, np.minimum(lowest, limit), lowest)
    return lowest


def out_of_balance(case: Case, reason: str, at_m: float) -> bool:
    """Whether a train standing at (or just behind) a place runs away under full brake, or cannot set off."""
    train, heads = case.train, np.linspace(at_m, at_m + NEAR_M, 100)
    weight = train.mass_kg * G * case.line.gradients.under(heads, train.length_m)
    held = train.mass_kg * case.line.curves.under(heads, train.length_m) + train.r0_n
    if reason == "stalls":
        return bool((weight + held > train.motors_n(np.zeros(1))[0]).any())
    return bool((-weight - held > train.both_brakes_n(np.zeros(1))).any())


def build(case: Case, ends_m: tuple[float, float]) -> Section | tuple[str, float]:
    """The section, or why it is refused and where."""
    try:
        return build_section(case.route, case.vehicle, start_m=ends_m[0], end_m=ends_m[1])
    except InfeasibleError as error:
        named = re.search(r"(stalls|cannot brake on the descent) at (\d+) m", str(error))
        return (named[1], float(named[2])) if named else (str(error), np.nan)


@pytest.mark.slow
@pytest.mark.parametrize(("track", "train"), crossed(HILLY, TRAINS))
def test_an_overloaded_train_is_refused_for_the_true_reason(track: str, train: str) -> None:
    """Up to 15 times the mass, with and without friction brake: refused where it is impossible, else verified."""
    for factor, motors_only in OVERLOADS:
        case = Case.read(track, train).heavier(factor, motors_only=motors_only)
        for ends_m in case.sections():
            expected, built = obstacle(case, *ends_m), build(case, ends_m)
            where = (factor, motors_only, ends_m, expected)
            if isinstance(built, Section):
                assert expected is None, where
                front = solve_front(built, lambda_w=np.array([1e6]))
                findings = case.findings(front, 1.0, ends_m)
                assert findings == [], (where, [str(finding) for finding in findings])
            else:
                assert expected is not None, (where, built)
                assert built == (expected[0], pytest.approx(expected[1], abs=NEAR_M)), where
                assert out_of_balance(case, *built), where


def test_the_overloaded_trains_meet_both_obstacles() -> None:
    """The test above would prove little if no case stalled and none failed to brake: here both happen."""
    case = Case.read("CH_Stadelhofen_Altstetten", "NL_Intercity_VIRM6").heavier(4, motors_only=True)
    met = [obstacle(case, *ends_m) for ends_m in case.sections()]
    assert [found and found[0] for found in met] == ["cannot brake on the descent", "stalls", None]


# --- docs/results/0.2/solver/tracks.csv --------------------------------------------------------------------------


def table() -> str:
    rows = [["track", "sections", *TRAINS]]
    for track in TRACKS:
        answers: list[Any] = [solve_and_verify(Case.read(track, train)) for train in TRAINS]
        rows.append([track, str(answers[0].sections), *map(str, answers)])
    return csv_text(rows)


if __name__ == "__main__":
    print(table(), end="")
