"""A run just driven and its recording are the same drive, and every figure of a drive is found once."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import asdict, replace
from functools import cache

import numpy as np
import pytest

from das.bus.recording import Stamped
from sim.drive.calls import KeptCall
from sim.drive.drive import Drive
from sim.drive.limits import Signal, Violations, violations_of
from sim.drivers.kinds import DriverKind
from sim.recording.course import DrivenCourse
from sim.world.outcome import DayOutcome, outcome
from tests.support.flat_days import flat_day
from tests.support.recorded_days import inputs_of_day, run_and_recording

S = 1_000_000_000


@cache
def driven() -> tuple[DayOutcome, Drive]:
    """A day with another train than planned: what its run came to, and the drive of its recording."""
    day = flat_day("[truth]\nmass_ratio = 1.1\n")
    run, recording = run_and_recording(day, day.driver(DriverKind.HUMAN))
    found = outcome(day, run, DriverKind.HUMAN)
    said = found.energies.above.message(recording.of("truth")[-1].message.time_ns)
    messages = {**recording.messages, "saving": (Stamped(0, said),)}
    return found, Drive(recording=replace(recording, messages=messages), given=inputs_of_day(day))


def test_a_run_and_its_recording_keep_the_same_stops() -> None:
    run, recorded = driven()
    assert [one.name for one in run.calls] == [one.name for one in recorded.calls]
    for ours, theirs in zip(run.calls, recorded.calls, strict=True):
        assert (ours.due_arrival_ns, ours.due_departure_ns) == (theirs.due_arrival_ns, theirs.due_departure_ns)
        assert theirs.late_s == pytest.approx(ours.late_s, abs=0.3)
        assert theirs.stopping_error_m == pytest.approx(ours.stopping_error_m, abs=0.1)
    assert recorded.late_s == pytest.approx(driven()[0].late_s, abs=0.3)


def test_a_run_and_its_recording_are_equally_far_above_the_optimum_of_the_true_train() -> None:
    run, recorded = driven()[0].energies.above, driven()[1].energy.above
    assert run is not None
    assert recorded is not None
    assert recorded.optimum_j == pytest.approx(run.optimum_j)
    assert recorded.driven_j == pytest.approx(run.driven_j, rel=2e-3)
    assert run.ratio is not None
    assert recorded.ratio == pytest.approx(run.ratio, abs=2e-3)
    attribution = driven()[1].energy.known_attribution
    assert attribution.other_train_j > 0.03 * run.optimum_j  # a heavier train needs more than the plan's
    assert driven()[1].energy.driven_j == pytest.approx(attribution.above.driven_j)


def test_a_run_and_its_recording_have_the_same_limits_and_advice() -> None:
    run, recorded = driven()[0].figures, driven()[1].figures
    assert asdict(recorded.stability) == pytest.approx(asdict(run.stability), nan_ok=True)
    assert run.stability.changes > 0
    assert recorded.violations.over_limit_s == pytest.approx(run.violations.over_limit_s, abs=2.0)
    assert recorded.violations.signals_passed == run.violations.signals_passed == 0


def test_every_figure_is_found_once() -> None:
    drive = driven()[1]
    for where, names in (
        (drive, ("table", "calls", "limit_mps", "events", "energy", "figures", "series")),
        (drive.table, ("course", "clock")),
        (drive.energy, ("motion", "legs", "known_attribution")),
    ):
        for name in names:
            assert getattr(where, name) is getattr(where, name), name


def test_a_record_without_truth_is_used_as_it_is_in_memory() -> None:
    """Its file is not opened again: of a part of a drive, or of one of several trains, that would be another record."""
    simulated = driven()[1]
    messages = {name: one for name, one in simulated.recording.messages.items() if name not in ("truth", "saving")}
    alone = Drive(recording=replace(simulated.recording, messages=messages), given=simulated.given)
    (leg,) = alone.energy.legs
    first, last = alone.calls
    assert (leg.motion.time_ns[0], leg.motion.time_ns[-1]) == (first.departed_ns, last.arrived_ns)
    assert not alone.energy.known_attribution.above.measured
    # Of a lighter train that brakes with its motors first, as far as anybody knows.
    assert 0.4 < alone.energy.known_attribution.above.driven_j / simulated.energy.known_attribution.above.driven_j < 1.0
    assert alone.late_s == pytest.approx(simulated.late_s, abs=3.0)


def test_speeds_above_the_limit_and_signals_passed_are_found_in_positions() -> None:
    at = np.arange(10, dtype=np.int64) * S
    trip = DrivenCourse(time_ns=at, s_m=20.0 * np.arange(10.0), speed_mps=np.full(10, 20.0))
    limit_mps = np.array([25.0] * 4 + [15.0] * 3 + [np.nan] * 3)
    kept, passed = Signal(s_m=170.0, start_ns=0, end_ns=8 * S), Signal(s_m=100.0, start_ns=0, end_ns=7 * S)
    found = violations_of(trip, limit_mps, [kept, passed])
    assert found == Violations(signals_passed=1, beyond_signal_m=40.0, over_limit_s=3.0, over_limit_mps=5.0)
    assert violations_of(trip, np.full(10, 20.0), []) == Violations()


def test_stops_that_were_missed_or_overrun_are_a_figure() -> None:
    def call(stood_m: float, *, reached: bool = True) -> KeptCall:
        return KeptCall(name="X", s_m=1000.0, due_arrival_ns=0, due_departure_ns=0, arrived_ns=1, departed_ns=1,
                        stood_m=stood_m, reached=reached)  # fmt: skip

    _, drive = driven()
    assert drive.figures.as_dict()["stops_missed"] == 0
    kept, overrun, passed, ahead = call(1001.0), call(1050.0), call(np.nan), call(np.nan, reached=False)
    found = replace(drive.figures, calls=(passed, kept, overrun, passed, ahead))
    assert found.as_dict()["stops_missed"] == 2
    assert ("stops missed or overrun", "2") in found.rows()


@pytest.mark.parametrize(
    "code",
    [
        "from pathlib import Path\nfrom sim.cli.trips import bundled_recording\n"
        "from sim.cli.review import ListedEvents, NewNote, ReportPart, report\nfrom sim.options import PageFiles\n"
        "report([bundled_recording()], PageFiles(), ListedEvents(), NewNote(), [ReportPart.EVENTS])\n"
        "unwanted = ['das.solver']",
        "import sim.cli.review, sim.drive.comparison, sim.drive.energy, sim.review.first_page\n"
        "from sim.drivers.presentations.presenter import Presentation, presenter_of\n"
        "_ = [presenter_of(one) for one in Presentation]\n"
        "unwanted = 'matplotlib', 'jinja2', 'sim.drive.notes', 'sim.drive.series', 'sim.plant', 'sim.review.page'",
    ],
    ids=["events and notes without the solver", "a report in words without pictures and train model"],
)
def test_a_report_loads_what_it_needs_alone(code: str) -> None:
    code += "\nimport sys\nprint([name for name in sys.modules if name.startswith(tuple(unwanted))])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_without_a_journey_nobody_knows_how_late_the_train_is() -> None:
    _, drive = driven()
    recording = drive.recording
    messages = {name: entries for name, entries in recording.messages.items() if name != "journey"}
    bare = Drive(recording=replace(recording, messages=messages), given=drive.given)
    assert bare.calls == ()
    assert np.isnan(bare.late_s)
