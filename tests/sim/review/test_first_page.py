"""The first page says in four figures and three findings what the rest of the report has, and how sure that is."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from markupsafe import escape

from das.domain.errors import DasError
from das.domain.units import KM, KMH
from precompute.pdf import BROWSERS, write_pdf
from sim.drive.above_optimum import energy_words
from sim.drive.attribution import worst_stretches
from sim.drive.causes import BY_SPEED, EnergyCause
from sim.drive.drive import Drive
from sim.drive.events import DriveEvent, EventKind, lateness_text
from sim.drive.limits import Signal, signals_passed
from sim.drivers.drivers import PerfectDriver
from sim.recording.course import OWN_TIMETABLE
from sim.review.first_page import (
    GAINED,
    NAMED_KWH,
    SAFER,
    DriveFinding,
    FoundPlace,
    findings,
    first_page_dict,
    how_sure,
    page_figures,
    what_happened,
)
from sim.review.page import ReviewedDrive, as_dict, subject_of
from sim.review.pictures import as_image, first_figure
from sim.review.scene import ReviewScene
from tests.sim.review.test_report import BUNDLED, RECORDINGS, at_danger, fast, other, page_of_words
from tests.support.flat_days import flat_day
from tests.support.making import das_sim
from tests.support.recorded_days import inputs_of_day, recorded_day

RESTRICTION = """
[[disturbances]]
kind = "restriction"
from_m = 3000
to_m = 3500
speed_kmh = 40
announced_m = 1000
"""
NUMBER_AS_TEXT = re.compile(r"[+−-]?\d[\d.:]*( ?(s|m|km|kWh|%|km/h|ms|MB|min).*)?|km .*")


@cache
def recorded(name: str) -> ReviewedDrive:
    """The drive of a recording of this repository."""
    return subject_of(RECORDINGS / f"{name}.mcap")


def bundled() -> ReviewedDrive:
    return recorded("zurich-zug-late")


def not_compared() -> ReviewedDrive:
    return recorded("references/departure-delay")


Subject = Callable[[], ReviewedDrive]


@cache
def in_json(subject: Subject) -> dict[str, Any]:
    (drive,) = json.loads(json.dumps(as_dict([subject()], None, "")))["drives"]
    assert isinstance(drive, dict)
    return drive


@cache
def first_in_html(subject: Subject) -> str:
    return page_of_words(subject()).partition('<section class="drive"')[0]


@pytest.mark.parametrize("subject", [fast, bundled], ids=["measured", "computed"])
def test_page_one_holds_the_four_figures_of_the_json_and_of_the_drive(subject: Subject) -> None:
    drive, html, told = subject().drive, first_in_html(subject), in_json(subject)["first_page"]
    values = re.findall(r'<p class="value">(.*?)</p>', html)
    assert values == [
        lateness_text(told["arrived_late_s"]),
        f"{told['energy_kwh']:.1f} kWh",
        energy_words(told["above_optimum_kwh"] * 3.6e6, None),
        f"{told['over_limit_s']:.0f} s",
    ]
    assert values == [one.value for one in page_figures(drive)]
    assert f"{100 * told['above_optimum_ratio']:.1f} % of the optimum" in page_figures(drive)[2].beside
    energy = in_json(subject)["energy"]
    for name in ("energy_kwh", "above_optimum_kwh", "above_optimum_ratio", "measured"):
        assert told[name] == energy[name]
    assert told["arrived_late_s"] == drive.late_s == in_json(subject)["stops"][-1]["arrived_late_s"]
    assert told["over_limit_s"] == drive.violations.over_limit_s


@pytest.mark.parametrize("subject", [fast, bundled], ids=["measured", "computed"])
def test_each_finding_has_a_place_a_time_and_the_energy_of_a_cause(subject: Subject) -> None:
    drive, html, told = subject().drive, first_in_html(subject), in_json(subject)
    zone = "UTC" if str(drive.table.zone) == "UTC" else f"those of the line ({drive.table.zone})"
    assert f"Times of day are {zone}." in html
    listed = told["first_page"]["findings"]
    assert 1 <= len(listed) <= 3
    causes, went = told["energy"]["by_cause_kwh"], drive.travelled
    for one, shown in zip(listed, findings(drive), strict=True):
        assert f"<p>{escape(one['text'])} <em>{one['next_time']}</em></p>" in html
        words = shown.where(drive.table.clock)
        assert all(f'<p class="place">{escape(place)}</p>' in html for place in words)
        assert 1 <= len(one["places"]) <= 3
        for place, line in zip(one["places"], words, strict=True):
            assert went.start_m <= place["start_m"] <= place["end_m"] <= went.end_m
            assert went.start_ns <= place["time_ns"] <= went.end_ns
            assert f", {drive.table.clock.of_day(place['time_ns'])}" in line
            assert (place["mean_speed_mps"] is not None) == (one["cause"] in {*BY_SPEED, EnergyCause.FRICTION})
        if one["above_optimum_kwh"] is None:
            assert one["cause"] == EventKind.OVERSPEED
            continue
        assert one["above_optimum_kwh"] == causes[one["cause"]]
        assert f"<b>{one['above_optimum_kwh']:.1f} kWh</b>" in html
        taken = [place["above_optimum_kwh"] for place in one["places"]]
        assert taken == sorted(taken, reverse=True)
        assert 0.2 * taken[0] <= taken[-1]
    energies = [one["above_optimum_kwh"] for one in listed if one["above_optimum_kwh"] is not None]
    apart = [value for cause, value in causes.items() if cause != EnergyCause.REST]
    assert energies == sorted(apart, reverse=True)[: len(energies)]
    rest_kwh = told["first_page"]["above_optimum_kwh"] - sum(energies)
    assert (f"All other causes, and energy not attributed: {rest_kwh:+.1f} kWh." in html) == (
        abs(rest_kwh) >= NAMED_KWH
    )


def test_page_one_says_what_happened_in_the_times_of_the_line() -> None:
    """The bundled trip runs near Zürich in winter: an hour later than UTC."""
    told = what_happened(bundled().drive)
    assert "It left at 09:05:30 (90 s late) and arrived at 09:24:24 (24 s early)." in told
    assert "At Zürich HB it stayed 90 s longer than necessary. From Zürich HB to Zug it made up 115 s" in told
    assert "ends before" not in told
    assert "8 min 35 s. The recording ends before Thalwil." in what_happened(not_compared().drive)


def test_an_early_arrival_has_its_price_and_a_replay_without_timetable_no_lateness() -> None:
    early = bundled().drive
    assert early.energy.attribution is not None
    (leg,) = early.energy.attribution.legs
    assert leg.early_j is not None
    assert (
        f"being 24 s early took {leg.early_j / 3.6e6:.1f} kWh, not counted above the optimum"
        in page_figures(early)[0].beside
    )
    run = {**early.recording.metadata["run"], OWN_TIMETABLE: "yes"}
    own = Drive(recording=replace(early.recording, metadata={**early.recording.metadata, "run": run}))
    vars(own.energy).update(_any_attribution=early.energy.any_attribution)
    assert page_figures(own)[0].value == "not known"
    assert first_page_dict(own)["arrived_late_s"] is None
    assert page_figures(own)[0].beside.endswith("no timetable was given")
    assert "late)" not in what_happened(own)
    assert "timetable" not in what_happened(own)


def test_a_restriction_is_found_where_it_holds_not_where_it_was_told() -> None:
    made = flat_day(RESTRICTION)
    drive = Drive(recording=recorded_day(made, PerfectDriver(made.service.line)), given=inputs_of_day(made))
    (told,) = [one for one in drive.events if one.text.startswith("restriction received")]
    (found,) = [one for one in findings(drive) if one.code == EnergyCause.RESTRICTION]
    assert [(one.start_m, one.end_m) for one in found.places] == [(3000.0, 3500.0)]
    assert told.s_m < 2200.0
    assert told.time_ns < found.places[0].start_ns < found.places[0].end_ns
    axis = first_figure(ReviewScene.of(drive), (found,)).axes[0]
    curves = {line.get_label(): line for line in axis.get_lines()}
    assert curves["temporary restriction"].get_xdata() == pytest.approx([3.0, 3.5], abs=0.05)


def test_the_places_of_a_cause_sum_to_its_energy_and_the_worst_stretches_are_among_them() -> None:
    attribution = fast().drive.energy.attribution
    assert attribution is not None
    for cause in EnergyCause:
        if cause in (EnergyCause.TRAIN, EnergyCause.REST):  # these have a part that belongs to no place
            continue
        placed_j = sum(float(leg.by_place(cause).sum()) for leg in attribution.legs)
        assert placed_j == pytest.approx(attribution.by_cause.get(cause, 0.0), abs=1.0)
        leg, until_m = attribution.legs[0], 0.0
        for worst in sorted(worst_stretches(attribution, cause, 3), key=lambda one: one.start_m):
            inside = (leg.even.start_m >= worst.start_m) & (leg.even.end_m <= worst.end_m)
            assert worst.energy_j == pytest.approx(float(leg.by_place(cause)[inside].sum()))
            assert until_m <= worst.start_m
            until_m = worst.end_m


def test_what_is_about_safety_comes_first_and_has_no_energy() -> None:
    before = findings(fast().drive)
    assert before
    assert all(one.energy_j is not None for one in before)
    times = fast().drive.table.course.time_ns
    facts = [{"over_kmh": 4.0, "lasted_s": 3.0}, {"over_kmh": 12.0, "lasted_s": 9.0}]
    events = tuple(
        DriveEvent(
            time_ns=int(times[100 * number]), end_ns=int(times[100 * number + 9]), kind=EventKind.OVERSPEED,
            text="up to x km/h above the limit", s_m=0.0, facts=one,
        )
        for number, one in enumerate(facts, start=1)
    )  # fmt: skip
    first, *rest = findings(other(events=events))
    (place,) = first.places
    assert (first.label, first.energy_j, place.energy_j) == ("above the limit", None, None)
    assert place.start_ns == times[200]
    assert first.text == "Up to x km/h above the limit. This is the worst of 2 times."
    course = fast().drive.table.course
    gains, slows = (
        int(np.flatnonzero(one)[0]) for one in (np.diff(course.speed_mps) > 0.1, np.diff(course.speed_mps) < -0.1)
    )
    for at, said in ((gains, GAINED), (slows, SAFER)):
        event = replace(events[0], time_ns=int(times[at]), end_ns=int(times[at + 9]))
        assert findings(other(events=(event,)))[0].next_time == said
    assert [one.code for one in rest] == [one.code for one in before][: len(rest)]


def test_a_signal_that_was_passed_at_danger_is_the_first_finding() -> None:
    trip = fast().drive.table.course
    signal = Signal(3000.0, int(trip.time_ns[0]), int(trip.time_ns[np.searchsorted(trip.s_m, 3050.0)]))
    (passed,) = signals_passed(trip, [signal])
    assert 50.0 <= passed.beyond_m < 100.0
    assert trip.s_m[trip.time_ns < passed.time_ns].max() <= 3000.0
    found = findings(other(signals=(signal,)))[0]
    assert (found.code, found.energy_j, found.places[0].start_m) == ("signal-passed", None, 3000.0)
    assert found.where(fast().drive.table.clock)[0].startswith("Km\u00a03.0, ")
    assert not list(signals_passed(at_danger().table.course, at_danger().signals))


def test_a_drive_that_is_not_comparable_says_so_with_its_reason() -> None:
    drive = not_compared().drive
    reason = drive.energy.not_comparable
    arrival, driven, above, over = page_figures(drive)
    assert (above.value, above.beside) == ("not comparable", reason)
    assert (arrival.value, driven.value, over.value) == ("not known", "not known", "0 s")
    html, told = first_in_html(not_compared), in_json(not_compared)
    assert f"The energy cannot be attributed: not comparable: {reason}." in html
    figures = told["first_page"]
    assert [figures[name] for name in ("arrived_late_s", "energy_kwh", "above_optimum_kwh")] == [None, None, None]
    assert (figures["findings"], told["not_comparable"]) == ([], reason)


def test_without_the_line_it_is_not_known_whether_limits_were_kept() -> None:
    found = other(limit_mps=np.full(len(fast().drive.table.course.time_ns), np.nan))
    assert page_figures(found)[3].value == "not known"
    assert first_page_dict(found)["over_limit_s"] is None
    assert "Whether it kept the line's limits is not known" in " ".join(how_sure(found))


def test_the_page_says_what_its_figures_hang_on() -> None:
    computed = " ".join(how_sure(bundled().drive))
    assert "The energy was not measured" in computed
    assert re.search(r"The train is assumed: .* t, .* m\.", computed)
    assert re.search(r"That range depends mostly on the \w+", computed)
    likely = page_figures(bundled().drive)[2].beside
    assert re.search(r"likely [\d.]+ to [\d.]+ kWh if the motors braked first, \d+ kWh if friction alone did", likely)
    measured = " ".join(how_sure(fast().drive))  # a simulator would record the true train's optimum as well
    assert "The energy is that of the simulated train. The train is assumed" in measured
    assert "The dependence of the energy above the optimum on that train is not known." in measured
    unknown = other(_any_attribution=DasError("no line"), _above=DasError("no line"), driven_j=None)
    assert not [one for one in how_sure(unknown) if "likely" in one or "train is" in one]


def test_the_picture_has_limit_drive_optimum_stops_and_the_places_of_the_findings() -> None:
    drive = fast().drive
    scene, found = ReviewScene.of(drive), findings(drive)
    figure = first_figure(scene, found)
    axis, below = figure.axes
    (bars,) = below.patches
    lost_kwh = float(np.nansum(bars.get_data().values * np.diff(bars.get_data().edges)))
    assert drive.energy.above is not None
    assert lost_kwh * 3.6e6 == pytest.approx(drive.energy.above.above_j, rel=1e-3)
    curves = {line.get_label(): line for line in axis.get_lines()}
    assert {"limit", "driven", "optimum for the same times"} <= curves.keys()
    assert float(np.nanmax(curves["driven"].get_ydata())) == pytest.approx(
        float(drive.table.course.speed_mps.max()) / KMH
    )
    written = [text.get_text() for text in axis.texts]
    assert {"A", "B"} <= set(written)
    places = [(number, place) for number, one in enumerate(found, start=1) for place in one.places]
    assert [text for text in written if text.isdecimal()] == [str(number) for number, _ in places]
    assert [patch.get_x() for patch in axis.patches] == pytest.approx([one.start_m / KM for _, one in places])


def numbers_as_texts(value: Any, name: str = "") -> list[str]:
    """The names of the texts under a value that stand for a number."""
    if isinstance(value, dict):
        return [one for key, item in value.items() for one in numbers_as_texts(item, key)]
    if isinstance(value, list):
        return [one for item in value for one in numbers_as_texts(item, name)]
    return [name] if isinstance(value, str) and NUMBER_AS_TEXT.fullmatch(value) else []


def train_ahead() -> ReviewedDrive:
    return recorded("references/train-ahead")


@pytest.mark.parametrize("subject", [bundled, pytest.param(train_ahead, marks=pytest.mark.nightly), not_compared])
def test_the_json_has_a_number_wherever_a_number_is_meant(subject: Subject) -> None:
    told = in_json(subject)
    # Times of day beside those in ns, versions, and reasons of an advice in words.
    allowed = {"time_utc", "simulator", "node", "recorder", "version", "reason"}
    assert set(numbers_as_texts(told)) <= allowed
    for stop in told["stops"]:
        assert {type(stop[key]) for key in stop if key.endswith(("_s", "_m"))} <= {float, int, type(None)}
        late = stop["arrived_late_s"]
        assert late is None or late == pytest.approx(stop["arrived_s"] - stop["due_arrival_s"])


def test_an_out_that_ends_in_pdf_is_printed(tmp_path: Path) -> None:
    done = das_sim("report", str(BUNDLED), "-o", "none/report.pdf", cwd=tmp_path)
    assert "no such folder" in done.stderr
    assert "ends in .html" not in done.stderr


A4_MM = 297
LONG = DriveFinding(
    code="overspeed", label="above the limit", text="Up to 3 km/h above the limit of 110 km/h for 3 s. " * 4,
    places=(FoundPlace(1000.0, 2000.0, 1, 2),) * 3,
)  # fmt: skip


LONG_NAME = "stated in the recording: above the optimum (estimated), compared part"
PART = "km 12.3 at 98 km/h to km 45.6 at 98 km/h"


@pytest.fixture(scope="module")
def crowded() -> str:
    """The page with findings and names as long as they get."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("sim.review.first_page.findings", lambda drive: (LONG,) * 3)
        patched.setattr("sim.review.tables.input_rows", lambda drive: [(LONG_NAME, PART)] * 20)
        picture = as_image(first_figure(ReviewScene.of(fast().drive), findings(fast().drive)))
        return page_of_words(fast(), first=picture)


