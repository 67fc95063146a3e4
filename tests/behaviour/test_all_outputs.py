"""One recording, one number: a quantity has the same value in every table, page, sentence, JSON and export.

The bundled recording, and a trip of a file with a stand on the way as a replay records it. Each output is made once.
"""

from __future__ import annotations

import csv
import html
import json
import math
import re
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
import pytest
from numpy.typing import NDArray

from das.bus import codec
from das.bus.codec import Outgoing
from das.bus.recorder import RecordingFile
from das.bus.topics import SAVING, message_time_ns
from das.domain.units import KM, KMH, kwh
from sim.cli.trips import bundled_recording
from sim.drive.comparison import AlignedDrives, drives_on_track
from sim.drive.comparison import as_dict as comparison_dict
from sim.drive.drive import Drive
from sim.options import ReplayOptions, TripOptions
from sim.recording.check import check_contents
from sim.recording.course import minutes, spell
from sim.recording.opening import open_contents
from sim.review import page as page_module
from sim.review.page import ReviewedDrive, page
from sim.review.page import as_dict as report_dict
from sim.review.tables import leg_rows
from sim.runs.replay import ReplayJob, ReplayOutcome, _feed, _journey, prepare
from sim.runs.replay_figures import TripEnergies, figure_rows, result, trip_energies
from sim.world.lockstep import Traffic
from tests.support.dirt import clean, write
from tests.support.making import das_sim
from tests.support.sparse import sparse_cuts

Outputs = Mapping[str, str]
NUMBER: Final = r"([−+-]?\d+(?:\.\d+)?)"
LENGTH_M, MIDDLE_M = 4000.0, 1700.0
ROUTE: Final = """
schema_version = 1
route = {id = "with-a-stand", name = "With a stand", length_km = 4.0, altitudes = "level"}
stops = [{name = "A", position_km = 0.0}, {name = "M", position_km = 1.7}, {name = "B", position_km = 4.0}]
speed_limits = {columns = ["position_km", "limit_kmh"], rows = [[0.0, 140.0]]}
gradients = {columns = ["position_km", "gradient_permille"], rows = [[0.0, 0.0]]}
"""


def told(pattern: str, text: str) -> list[str]:
    """All that an output says of a quantity (# in a pattern), each number in the way that it is written."""
    found = re.finditer(pattern.replace("#", NUMBER), text)
    return [said.replace("−", "-").lstrip("+") for one in found for said in one.groups() if said is not None]


def check_one_number(outputs: Outputs, value: float, **patterns: str) -> None:
    """Each output says the value, to the precision in which it writes it, every time that it says it."""
    for name, pattern in patterns.items():
        found = told(pattern, outputs[name])
        assert found, f"{name} does not say {pattern}"
        for text in found:
            digits = len(text.partition(".")[2])
            assert abs(float(text) - value) <= 0.5001 * 10.0**-digits, f"{name}: {text}, elsewhere {value}"


def text_of(written: str) -> str:
    """A page as its reader sees it."""
    return " ".join(html.unescape(re.sub(r"<(style|script).*?</\1>|<[^>]*>", " ", written, flags=re.DOTALL)).split())


def outputs_of(recording: Path, drive: Drive, folder: Path) -> Iterator[tuple[str, str]]:
    """Every output that is made of a recording alone, by its name."""
    subject = ReviewedDrive(drive, check_contents(open_contents(recording), drive.recording))
    yield "page", text_of(page([subject], None, ""))
    (told,) = report_dict([subject], None, "")["drives"]
    yield "report_json", json.dumps(told)
    yield "energy_json", json.dumps(told["energy"])
    aligned = AlignedDrives.of(drives_on_track([drive, drive]))
    yield "compare_json", json.dumps(comparison_dict(aligned))
    assert das_sim("export", str(recording), "-o", "tables", "--format", "csv", cwd=folder).returncode == 0
    for name, args in {
        "energy": ("report", "--show", "energy"),
        "events": ("report", "--show", "events"),
        "trip": ("trip",),
        "trip_json": ("trip", "--json"),
    }.items():
        done = das_sim(args[0], str(recording), *args[1:], cwd=folder)
        assert done.returncode == 0, done.stderr
        yield name, done.stdout
    yield "facts", " ".join(f"{name}: {value}" for name, value in drive.facts().items())
    yield "legs", json.dumps(leg_rows(drive.energy.known_attribution))


