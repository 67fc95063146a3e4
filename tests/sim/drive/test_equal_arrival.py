"""Two drives at equal arrival: what a later arrival is worth is no saving, and what is no pair is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import pytest

from sim.drive.comparison import OTHER_BRAKES, EqualArrival, SavedByAdvice, brakes_of, same_brakes
from sim.drive.drive import Drive
from sim.drivers.kinds import DriverKind
from tests.support.flat_days import flat_day
from tests.support.recorded_days import inputs_of_day, recorded_day

DAY = {"scenario_sha256": "s", "seed": "1", "driver": "human", "friction_policy": "as-measured"}

RUNS_DIFFER = "the runs differ in scenario, seed, line, train or disturbances"


@cache
def driven(driver: DriverKind = DriverKind.PERFECT) -> Drive:
    recording = recorded_day(flat_day(), flat_day().driver(driver))
    return Drive(recording=recording, given=inputs_of_day(flat_day()))


def told(drive: Drive, **metadata: str) -> Drive:
    """The drive with other metadata of its run."""
    run = {**drive.recording.metadata["run"], **DAY, **metadata}
    return Drive(recording=replace(drive.recording, metadata={"run": run}), given=drive.given)


def test_the_time_difference_is_worth_what_the_optimum_needs_for_it() -> None:
    calm, fast = told(driven(), advice="guide"), told(driven(DriverKind.FAST), advice="none")
    found = EqualArrival.of(fast, calm, own=True)
    (before,), (after,) = (drive.energy.compared for drive in (fast, calm))
    later_s = after.leg.trip_s - before.leg.trip_s
    assert later_s > 0.5
    assert found.times_j is not None
    assert found.more_j is not None
    # At a price between those of both optima.
    assert after.optimum.lambda_w * later_s <= -found.times_j * 1.02
    assert -found.times_j <= before.optimum.lambda_w * later_s * 1.02
    assert fast.energy.above is not None
    assert calm.energy.above is not None
    assert found.more_j == pytest.approx((calm.energy.above.above_j or 0.0) - (fast.energy.above.above_j or 0.0))
    for pair in ((fast, calm), (calm, fast)):
        saved = SavedByAdvice.of(*pair)
        assert saved.saved_j == pytest.approx(-found.more_j)
        # In % of the optimum, and the same figure whichever drive is named first.
        assert saved.ratio == pytest.approx(
            -2.0 * found.more_j / (fast.energy.above.optimum_j + calm.energy.above.optimum_j)
        )
        words = f"{abs(100.0 * (saved.ratio or 0.0)):.1f} % of the optimum)"
        assert words in saved.sentence
        assert words in EqualArrival.of(*pair, own=True).sentence("first")


@pytest.mark.parametrize(
    ("other", "why_not"),
    [
        ({"seed": "2"}, RUNS_DIFFER),
        ({"drawn": json.dumps({"disturbances": ["delay"]})}, RUNS_DIFFER),
        ({"what_if_kept": json.dumps({"load": "full"})}, RUNS_DIFFER),
        ({"driver": "timetable"}, "the drivers differ"),
        ({"drawn": json.dumps({"human": {"participant": 3}})}, "the drivers differ"),
        ({"friction_policy": "electric-first"}, "the brakes differ"),
        ({"advice": "none"}, "exactly one of them must be without advice"),
        ({"kind": "replay"}, "this needs two simulated runs with the same disturbances, one of them without advice"),
    ],
)
def test_what_is_no_pair_is_refused(other: dict[str, str], why_not: str) -> None:
    alone, advised = told(driven(), advice="none"), told(driven(), **{"advice": "guide", **other})
    assert SavedByAdvice.of(alone, advised) == SavedByAdvice(saved_j=None, ratio=None, why_not=why_not)
    assert (
        SavedByAdvice.of(alone, told(driven(), advice="guide", what_if_kept=json.dumps({"load": None}))).why_not == ""
    )


def test_brakes_that_depend_on_the_advice_are_not_the_same() -> None:
    first, other = (told(driven(), friction_policy="by-advice", advice=name) for name in ("none", "speed-and-effort"))
    assert not same_brakes((first, other))
    assert brakes_of(told(driven(), friction_policy="electric-first")) == brakes_of(told(driven(), driver="top-speed"))
    found = EqualArrival.of(first, other, own=False)
    assert found.hangs_on == OTHER_BRAKES
    assert found.more_j == pytest.approx(0.0, abs=1e-6)
