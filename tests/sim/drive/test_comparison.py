"""Drives at the same places: the same day does not differ, others part where they were driven otherwise."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from das.bus import topics
from das.domain.errors import DasError
from sim.drive.comparison import AlignedDrives, DriveOnTrack, as_csv, as_dict, on_track, sentences
from sim.drive.drive import Drive
from sim.drivers.cab import Driver
from sim.drivers.drivers import PerfectDriver
from sim.review.pictures import comparison_figure
from tests.support.flat_days import flat_day
from tests.support.recorded_days import DrivesFaster, inputs_of_day, recorded_day


def drive(driver: Driver, label: str) -> DriveOnTrack:
    return on_track(Drive(recording=recorded_day(flat_day(), driver), given=inputs_of_day(flat_day())), label)


@cache
def calm() -> DriveOnTrack:
    return drive(PerfectDriver(flat_day().service.line), "calm")


@cache
def fast() -> DriveOnTrack:
    return drive(DrivesFaster(PerfectDriver(flat_day().service.line), 3.0), "fast")


def test_two_runs_of_the_same_seed_do_not_differ() -> None:
    again = drive(PerfectDriver(flat_day().service.line), "again")
    aligned = AlignedDrives.of([calm(), again])
    assert aligned.is_same(1)
    assert aligned.first_different_advice(1) is None
    assert all(one.time_s == one.energy_j == one.lost_j == 0 for one in aligned.stretches(1))
    assert sentences(aligned, 1) == [
        "again does not differ from calm: times, speeds, energies and advice are the same."
    ]


def test_stretches_sum_to_the_whole_difference_in_time_and_energy() -> None:
    aligned = AlignedDrives.of([calm(), fast()])
    assert not aligned.is_same(1)
    rows = aligned.stretches(1)
    for name in ("time_s", "energy_j", "lost_j"):
        whole = getattr(aligned, name)
        more = whole[1, -1] - whole[0, -1]
        assert sum(getattr(one, name) for one in rows) == pytest.approx(more, abs=1e-6)
    advised = aligned.first_different_advice(1)
    assert advised is not None
    assert advised.first != advised.other
    assert 0.0 <= advised.s_m <= 6000.0


def test_the_picture_names_the_stops_that_all_drives_have_and_says_the_result() -> None:
    figure = comparison_figure(AlignedDrives.of([calm(), fast()]))
    speed = figure.axes[0]
    named = {text.get_text() for one in (speed, *speed.child_axes) for text in (*one.texts, *one.get_xticklabels())}
    assert {"A", "B"} <= named
    assert any(str(line.get_label()).startswith("fast: ") for line in speed.lines)


def test_more_energy_is_told_where_the_faster_drive_took_it() -> None:
    aligned = AlignedDrives.of([calm(), fast()])
    found = as_dict(aligned)["drives"][1]
    assert found["more_energy_kwh"] > 0.3
    assert found["same"] is False
    assert found["measured"] is True
    less_s, more_kwh = -found["more_time_s"], found["more_energy_kwh"]
    assert sentences(aligned, 1)[0] == f"fast took {less_s:.0f} s less and {more_kwh:.1f} kWh more than calm."


def limited(one: DriveOnTrack) -> DriveOnTrack:
    """The drive on the same line with a lower limit from 2003 m to 4001 m."""
    line = one.drive.table.inputs
    limits = line.route.limits_mps
    start_m, value = np.array([0.0, 2003.0, 4001.0]), np.array([limits.value[0], 20.0, limits.value[0]])
    route = replace(line.route, limits_mps=replace(limits, start_m=start_m, value=value))
    return replace(one, drive=replace(one.drive, given=replace(line, route=route)))


def test_positions_are_a_constant_step_apart_and_a_change_of_the_limit_is_two_rows() -> None:
    aligned = AlignedDrives.of([limited(calm()), fast()], 50.0)
    doubled = np.flatnonzero(np.diff(aligned.s_m) == 0)
    np.testing.assert_array_equal(aligned.s_m[doubled], [2003.0, 4001.0])
    np.testing.assert_allclose(aligned.limit_mps[doubled[0] : doubled[0] + 2], [aligned.limit_mps[0], 20.0])
    even = np.delete(aligned.s_m, np.concatenate((doubled, doubled + 1)))
    np.testing.assert_allclose(np.diff(even)[:-1], 50.0)
    lines = as_csv(aligned).decode().splitlines()
    assert len(lines) == len(aligned.s_m) + 1
    assert lines[0].startswith(
        "s_m,limit_kmh,clock_s_1,time_s_1,speed_kmh_1,energy_kwh_1,lost_kwh_1,clock_s_2,time_s_2"
    )


def test_drives_of_another_line_are_refused_and_other_trains_are_said_to_be() -> None:
    one = calm()
    recording = one.drive.recording
    messages = dict(recording.messages)
    journey = type(messages["journey"][0].message).FromString(messages["journey"][0].message.SerializeToString())
    journey.vehicle_id = "other-train"
    renamed = replace(recording, messages={**messages, "journey": (messages["journey"][0]._replace(message=journey),)})
    other = replace(
        calm(), drive=replace(calm().drive, recording=renamed), label="other", speed_mps=calm().speed_mps + 0.1
    )
    aligned = AlignedDrives.of([calm(), other])
    assert aligned.trains_differ
    assert "They are different trains: re460-ic and other-train." in sentences(aligned, 1)
    journey.route_id = "elsewhere"
    elsewhere = replace(other, drive=replace(other.drive))  # re-read
    assert elsewhere.drive.recording.of(topics.JOURNEY)[-1].message.route_id == "elsewhere"
    with pytest.raises(DasError, match="drives elsewhere"):
        AlignedDrives.of([calm(), elsewhere])


def test_what_is_said_of_two_drives_does_not_depend_on_a_third() -> None:
    run = {**calm().drive.recording.metadata.get("run", {}), "kind": "run", "driver": "human"}
    otherwise = replace(calm().drive.recording, metadata={"run": {**run, "friction_policy": "as-measured"}})
    third = replace(calm(), label="third", drive=replace(calm().drive, recording=otherwise), s_m=calm().s_m[:-200])
    names = ("time_s", "speed_mps", "energy_j", "motors_first_j", "advised_mode", "advised_mps")
    third = replace(third, **{name: getattr(calm(), name)[:-200] for name in names})
    two, three = (AlignedDrives.of(some) for some in ([calm(), fast()], [calm(), fast(), third]))
    assert two.own_energies
    assert not three.own_energies
    assert three.s_m[-1] < two.s_m[-1]
    assert as_dict(three)["drives"][1] == as_dict(two)["drives"][1]
    assert sentences(three, 1) == sentences(two, 1)