def test_the_first_page_is_one_page_of_a4(tmp_path: Path, crowded: str) -> None:
    """Its style says so; where a browser is installed, the printed page says so too."""
    html = crowded
    (margin_mm,) = re.findall(r"@page { size: A4 portrait; margin: (\d+)mm; }", html)
    ((height_mm, rest),) = re.findall(r"\.first { height: (\d+)mm;([^}]*)}", html)
    assert 0 <= A4_MM - 2 * int(margin_mm) - int(height_mm) <= 5
    assert {"overflow: hidden", "break-after: page"} <= set(rest.strip().split("; "))
    if not any(map(shutil.which, BROWSERS)):
        return
    end = html.index('<section class="drive"')
    # With the picture at its least, nothing is cut off.
    whole = html[:end].replace("height: 267mm; overflow: hidden", "height: auto; overflow: visible")
    whole = whole.replace("flex: 0 1 auto; min-height: 42mm", "flex: none; height: 42mm")
    write_pdf(f"{whole}</body></html>", tmp_path / "first.pdf")
    assert len(re.findall(rb"/Type\s*/Page\b", (tmp_path / "first.pdf").read_bytes())) == 1
    write_pdf(f"{html[:end]}</body></html>", tmp_path / "first.pdf")
    content = (tmp_path / "first.pdf").read_bytes()
    assert len(re.findall(rb"/Type\s*/Page\b", content)) == 1
    (box,) = set(re.findall(rb"/MediaBox\s*\[0 0 ([\d.]+) ([\d.]+)\]", content))
    assert [float(one) for one in box] == pytest.approx([595.0, 842.0], abs=1.0)


def test_a_long_name_leaves_its_value_room_on_paper(tmp_path: Path, crowded: str) -> None:
    """Twenty values once took sixteen pages, one letter to a line. A browser, if there is one, prints them."""
    html = crowded
    begin = html.index("Sources<")
    assert ".pairs { table-layout: fixed; } .pairs th { width: 36%; }" in html
    assert '<table class="pairs">' in html[begin:]
    if not any(map(shutil.which, BROWSERS)):
        return
    write_pdf(f"{html[: html.index('<body')]}<body>{html[begin:]}", tmp_path / "last.pdf")
    assert len(re.findall(rb"/Type\s*/Page\b", (tmp_path / "last.pdf").read_bytes())) <= 2
