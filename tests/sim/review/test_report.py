"""A report is one page that holds everything itself; it says what the drive was, and why where it cannot."""

from __future__ import annotations

import base64
import json
import re
import shutil
from collections import defaultdict
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from markupsafe import escape

from das.bus.recording import Contents, Recording
from das.domain.errors import DasError
from das.domain.units import KM
from precompute.pdf import write_pdf
from sim.drive.attribution import OTHER_TRAIN
from sim.drive.causes import EnergyCause
from sim.drive.comparison import compared
from sim.drive.drive import Drive
from sim.drive.energy import DriveEnergy
from sim.drive.events import DriveEvent, EventKind
from sim.drive.notes import Note, add_note
from sim.drive.series import STYLES
from sim.drivers.cab import Driver
from sim.drivers.drivers import PerfectDriver
from sim.options import ReplayOptions
from sim.recording.check import check_contents, check_file
from sim.review import page as page_module
from sim.review import tables
from sim.review.first_page import in_lines, title, where_time_went
from sim.review.page import ReviewedDrive, as_dict, page, subject_of
from sim.review.pictures import SPEEDS, drive_figure
from sim.review.scene import ReviewScene
from sim.runs.replay import ReplayOutcome, prepare
from sim.runs.replay_figures import figure_rows, result, trip_energies
from sim.world.lockstep import Traffic
from tests.support.flat_days import flat_day, signal_at
from tests.support.making import das_sim, refusal
from tests.support.recorded_days import DrivesFaster, inputs_of_day, recorded_day
from tests.support.recordings import at_ns, write_recording

RECORDINGS = Path(__file__).parents[3] / "recordings"
BUNDLED = RECORDINGS / "zurich-zug-late.mcap"


@cache
def at_danger() -> Drive:
    """The drive of a day with a signal at danger on the way."""
    made = flat_day(signal_at(3000.0, 900.0))
    return Drive(recording=recorded_day(made, PerfectDriver(made.service.line)), given=inputs_of_day(made))


def subject(driver: Driver, name: str) -> ReviewedDrive:
    recording = replace(recorded_day(flat_day(), driver), path=Path(f"{name}.mcap"))
    checked = check_contents(Contents(path=recording.path), recording)
    return ReviewedDrive(Drive(recording=recording, given=inputs_of_day(flat_day())), checked)


@cache
def fast() -> ReviewedDrive:
    return subject(DrivesFaster(PerfectDriver(flat_day().service.line), 3.0), "fast")


@cache
def fast_page() -> str:
    return page([fast()], None, "")


def paragraph(drive: Drive) -> str:
    """The first page as the JSON has it."""
    return " ".join(in_lines(drive))


