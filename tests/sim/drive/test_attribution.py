"""Where the energy went: the parts sum to the energy balance's difference, and planted faults are found."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from das.advice.regimes import InstructionKind
from das.bus import das_pb2
from das.bus.recording import Stamped
from das.domain.errors import DasError
from das.domain.files.load import load_route, load_vehicle
from das.domain.units import kwh
from das.solver.section import build_section
from das.solver.solve import solve_front
from sim.drive.above_optimum import AboveOptimum, why_not_comparable
from sim.drive.attribution import Attribution, as_dict, doing
from sim.drive.causes import LABELS, MEANINGS, EnergyCause
from sim.drive.drive import Drive
from sim.drivers.cab import Driver
from sim.drivers.drivers import PerfectDriver
from sim.world.outcome import fronts_of_braking
from sim.world.scenario import load_scenario
from sim.world.service import Day, make_day
from tests.support.flat_days import flat_day, service_for, signal_at
from tests.support.hand_recorded import in_memory
from tests.support.recorded_days import BrakesByFriction, CoastsLate, DrivesFaster, inputs_of_day, recorded_day

FIVE_KMH = 5.0 / 3.6


@cache
def clear_day() -> Day:
    return make_day(service_for(load_scenario("clear-day")), 1)


@cache
def faultless() -> Attribution:
    return attribution(clear_day(), PerfectDriver(clear_day().service.line))


@cache
def on_time() -> Attribution:
    """The flat day as a perfect follower drives it."""
    return attribution(flat_day(), PerfectDriver(flat_day().service.line))


@cache
def heavier() -> Drive:
    """A train that is a fifth heavier than planned, as a perfect follower drives it."""
    day = flat_day("[truth]\nmass_ratio = 1.2\n")
    return Drive(recording=recorded_day(day, PerfectDriver(day.service.line)), given=inputs_of_day(day))


def attribution(day: Day, driver: Driver) -> Attribution:
    return Drive(recording=recorded_day(day, driver), given=inputs_of_day(day)).energy.known_attribution


def check_sums(found: Attribution) -> None:
    for leg in found.legs:
        difference_j = leg.driven_j - leg.optimum_j
        assert sum(leg.by_cause.values()) == pytest.approx(difference_j, abs=1.0)
        assert float(leg.even.lost_more_j.sum()) == pytest.approx(difference_j, abs=1.0)
        assert float(leg.even.driven_j.sum()) == pytest.approx(leg.driven_j, abs=1.0)
        assert float(leg.even.optimum_j.sum()) == pytest.approx(leg.optimum_j, abs=1.0)
        assert float(leg.even.driven_s.sum()) == pytest.approx(leg.leg.trip_s)
        np.testing.assert_array_equal(leg.even.start_m[1:], leg.even.end_m[:-1])


@pytest.mark.nightly
def test_a_perfect_follower_drives_the_optimum_and_nothing_is_blamed() -> None:
    """What he needs above the optimum is the price of braking as the advice plans; it counts as driven as advised."""
    found, fronts = faultless(), fronts_of_braking(clear_day(), None)
    check_sums(found)
    planned_j = sum(
        front.trajectory(leg.leg.trip_s).balance.input for front, leg in zip(fronts, found.legs, strict=True)
    )
    small_j = 1e-3 * found.above.driven_j
    assert 0.0 < planned_j - found.above.optimum_j < 5.0 * small_j
    assert abs(found.above.driven_j - planned_j) < small_j
    others_j = {cause: found_j for cause, found_j in found.by_cause.items() if cause is not EnergyCause.AS_ADVISED}
    assert all(abs(one_j) < small_j for one_j in others_j.values()), others_j


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("fault", "cause", "least"),
    [
        (lambda driver: CoastsLate(driver, 20.0), EnergyCause.LATE_COASTING, 0.9),
        (BrakesByFriction, EnergyCause.FRICTION, 0.9),
        # The advice is planned again for the faster train, and following that costs energy as well.
        (lambda driver: DrivesFaster(driver, FIVE_KMH), EnergyCause.AGAINST_ADVICE, 0.65),
    ],
    ids=["coasts-late", "friction", "faster"],
)
def test_a_planted_fault_gets_most_of_the_energy_above_the_optimum(
    fault: type, cause: EnergyCause, least: float
) -> None:
    found = attribution(clear_day(), fault(PerfectDriver(clear_day().service.line)))
    check_sums(found)
    more_j = found.above.difference_j - faultless().above.difference_j
    # By as much more than without the fault, within what the figures hold.
    assert least * more_j <= found.by_cause[cause] - faultless().by_cause.get(cause, 0.0) <= 1.12 * more_j
    assert abs(found.by_cause[EnergyCause.TRAIN]) < 0.06 * more_j  # The train is as planned.


def test_a_drive_that_cannot_be_compared_with_its_optimum_has_no_energy_attribution() -> None:
    """A train that is slower than the drive has no optimum for its times; a replay may know of another reason."""
    day = flat_day()
    recording, inputs = recorded_day(day, PerfectDriver(day.service.line)), inputs_of_day(day)
    slow = replace(inputs, vehicle=replace(inputs.vehicle, max_speed_mps=20.0))
    why = "this train cannot arrive as early as the trip did: the optimum is its fastest"
    with pytest.raises(DasError, match=f"day.mcap: not comparable: {why}"):
        _ = Drive(recording=recording, given=slow).energy.known_attribution
    said = {**recording.messages, "saving": (Stamped(0, das_pb2.Saving(comparable=False)),)}
    why = "according to the recording, its trip and the optimum cannot be compared"
    with pytest.raises(DasError, match=f"day.mcap: not comparable: {why}"):
        _ = Drive(recording=replace(recording, messages=said), given=inputs).energy.known_attribution


def test_why_a_drive_cannot_be_compared() -> None:
    fits = on_time().above.sections[0]
    late = replace(fits, late_s=2.5)
    assert why_not_comparable([fits, fits]) == ""
    assert why_not_comparable([fits, late]).endswith("the optimum is its fastest run, 2.5 s later")
    assert why_not_comparable([fits], direction_known=False) == "the direction of the trip is not known"


def test_a_simulated_drive_is_compared_with_the_optimum_of_its_true_train() -> None:
    """The simulator recorded what its true train needs: the report then says the same as the run did."""
    recording, plain = heavier().recording, heavier().energy.known_attribution
    (leg,) = plain.above.sections
    true_j = leg.optimum_j + 3.6e6
    said = AboveOptimum.of([replace(leg, optimum_j=true_j)], measured=True).message(0)
    known = Drive(
        recording=replace(recording, messages={**recording.messages, "saving": (Stamped(0, said),)}),
        given=inputs_of_day(flat_day("[truth]\nmass_ratio = 1.2\n")),
    ).energy.known_attribution
    assert (known.above.optimum_j, known.other_train_j) == pytest.approx((true_j, 3.6e6))
    assert known.above.ratio == pytest.approx((known.above.driven_j - true_j) / true_j)
    check_sums(known)
    assert known.by_cause[EnergyCause.TRAIN] == pytest.approx(plain.by_cause[EnergyCause.TRAIN] - 3.6e6, abs=1.0)
    assert known.against_timetable == pytest.approx(plain.against_timetable)


def test_the_energy_that_a_signal_costs_is_the_signals() -> None:
    day = flat_day(signal_at(3000.0, 900.0))
    found = attribution(day, PerfectDriver(day.service.line))
    check_sums(found)
    parts = found.by_cause
    assert parts[EnergyCause.SIGNAL] > 0.3 * found.above.difference_j
    blamed = parts.get(EnergyCause.AGAINST_ADVICE, 0.0) + parts.get(EnergyCause.LATE_COASTING, 0.0)
    assert blamed < 0.1 * found.above.difference_j


def test_a_train_that_is_heavier_than_planned_is_told_apart() -> None:
    found = heavier().energy.known_attribution
    check_sums(found)
    assert found.by_cause[EnergyCause.TRAIN] > 0.4 * found.above.difference_j


def test_lateness_that_is_recovered_has_its_price_in_the_sum_against_the_timetable() -> None:
    """A driver who leaves 10 s late and goes for the timetable pays for it although he drives as well as possible."""
    late = "[[disturbances]]\nkind = 'departure-delay'\nstop = 'A'\ndelay_s = 10\n"
    in_time, delayed = on_time(), attribution(flat_day(late), PerfectDriver(flat_day(late).service.line))
    for found in (in_time, delayed):
        against, timetable_j = found.against_timetable, found.timetable_j
        assert against is not None
        assert timetable_j is not None
        assert sum(against.values()) == pytest.approx(
            found.above.driven_j - timetable_j, abs=1e-3 * found.above.driven_j
        )
    assert in_time.timetable_j == pytest.approx(delayed.timetable_j)
    price_j = (delayed.against_timetable or {})[EnergyCause.RECOVERED]
    more_j = delayed.above.driven_j - in_time.above.driven_j
    assert price_j > 0.05 * in_time.above.driven_j
    assert price_j + (delayed.against_timetable or {})[EnergyCause.ARRIVAL] == pytest.approx(more_j, rel=0.15)
    assert abs((in_time.against_timetable or {})[EnergyCause.RECOVERED]) < 0.2 * price_j


def test_the_rows_for_programs_have_every_place_and_cause() -> None:
    day = flat_day()
    found = attribution(day, DrivesFaster(PerfectDriver(day.service.line), FIVE_KMH))
    rows = as_dict(found)
    (leg,) = rows["legs"]
    assert (
        rows["by_cause_kwh"] == leg["by_cause_kwh"] == {cause: kwh(part_j) for cause, part_j in found.by_cause.items()}
    )
    assert len(leg["per_100_m"]) == 60
    assert sum(row["lost_more_kwh"] for row in leg["per_100_m"]) == pytest.approx(rows["above_optimum_kwh"], abs=1e-6)


def test_what_the_best_run_does_is_what_it_does_for_most_of_the_time() -> None:
    """On the level it accelerates, holds its speed, coasts, and brakes to the stop."""
    front = solve_front(build_section(load_route("flat-6km"), load_vehicle("re460-ic")))
    run = front.trajectory(1.05 * front.fastest().time_s).trajectory
    force_n = run.force_el_n + run.force_friction_n
    idle_n = 0.02 * float(np.abs(run.force_el_n).max())
    coasts_m = run.s_m[:-1][np.abs(force_n) < idle_n]
    brakes_m = float(run.s_m[:-1][force_n < -idle_n].min())
    holds_m, coasts_m, ends_m = float(coasts_m.min()) - 300.0, float(coasts_m.min()), float(coasts_m.max())
    for start_m, end_m, action in (
        (0.0, 500.0, InstructionKind.TRACTION),
        (holds_m, coasts_m - 50.0, InstructionKind.HOLD),
        (coasts_m, ends_m, InstructionKind.COAST),
        (brakes_m - 300.0, brakes_m + 50.0, InstructionKind.COAST),
        (brakes_m, 6000.0, InstructionKind.BRAKE),
    ):
        found = doing(run, start_m, end_m)
        assert found is not None
        assert found.action is action
        assert found.start_m <= end_m
        assert found.end_m >= start_m
    for start_m, end_m, whole_m in (
        (brakes_m + 50.0, brakes_m + 100.0, (brakes_m, 6000.0)),
        (brakes_m - 300.0, brakes_m - 200.0, (coasts_m, brakes_m)),
    ):
        assert (doing(run, start_m, end_m) or (None,))[1:] == pytest.approx(whole_m, abs=60.0)
    assert doing(run, 0.0, 6000.0) is None


def test_every_cause_has_its_words() -> None:
    assert set(LABELS) == set(MEANINGS) == set(EnergyCause)


def test_a_recording_without_a_journey_is_refused() -> None:
    with pytest.raises(DasError, match="holds no journey"):
        _ = Drive(recording=in_memory()).energy.known_attribution