@pytest.fixture(scope="module")
def shared_drives() -> Iterator[None]:
    """Each recording is solved once: all commands ask the same drive, as they would read the same file."""
    with pytest.MonkeyPatch.context() as patched, sparse_cuts():
        patched.setattr(Drive, "read", cache(Drive.read))
        patched.setattr(page_module, "_images", lambda _drive: dict.fromkeys(IMAGES, ""))
        patched.setenv("COLUMNS", "200")
        yield


IMAGES: Final = ("first", "speed", "places")


def check_all(outputs: Outputs, drive: Drive, folder: Path) -> None:
    """The quantities of every drive: its energy and optimum, time, distance, speed, and time above the limit."""
    above, likely, went = drive.energy.known_attribution.above, drive.energy.likely, drive.travelled
    assert drive.energy.driven_j is not None
    assert likely is not None
    said = {name: json.loads(outputs[f"{name}_json"]) for name in ("energy", "trip", "compare", "report")}
    page_figures, compared = said["report"]["first_page"], said["compare"]["drives"][0]
    of_json = (page_figures, compared, said["energy"], said["trip"]["energy"], said["report"]["energy"])
    one_value(kwh(drive.energy.driven_j), *(one["energy_kwh"] for one in of_json))
    check_one_number(
        outputs, kwh(drive.energy.driven_j), page=r"Energy driven # kWh|energy as driven # kWh",
        energy=r"as driven.*│ *#│\n", trip=r"net input +│ +#",
    )  # fmt: skip
    check_one_number(
        outputs, kwh(above.optimum_j), page=r"optimum for the same times # kWh",
        energy=r"optimum for the same times.*│ *#│\n",
    )  # fmt: skip
    one_value(
        kwh(above.difference_j), page_figures["above_optimum_kwh"], said["energy"]["above_optimum_kwh"],
        compared["above_optimum_kwh"], math.fsum(kwh(one) for one in drive.energy.known_attribution.by_cause.values()),
    )  # fmt: skip
    check_one_number(
        outputs, kwh(above.difference_j),
        page=r"Energy above the optimum #|above that optimum # kWh",
    )  # fmt: skip
    friction = r"# kWh if friction alone|friction alone [+]\d+[.]\d to # kWh"
    check_one_number(outputs, kwh(likely.by_friction_j), page=friction)
    check_one_number(outputs, kwh(likely.low_j), page=r"likely # to")
    check_one_number(outputs, kwh(likely.high_j), page=r"likely [-+.\d]+ to # kWh")
    one_value(went.time_s, said["trip"]["trip_time_s"], compared["time_s"], tolerance=0.5)
    check_one_number(outputs, went.time_s, trip=r"time, distance +│ *# s", facts=r"time: # s")
    assert f"km from {drive.served[0].name} to {drive.served[-1].name} in {spell(went.time_s)}." in outputs["page"]
    check_one_number(
        outputs, went.way_m / KM, trip=r"s, # km", facts=r"distance: # km", page=r"ran the # km|covers # km"
    )
    top_mps = drive.energy.motion.speed_mps.max()
    check_one_number(outputs, top_mps / KMH, trip=r"highest speed +│ *# km/h")
    one_value(top_mps / KMH, drive.plotted().speed_mps.max() / KMH, said["trip"]["max_speed_kmh"], tolerance=0.5)
    over = drive.violations
    assert over.over_limit_s == page_figures["over_limit_s"]
    check_one_number(outputs, over.over_limit_s, page=r"Time above the limit # s")
    exported = read_table(folder / "tables" / "by_time.csv")
    base = "truth" if "truth_s_m" in exported else "position"
    first_s, last_s = (drive.table.clock.since_s(at_ns) for at_ns in (went.start_ns, went.end_ns))
    moving = (exported["time_s"] >= first_s - 1.0) & (exported["time_s"] <= last_s + 1.0)
    way_m = exported[f"{base}_s_m"][moving]
    assert way_m[-1] - way_m[0] == pytest.approx(went.way_m, abs=5.0)  # where it stood, not where the stops are
    assert exported[f"{base}_speed_mps"].max() == pytest.approx(drive.table.course.speed_mps.max())


def one_value(value: float, *others: float, tolerance: float = 1e-6) -> None:
    """Figures of one name in several JSONs and in the library."""
    assert others == pytest.approx((value,) * len(others), abs=tolerance)