def page_of_words(one: ReviewedDrive, **pictures: str) -> str:
    """The page with these pictures alone: most of the time of a page goes into its three."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(page_module, "_images", lambda _drive: defaultdict(str, pictures))
        return page([one], None, "")


def other(recording: Recording | None = None, **known: object) -> Drive:
    """The fast drive with figures that are found already, or with something else in its recording."""
    found = Drive(recording=recording or fast().drive.recording, given=inputs_of_day(flat_day()))
    for name, value in {"_any_attribution": fast().drive.energy.any_attribution, **known}.items():
        vars(found.energy if hasattr(DriveEnergy, name) else found)[name] = value
    return found


STEPS = (EnergyCause.RECOVERED.label, EnergyCause.ARRIVAL.label, OTHER_TRAIN)
"""The steps from the optimum for the timetable to that for the same times."""


def in_kwh(text: str) -> float:
    """The number at the beginning of a printed energy."""
    return float(text.split(maxsplit=1)[0].strip("*"))


def assert_they_sum(parts: list[str], whole: str) -> None:
    """Printed energies sum to another, but for the rounding of each to 0.1 kWh."""
    rounding_kwh = 0.05 * (len(parts) + 1) + 1e-9
    assert sum(map(in_kwh, parts)) == pytest.approx(in_kwh(whole), abs=rounding_kwh)


@pytest.mark.nightly
def test_the_parts_that_a_report_prints_sum_to_the_energy_that_it_prints() -> None:
    """Of every reference that holds a drive from stop to stop, and of the bundled replay."""
    drives = [Drive.read(path) for path in (*sorted(RECORDINGS.glob("references/*.mcap")), BUNDLED)]
    known = [drive for drive in drives if drive.energy.attribution is not None]
    assert len(known) >= 8
    for drive in known:
        assert drive.energy.attribution is not None
        figures = dict(tables.figures(drive))
        driven, optimum, above = (
            figures[name].removesuffix(" (estimated)")
            for name in ("energy as driven", "optimum for the same times", "above that optimum")
        )
        assert_they_sum([optimum, above], driven)
        assert_they_sum([row["kwh"] for row in tables.cause_rows(drive.energy.attribution)], above)
        steps = [figures[name] for name in STEPS if name in figures]
        assert_they_sum([figures["optimum for the timetable"], *steps], optimum)


def test_the_paragraph_has_times_energy_and_what_it_went_for() -> None:
    text = paragraph(fast().drive)
    attribution = fast().drive.energy.attribution
    assert attribution is not None
    assert "ran the 6.0 km from" in text
    assert f"Energy driven: {attribution.above.driven_j / 3.6e6:.1f} kWh (at the current collector" in text
    assert "1. Against the advice, " in text
    assert "Time above the limit: 0 s" in text


def test_a_drive_that_is_not_comparable_is_told_without_a_share_of_anything() -> None:
    """A share of an optimum that is none is nonsense: −339 % and 540 % were told of one real trip."""
    early = DasError("fast.mcap: not comparable: this train cannot arrive as early")
    found = other(_any_attribution=early, _above=early, driven_j=None)
    text = paragraph(found)
    assert "Energy above the optimum: not comparable (this train cannot arrive as early)." in text
    assert "The energy cannot be attributed: not comparable: this train cannot arrive as early." in text
    assert "%" not in text
    (row,) = as_dict([ReviewedDrive(found, fast().checked)], None, "")["drives"]
    assert (row["energy"], row["above_optimum_likely_low_kwh"]) == (None, None)


def test_the_paragraph_tells_a_train_that_is_too_fast_for_its_file_from_one_above_the_limit() -> None:
    over = DriveEvent(
        time_ns=0,
        kind=EventKind.BEYOND_TRAIN,
        text="",
        s_m=0.0,
        facts={"over_kmh": 24.3, "lasted_s": 328.0, "times": 11},
    )
    text = paragraph(other(events=(over,)))
    assert "The trip was up to 24 km/h faster than the assumed train can go. Is it the right train?" in text
    assert "Time above the limit: 0 s" in text


def told_of(**run: str) -> str:
    """The paragraph of a drive whose recording says this about how it was made."""
    return paragraph(other(replace(fast().drive.recording, metadata={"run": run})))


def test_the_paragraph_says_how_the_drive_came_about() -> None:
    """A reader who was not there must not take a simulated day, a replay or a what-if for a real one."""
    text = told_of(kind="run", scenario="flat", seed="3", driver="human", advice="guide", happens="a signal at danger")
    assert (
        "The run was simulated (scenario flat, seed 3): a simulated human drove and was shown the guide in the cab"
        in text
    )
    assert "Disturbances: a signal at danger." in text
    assert "It is a replay of trip.csv: the driver did not see the advice." in told_of(kind="replay", trip="trip.csv")
    text = told_of(what_if="open loop", what_if_of="day.mcap", what_if_changed="loss level l1")
    assert "It is a what-if of day.mcap, open loop; otherwise: loss level l1." in text


def test_the_page_answers_what_a_reviewer_asks() -> None:
    """Questions that a page could not answer when somebody read it who was not there."""
    figures, text = dict(tables.figures(fast().drive)), paragraph(fast().drive)
    assert figures["temporary restrictions received"] == "none (an empty list was received)"
    assert figures["advice withdrawn"] == "never"
    above = re.fullmatch(r"\+([\d.]+) kWh \(([\d.]+) % of the optimum\)", figures["above that optimum"])
    assert above is not None  # the share is that of the optimum, as everywhere
    driven_kwh, optimum_kwh = (in_kwh(figures[name]) for name in ("energy as driven", "optimum for the same times"))
    assert float(above[2]) == pytest.approx(100.0 * float(above[1]) / optimum_kwh, abs=0.7)
    assert float(above[1]) == pytest.approx(driven_kwh - optimum_kwh, abs=0.15)
    rests = dict(tables.input_rows(fast().drive))
    assert rests["energies"] == "simulated"
    assert "t, train length" in rests["planned mass"]
    ran = re.search(r"in (\d+) min (\d+) s\. It left at (\S+).* arrived at (\S+) ", text)
    assert ran is not None
    left, arrived = (
        sum(int(x) * n for x, n in zip(one.split(":"), (3600, 60, 1), strict=True)) for one in ran.groups()[2:]
    )
    assert abs(arrived - left - (60 * int(ran[1]) + int(ran[2]))) <= 1  # each time of day is rounded to a second
    assert title(fast().drive) == "train, A – B, 21 November 2026 (fast)"


def test_the_page_and_its_json_have_every_figure_of_a_drive() -> None:
    drive = fast().drive
    shown, told = dict(tables.figures(drive)), as_dict([fast()], None, "")["drives"][0]["figures"]
    rows = drive.figures.rows()
    assert len(rows) > 2
    assert {label.strip(): words for label, words in rows}.items() <= shown.items()
    assert told == drive.figures.as_dict()
    assert drive.figures.stability.shown_s > 0
    assert (told["reversals"], told["advice_changes_per_min"]) == (
        drive.figures.stability.reversals, pytest.approx(drive.figures.stability.changes_per_min),
    )  # fmt: skip


def test_the_page_says_where_time_was_lost_and_by_what() -> None:
    found = at_danger()
    (told,) = where_time_went(found)
    assert re.match(r"From A to B it lost \d+ s against the timetable; on the way: a signal at danger, in sight", told)
    assert "The advice knew of no signal at danger" in paragraph(found)


def test_attention_that_was_away_is_listed_and_is_no_answer() -> None:
    """A simulated driver's lapses are events of the driver like his answers, and used to end the command."""
    away = DriveEvent(
        time_ns=fast().drive.table.clock.zero_ns, kind=EventKind.DRIVER, text="inattention for 12 s", s_m=0.0,
        facts={"away_s": 12.0},
    )  # fmt: skip
    found = other(events=(*fast().drive.events, away))
    assert tables.figures(found) == tables.figures(fast().drive)
    assert away.text in [row["text"] for row in tables.event_rows(found)]


