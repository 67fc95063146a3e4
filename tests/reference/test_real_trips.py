"""Real GPS records of a train between Kolbäck and Västerås: matched, shown, dirtied, replayed and viewed.

The records are a third party's (../shared/data/trips, from the STREAM3 project): they show what no made-up record does.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.bus.recording import read_recording
from das.bus.topics import POSITION
from das.domain.files.load import load_route
from das.domain.units import KMH
from sim.trips.cleaning import FindingKind
from sim.trips.line import read_kilometre_posts
from sim.trips.matching import MatchedTrip
from sim.trips.profile import to_profile
from sim.trips.record import Record, read_trip
from tests.support.benchmark import shared_data, track_path, train_path
from tests.support.made_line import counts, matched
from tests.support.making import das_sim, das_sim_json, in_a_process
from tests.support.portals import FORMS, Fix, write
from tests.support.tracks import as_gpx

TRIPS = shared_data() / "trips"
POSTS = TRIPS / "kolback_vasteras_kmposts.csv"


def kolback(name: str) -> list[str]:
    """A real trip and the options of a command that reads it."""
    return [
        str(TRIPS / f"kolback_vasteras_{name}.csv"),
        *("--route", str(track_path("SE_Vasteras_Kolback"))),
        *("--vehicle", str(train_path("CH_Stadler_KISS_SBB"))),
        *("--reverse", "--posts", str(POSTS)),
    ]


def on_the_line(record: Record) -> MatchedTrip:
    on = load_route(str(track_path("SE_Vasteras_Kolback"))).reversed()
    return matched(record, read_kilometre_posts(POSTS), on)


@cache
def real(name: str) -> MatchedTrip:
    return on_the_line(read_trip(TRIPS / f"kolback_vasteras_{name}.csv").record)


@pytest.mark.parametrize(("name", "duration_s", "lag_s"), [("clean", 551, 2.5), ("dropouts", 559, 0.75)])
def test_a_real_trip_fits_the_line_and_its_run_is_plausible(name: str, duration_s: float, lag_s: float) -> None:
    """By the posts the stations are 19 279 m apart, on the track 19 305 m: a scale of 1.0013 within GPS accuracy.

    The clean record stands after 553 s by a speed that comes 2.5 s late.
    """
    result = real(name)
    assert result.report.anchor == "start and end"
    assert result.report.scale == pytest.approx(19305 / 19279, abs=0.0012)
    assert result.report.offset_m == pytest.approx(133, abs=15)  # Kolbäck lies 133 m before the post km 130
    assert result.report.median_cross_track_m < 15
    assert result.report.max_cross_track_m < 100
    assert (result.s_m[0], result.s_m[-1]) == pytest.approx((0, 19305.4))
    run = to_profile(result)
    assert run.time_s[-1] == duration_s
    assert run.speed_lag_s == pytest.approx(lag_s, abs=0.3)
    assert np.percentile(np.abs(run.acceleration_mps2), 99) < 1.0
    assert np.abs(run.acceleration_mps2).max() < 1.5
    assert run.speed_mps.min() == 0
    assert 160 * KMH < run.speed_mps.max() < 167 * KMH
    assert np.sum(run.speed_mps) == pytest.approx(19305.4, abs=1.0)
    assert run.s_m[-1] == pytest.approx(19305.4, abs=1e-6)
    assert run.position_rms_m < 10


def test_the_dropouts_of_the_real_trip_are_found() -> None:
    """Exactly the lines in which the recorded speed drops to nearly 0 while the train accelerates."""
    assert counts(real("clean")) == {FindingKind.GAP: 1}
    result = real("dropouts")
    assert (np.flatnonzero(result.dropout) + 1).tolist() == [42, 43, 44, 59, 62, 63]
    run = to_profile(result)
    around = slice(35, 75)  # accelerating all the time: no spike either way
    assert run.acceleration_mps2[around].min() > 0
    assert run.acceleration_mps2[around].max() < 1.0


@pytest.mark.parametrize("name", ["clean", "dropouts"])
@pytest.mark.parametrize("form", FORMS)
def test_a_real_trip_as_a_wifi_portal_would_have_stated_it_is_the_same_trip(
    tmp_path: Path, form: str, name: str
) -> None:
    """Within the rounding of the portal: speeds to 0.1 km/h, and times to a whole second for some."""
    rows = [row.split(",") for row in (TRIPS / f"kolback_vasteras_{name}.csv").read_text().split()]
    fixes = [Fix(int(t) * 10**6, float(lat), float(lon), float(v) * KMH) for lat, lon, v, t in rows]
    stated, known = on_the_line(read_trip(write(tmp_path / "trip.jsonl", fixes, form)).record), real(name)
    run, whole = to_profile(stated), to_profile(known)
    assert run.time_s[-1] == pytest.approx(whole.time_s[-1], abs=1)
    assert run.speed_lag_s == pytest.approx(whole.speed_lag_s, abs=0.25)
    at_s = whole.time_s + (whole.start_time_ns - run.start_time_ns) * 1e-9
    off_mps = np.abs(np.interp(at_s, run.time_s, run.speed_mps) - whole.speed_mps)
    assert off_mps.max() < 1.2, "a departure may be a second off"
    assert off_mps.mean() < 0.1
    assert np.interp(at_s, run.time_s, run.s_m) == pytest.approx(whole.s_m, abs=23), "half a second at 46 m/s"


def test_a_real_trip_without_its_speeds_is_the_same_trip() -> None:
    """It begins and ends with one point at a stand, which no slope of positions shows."""
    whole = read_trip(TRIPS / "kolback_vasteras_clean.csv").record
    bare = on_the_line(replace(whole, speed_mps=np.full(len(whole), np.nan)))
    known = real("clean")
    assert bare.report.anchor == "start and end"
    assert 0 < bare.report.stand_uncertainty_m < 5
    assert bare.s_m == pytest.approx(known.s_m, abs=0.5)
    run, with_speeds = to_profile(bare), to_profile(known)
    assert run.time_s[-1] == pytest.approx(with_speeds.time_s[-1], abs=3)  # the speeds' lag is 2.5 s
    off_mps = np.interp(with_speeds.time_s, run.time_s, run.speed_mps) - with_speeds.speed_mps
    assert np.sqrt(np.mean(off_mps**2)) < 1.0


@pytest.mark.nightly
def test_the_command_shows_and_writes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The report of a real record, its cleaned file read again without findings, and the energy as driven."""
    monkeypatch.setenv("COLUMNS", "140")  # No phrase is broken over lines.
    files = ("--out", "cleaned.csv")
    done = in_a_process("sim.cli", "trip", *kolback("dropouts"), *files, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    told = ("589 of 603 points kept", "speed dropout", "long stand at the end", "median / 95 % / most", "not known")
    assert [one for one in (*told, "running resistance") if one not in done.stdout] == []
    assert "speed gained" not in done.stdout  # it rounds to 0
    again = das_sim("trip", "cleaned.csv", *kolback("dropouts")[1:-2], "--json", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    found = json.loads(again.stdout)
    assert found["cleaning"]["findings"] == []
    assert found["whole_section"]
    assert found["trip_time_s"] == pytest.approx(557.995)  # by the stamps of the points; the even run has 559 s
    energy = found["energy"]
    assert energy["energy_low_kwh"] < energy["energy_kwh"] < energy["energy_high_kwh"]
    assert energy["energy_kwh"] == pytest.approx(217.7, rel=0.02)
    assert 180 < energy["strongest_braking_kn"] < 260  # the last two seconds of the stop alone ask 383


def dirtied(rows: list[list[str]]) -> Iterator[list[str]]:
    """A real record with points given twice, times back, jumps, and a hole of 14 s."""
    for i, (latitude, longitude, speed, ms) in enumerate(rows):
        if 300 <= i < 313:
            continue
        moved = float(latitude) + (0.02 if i in (100, 101, 250) else 0.0)
        yield [f"{moved!r}", longitude, speed, f"{float(ms) - 3.3e3 * (i == 200)}"]
        if i in (50, 51):
            yield [latitude, longitude, speed, ms]


@pytest.mark.nightly
def test_a_dirty_track_becomes_a_reviewed_recording(tmp_path: Path) -> None:
    """The real record with planted defects, turned into GPX without speeds: replay, then view."""
    rows = [line.split(",") for line in Path(kolback("dropouts")[0]).read_text().split()]
    (tmp_path / "dirty.gpx").write_text(as_gpx(list(dirtied(rows))))
    options = kolback("dropouts")[1:]
    found = das_sim_json("replay", "dirty.gpx", *options, "--out", "run.mcap", cwd=tmp_path)
    counts = {f["kind"]: f["count"] for f in found["cleaning"]["findings"]}
    planted = {"duplicate_time": 2, "time_back": 1, "position_jump": 3, "gap": 1}
    assert {kind: counts[kind] for kind in planted} == planted
    assert counts["speed_missing"] > 500
    assert found["messages_lost"] == found["advices_above_limit"] == 0
    assert found["whole_section"]
    assert found["trip_time_s"] == pytest.approx(559, abs=4)
    assert found["energy_low_kwh"] < found["energy_kwh"] < found["energy_high_kwh"]
    assert found["energy_kwh"] == pytest.approx(217.7, rel=0.05)
    recording = read_recording(tmp_path / "run.mcap")
    assert recording.metadata["run"]["cleaning"] == found["cleaning_summary"]
    assert "3 × position jump (dropped)" in found["cleaning_summary"]
    viewed = das_sim("view", "run.mcap", "--save", "run.rrd", cwd=tmp_path)
    assert viewed.returncode == 0, viewed.stderr


@pytest.fixture(scope="module")
def real_runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[dict[str, Any], Path]]:
    """The two real trips replayed: what `--json` printed, and the folder with run.mcap."""
    runs = {}
    for name in ("clean", "dropouts"):
        folder = tmp_path_factory.mktemp(name)
        runs[name] = das_sim_json("replay", *kolback(name), "--out", "run.mcap", cwd=folder), folder
    return runs


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["clean", "dropouts"])
def test_real_trips_replay_without_loss(real_runs: dict[str, tuple[dict[str, Any], Path]], name: str) -> None:
    """The whole chain on a real record: nothing lost, no advice above a limit, a plausible energy above the optimum."""
    found, folder = real_runs[name]
    assert found["messages_lost"] == 0
    assert found["advices_above_limit"] == 0
    assert found["advices"] > 500
    assert found["advices_withdrawn"] < 10
    assert 540 < found["trip_time_s"] < 570
    assert 0.05 < found["above_optimum_ratio"] < 0.4
    assert found["optimum_time_s"] == pytest.approx(found["trip_time_s"], abs=0.1)
    assert found["map_scale"] == pytest.approx(1.0, abs=0.003)
    positions = [m.message for m in read_recording(folder / "run.mcap").of(POSITION)]
    assert len(positions) == (346 if name == "clean" else 589)  # of a stand at the end 30 s are kept
    assert sum(p.quality == 2 for p in positions) == found["gps_dropout_points"]
    viewed = in_a_process("sim.cli", "view", "run.mcap", "--save", "run.rrd", cwd=folder)
    assert viewed.returncode == 0, viewed.stderr
    assert (folder / "run.rrd").stat().st_size > 100_000


@pytest.mark.nightly
def test_quality_of_positions_survives_a_replay_of_a_replay(
    real_runs: dict[str, tuple[dict[str, Any], Path]],
) -> None:
    """A recording of a replay is a trip again, with the same quality of each position."""
    _, folder = real_runs["dropouts"]
    # Route, vehicle and direction come from the recording itself.
    again = das_sim("replay", "run.mcap", "--out", "again.mcap", "--json", cwd=folder)
    assert again.returncode == 0, again.stderr
    assert json.loads(again.stdout)["messages_lost"] == 0
    a, b = (
        read_recording(folder / name).columns(POSITION, "quality", "uncertainty_m")
        for name in ("run.mcap", "again.mcap")
    )
    assert (a["quality"] == b["quality"]).all()
    assert np.allclose(a["uncertainty_m"], b["uncertainty_m"])
    assert (a["quality"] == 2).sum() == 6