def read_table(path: Path) -> dict[str, NDArray[np.float64]]:
    """The columns of numbers of an exported table; empty cells are NaN."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    numbers = [name for name in rows[0] if all(re.fullmatch(r"-?[\d.e+-]*", row[name]) for row in rows)]
    return {name: np.array([float(row[name] or "nan") for row in rows]) for name in numbers}


@pytest.mark.slow
@pytest.mark.usefixtures("shared_drives")
def test_the_bundled_recording_has_one_number_for_each_quantity(tmp_path: Path) -> None:
    recording = bundled_recording()
    drive = Drive.read(recording)
    outputs = dict(outputs_of(recording, drive, tmp_path))
    check_all(outputs, drive, tmp_path)
    assert drive.late_s < 0.0
    early = drive.late_s * -1.0
    check_one_number(
        outputs, early, page=r"arrived at [\d:]+ \(# s early|timetable # s early", events=r"arrived at Zug, # s early"
    )


@pytest.mark.usefixtures("shared_drives")
def test_a_trip_with_a_stand_on_the_way_has_one_number_for_each_quantity(tmp_path: Path) -> None:
    """In what is said of its file, of its replay, and of the recording of its replay."""
    first = clean(MIDDLE_M, stood_s=20)
    record = write(tmp_path, first + clean(LENGTH_M - MIDDLE_M, MIDDLE_M, first[-1].t + 1, stood_s=20), on_route=True)
    (tmp_path / "route.toml").write_text(ROUTE, encoding="utf-8")
    where = ("--route", "route.toml", "--vehicle", "re460-ic")
    looked_at = json.loads(das_sim("trip", record.name, *where, "--json", cwd=tmp_path).stdout)
    options = ReplayOptions(trip=TripOptions(route=str(tmp_path / "route.toml"), vehicle="re460-ic"))
    job = prepare(record, options, tmp_path / "replay.mcap", "das-sim replay trip.csv")
    energies = trip_energies(job)
    replayed = result(job, ReplayOutcome(traffic=Traffic(), replay_s=1.0), energies)
    drive = Drive.read(written(job, energies, tmp_path / "replay.mcap"))
    outputs = dict(outputs_of(tmp_path / "replay.mcap", drive, tmp_path))
    outputs["replay"] = "\n".join(f"{name}: {value}" for name, value in figure_rows(replayed))
    check_all(outputs, drive, tmp_path)
    likely = drive.energy.likely
    assert likely is not None
    for told in (looked_at["energy"], replayed):
        one_value(kwh(drive.energy.driven_j or 0.0), told["energy_kwh"])
    for told in (looked_at, replayed):
        one_value(drive.travelled.time_s, told["trip_time_s"], tolerance=1e-3)
    middle = looked_at["stands"][1:]
    legs = [leg.trip_s for leg in drive.energy.legs]
    assert [one["running_time_s"] for one in middle] == pytest.approx(legs, abs=1e-3)
    assert [one["trip_s"] for one in replayed["sections"]] == pytest.approx(legs, abs=1e-3)
    assert [minutes(leg) for leg in legs] == [row["time"] for row in json.loads(outputs["legs"])]
    friction = next(one for one in replayed["above_optimum_unknowns"] if one["name"] == "braking")
    one_value(kwh(likely.by_friction_j), friction["high_kwh"])
    one_value(kwh(likely.low_j), replayed["above_optimum_likely_low_kwh"])
    check_one_number(outputs, drive.travelled.time_s, replay=r"trip time: # s")
    check_one_number(outputs, kwh(drive.energy.driven_j or 0.0), replay=r"energy as driven \(estimated\): # kWh")


def written(job: ReplayJob, energies: TripEnergies, path: Path) -> Path:
    """What a replay records of the drive, without what its node says."""
    file = RecordingFile(path)
    for attached in job.processes.attachments:
        file.add_attachment(attached.name, "", attached.read_bytes())
    file.add_metadata("run", dict(job.processes.metadata))
    saving = Outgoing(SAVING, energies.above.message(job.timing.last_tick_ns))
    for one in (codec.encode_input(_journey(job)), *(sent for _, sent in _feed(job)), saving):
        file.add(one.topic, one.topic.key(job.processes.train), one.message, message_time_ns(one.message))
    file.close()
    return path