def test_a_bookmark_says_what_was_driven_and_shown() -> None:
    found = at_danger()
    signal, stand = (
        next(row for row in tables.bookmark_rows(found) if row["mark"] == mark)
        for mark in ("signal at danger", "unplanned stop")
    )
    assert re.fullmatch(r"\d+ km/h", signal["driven"])
    assert re.fullmatch(r"[a-z ]+, \d+ km/h", signal["shown"])
    assert stand["driven"] in ("0 km/h", "1 km/h")  # between the last sample that moves and the first that stands
    advised = [row for row in tables.advice_rows(found) if row["kind"] == "advice"]
    assert len(advised) == sum(one.kind is EventKind.ADVICE for one in found.events) > 0
    assert not [row for row in tables.event_rows(found) if row["kind"] == "advice"]


def test_the_page_names_the_command_that_shows_the_drive_as_its_driver_saw_it() -> None:
    assert "<code>das-sim desk fast.mcap</code>" in fast_page()
    messages = {name: said for name, said in fast().drive.recording.messages.items() if name != "cab"}
    without = other(replace(fast().drive.recording, messages=messages))
    assert "das-sim desk" not in page_of_words(fast()._replace(drive=without))


def test_the_page_needs_nothing_besides_itself() -> None:
    html = fast_page()
    assert not re.findall(r"""(?:src|href)=["'](?!data:|#)""", html)
    assert not re.findall(r"url\(|@import|<script|http://|https://", html)
    assert html.count("<figure>") == 3
    drawings = [base64.b64decode(one) for one in re.findall(r"image/svg\+xml;base64,([^\"]+)", html)]
    assert len(drawings) >= 3
    heights_pt = [float(one) for drawing in drawings for one in re.findall(rb'<svg [^>]*height="([\d.]+)pt', drawing)]
    assert len(heights_pt) == len(drawings)
    assert max(heights_pt) < 842, "each fits on a sheet A4"
    parts = ("Punctuality", "Where the energy went", "Bookmarks and notes", "Events", "Health", "Sources")
    for part in parts:
        assert part in html


def test_the_report_draws_the_curves_of_the_scene() -> None:
    scene = ReviewScene.of(fast().drive)
    traces = {STYLES[one.name].label: one for one in scene.over_distance(SPEEDS)}
    drawn = {line.get_label(): line for line in drive_figure(scene).axes[0].get_lines()}
    assert {"limit", "driven", "optimum for the same times", "shown to the driver"} <= traces.keys() <= drawn.keys()
    for label, trace in traces.items():
        x, y = drawn[label].get_data()
        np.testing.assert_array_equal((x, y), (trace.s_m / KM, trace.values))


def test_what_people_wrote_cannot_become_markup_and_without_line_there_is_no_energy(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "drive.mcap", seconds=120)
    add_note(path, Note(at_ns(20), "<script>alert(1)</script>"))
    found = subject_of(path)
    html = page_of_words(found)
    assert "<script>" not in html
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in html
    assert found.drive.energy.attribution is None
    assert "The energy cannot be attributed: its route" in html


def test_a_recording_that_was_cut_off_is_said_to_be_with_the_health_that_the_check_finds(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "drive.mcap", seconds=120)
    content = path.read_bytes()
    path.write_bytes(content[: 2 * len(content) // 3])
    reviewed, found = subject_of(path), check_file(path)
    html = page_of_words(reviewed)
    assert "The recording was cut off" in paragraph(reviewed.drive)
    assert as_dict([reviewed], None, "")["drives"][0]["health"] == found.as_dict()
    assert any("cut-off" in line for line in found.lines())
    for text in (*found.lines(), *found.figures.values(), *(row[0] for row in found.rate_rows())):
        assert str(escape(text)) in html


def test_drives_of_other_lines_are_not_compared_and_it_is_said(tmp_path: Path) -> None:
    paths = [write_recording(tmp_path / f"{name}.mcap", seconds=120) for name in "ab"]
    subjects = [subject_of(path) for path in paths]
    aligned, why_not = compared([one.drive for one in subjects])
    assert aligned is None
    assert "The drives are not compared" in page(subjects, aligned, why_not)
    assert as_dict(subjects, aligned, why_not)["not_compared"] == why_not


@pytest.mark.nightly
def test_the_command_reports_on_a_trip_that_was_recorded_by_positions_alone(tmp_path: Path) -> None:
    done = das_sim("report", str(BUNDLED), "-o", "report.html", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (drive,) = json.loads(done.stdout)["drives"]
    energy = drive["energy"]
    assert energy["measured"] is False
    low, high = drive["above_optimum_likely_low_kwh"], drive["above_optimum_likely_high_kwh"]
    assert low < energy["above_optimum_kwh"] < high
    assert (tmp_path / "report.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    # One drive has one time and one energy: in the title of a picture, in the table of a replay, and in the report.
    job = prepare(BUNDLED, ReplayOptions(), tmp_path / "out.mcap", "test")
    table = dict(figure_rows(result(job, ReplayOutcome(traffic=Traffic(), replay_s=1.0), trip_energies(job))))
    trip_s, (leg,) = float(table["trip time"].removesuffix(" s")), energy["legs"]
    assert leg["trip_s"] == pytest.approx(trip_s, abs=0.5)
    assert f" in {trip_s // 60:.0f} min {trip_s % 60:.0f} s." in drive["in_words"]
    driven = table["energy as driven (estimated)"]
    by_place_kwh = sum(one["energy_kwh"] for one in leg["per_100_m"])
    assert driven == f"{energy['energy_kwh']:.1f} kWh" == f"{by_place_kwh:.1f} kWh"
    assert f"Energy driven: {driven} (at the current collector" in drive["in_words"]


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("-o", "report.txt"), "ends in .html"),
        (("--pdf", "report.html"), "ends in .pdf"),
        (("-o", "none/report.html"), "no such folder"),
    ],
)
def test_outputs_that_cannot_be_are_refused_before_the_work(
    tmp_path: Path, args: tuple[str, ...], message: str
) -> None:
    assert message in refusal("report", str(BUNDLED), *args, cwd=tmp_path)


def test_without_a_browser_there_is_no_pdf(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(DasError, match="none is installed"):
        write_pdf("<p>page</p>", tmp_path / "page.pdf")
