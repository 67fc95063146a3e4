"""Looking at a trip: energies with their ranges against closed forms, the command, and dirty files replayed whole."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.bus.topics import LOCATION
from das.domain.errors import DasError
from das.solver.section import Section, build_section
from sim import trip_command
from sim.estimate import MASS_RATIO, RESISTANCE_RATIO, WIND_MPS, EnergyRange, energy_range, estimate_run
from sim.recording import read_recording
from sim.trips.reading import read_trip
from sim.trips.trip import Trip, Whereabouts, load_trip
from tests.dirt import LENGTH_M, Points, all_together, clean, write
from tests.making import das_sim, flat, in_a_process, make_train
from tests.test_replay import kolback

C0_N, C2 = 2000.0, 8.0


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> tuple[Trip, Section, EnergyRange]:
    """The clean trip on a level line with a lossless train of 100 t that feeds back all it can."""
    path = write(tmp_path_factory.mktemp("trip"), clean(), on_route=True)
    section = build_section(flat(LENGTH_M), make_train(resistance=(C0_N, 0.0, C2)))
    trip = load_trip(path, read_trip(path), section.route, Whereabouts())
    return trip, section, energy_range(section, trip.matched)


def test_without_losses_the_energy_is_that_of_the_resistance(driven: tuple[Trip, Section, EnergyRange]) -> None:
    """From rest to rest: ∫(c0 + c2·v²)·v dt of the motion itself."""
    _, _, found = driven
    v = np.array([p.v for p in clean()], dtype=float)
    assert found.estimate_j == pytest.approx(np.trapezoid((C0_N + C2 * v**2) * v), rel=0.01)


def test_each_unknown_moves_the_energy_as_it_must(driven: tuple[Trip, Section, EnergyRange]) -> None:
    """Closed forms over the smooth run: R·(1 ± 10 %); c0 grows with the mass; c2·((v ± w)² − v²); m·a + R < 0."""
    trip, section, found = driven
    run, unknown = trip.run, {u.name: u for u in found.unknowns}
    v, t = run.speed_mps, run.time_s
    middle, a = 0.5 * (v[1:] + v[:-1]), np.diff(v) / np.diff(t)
    braked = np.minimum(section.vehicle.mass_kg * a + C0_N + C2 * middle**2, 0.0)
    recovered = float(-(braked * np.diff(run.s_m)).sum())
    wind = {sign: C2 * np.trapezoid((2 * sign * WIND_MPS * v + WIND_MPS**2) * v, t) for sign in (-1, 1)}
    off = {
        "mass": (-MASS_RATIO * C0_N * LENGTH_M, MASS_RATIO * C0_N * LENGTH_M),
        "running resistance": (-RESISTANCE_RATIO * found.estimate_j, RESISTANCE_RATIO * found.estimate_j),
        "wind along the line": (wind[-1], wind[1]),
        "braking": (0.0, recovered),
    }
    for name, (low, high) in off.items():
        assert unknown[name].low_j - found.estimate_j == pytest.approx(low, rel=0.01, abs=1.0), name
        assert unknown[name].high_j - found.estimate_j == pytest.approx(high, rel=0.01, abs=1.0), name
    smoothing = unknown["smoothing of the record"]
    assert smoothing.low_j <= found.estimate_j <= smoothing.high_j
    assert smoothing.high_j - smoothing.low_j < 0.02 * found.estimate_j  # a clean record
    # All at once: braking alone, the ends of the others multiply where they are one.
    assert found.low_j < min(u.low_j for u in found.unknowns)
    assert found.high_j > max(u.high_j for u in found.unknowns)
    assert found.high_j - found.estimate_j == pytest.approx(
        sum(u.high_j - found.estimate_j for u in found.unknowns), rel=0.1
    )


def test_dirt_hardly_changes_the_energy(tmp_path: Path, driven: tuple[Trip, Section, EnergyRange]) -> None:
    _, section, found = driven
    path = write(tmp_path, all_together(clean()), on_route=False)
    on = replace(section.route, **_meridian())
    trip = load_trip(path, read_trip(path), on, Whereabouts())
    run = trip.run
    assert estimate_run(section, run.time_s, run.s_m, run.speed_mps).ledger.input == pytest.approx(
        found.estimate_j, rel=0.01
    )


def _meridian() -> dict[str, Any]:
    from tests.test_trips import route

    with_geometry = route(LENGTH_M, geometry=True)
    names = ("geometry_position_m", "geometry_latitude_deg", "geometry_longitude_deg")
    return {name: getattr(with_geometry, name) for name in names}


def test_the_command_shows_writes_and_draws(shared: Path, tmp_path: Path) -> None:
    files = ("--write", "cleaned.csv", "--plot", "trip.png")
    done = in_a_process("sim.cli", "trip", *kolback(shared, "dropouts"), *files, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for told in (
        "589 of 603 points kept",
        "speed dropout",
        "long stand at the end",
        "median / 95 % / most",
        "not known",
    ):
        assert told in done.stdout
    assert (tmp_path / "trip.png").read_bytes().startswith(b"\x89PNG")
    options = [*kolback(shared, "dropouts")[1:5], "--json"]
    again = das_sim("trip", "cleaned.csv", *options, cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    found = json.loads(again.stdout)
    assert [f["kind"] for f in found["cleaning"]["findings"]] == ["other_way"]  # --reverse was not given
    assert found["whole_section"]
    assert found["trip_time_s"] == 559
    energy = found["energy"]
    assert energy["input_low_kwh"] < energy["input_kwh"] < energy["input_high_kwh"]
    assert energy["input_kwh"] == pytest.approx(217.7, rel=0.02)
    assert energy["strongest_braking_kn"] > 100


def as_gpx(rows: list[list[str]]) -> str:
    """A GPS record as GPX without speeds."""
    points = "".join(
        f'<trkpt lat="{a}" lon="{b}"><time>{np.datetime64(int(float(ms)), "ms")}Z</time></trkpt>\n'
        for a, b, _, ms in rows
    )
    return f'<gpx xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>\n{points}</trkseg></trk></gpx>\n'


def dirtied(rows: list[list[str]]) -> Iterator[list[str]]:
    """A real record with points given twice, times back, jumps, and a hole of 14 s."""
    for i, (latitude, longitude, speed, ms) in enumerate(rows):
        if 300 <= i < 313:
            continue
        moved = float(latitude) + (0.02 if i in (100, 101, 250) else 0.0)
        yield [f"{moved!r}", longitude, speed, f"{float(ms) - 3.3e3 * (i == 200)}"]
        if i in (50, 51):
            yield [latitude, longitude, speed, ms]


def test_a_dirty_track_becomes_a_reviewed_recording(shared: Path, tmp_path: Path) -> None:
    """The real record with planted defects, turned into GPX without speeds: replay, then view."""
    rows = [line.split(",") for line in Path(kolback(shared, "dropouts")[0]).read_text().split()]
    (tmp_path / "dirty.gpx").write_text(as_gpx(list(dirtied(rows))))
    options = kolback(shared, "dropouts")[1:]
    done = das_sim("replay", "dirty.gpx", *options, "--out", "run.mcap", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    counts = {f["kind"]: f["count"] for f in found["cleaning"]["findings"]}
    planted = {"duplicate_time": 2, "time_back": 1, "position_jump": 3, "gap": 1}
    assert {kind: counts[kind] for kind in planted} == planted
    assert counts["speed_missing"] > 500
    assert found["messages_lost"] == found["advices_above_limit"] == 0
    assert found["whole_section"]
    assert found["trip_time_s"] == pytest.approx(559, abs=4)
    assert found["energy_driven_low_kwh"] < found["energy_driven_kwh"] < found["energy_driven_high_kwh"]
    assert found["energy_driven_kwh"] == pytest.approx(217.7, rel=0.05)
    recording = read_recording(tmp_path / "run.mcap")
    assert recording.metadata["run"]["cleaning"] == found["cleaning_summary"]
    assert "3 × position jump (dropped)" in found["cleaning_summary"]
    viewed = das_sim("view", "run.mcap", "--save", "run.rrd", cwd=tmp_path)
    assert viewed.returncode == 0, viewed.stderr


def test_the_estimate_finds_the_energy_of_a_simulated_train(tmp_path: Path) -> None:
    """The plant integrates on its own: its true energy against that from a track without speeds, and the direction."""
    made = das_sim(
        *("make-trip", "--route", "zurich-luzern", "--vehicle", "re460-ic", "--from", "Zug", "--to", "Zürich HB"),
        *("--reverse", "--out", "made.mcap"),
        cwd=tmp_path,
    )
    assert made.returncode == 0, made.stderr
    said = re.search(r"energy of the simulated train ([\d.]+) kWh", made.stdout)
    assert said is not None
    fixes = [m.message for m in read_recording(tmp_path / "made.mcap").of(LOCATION)]
    rows = [[f"{f.latitude:.6f}", f"{f.longitude:.6f}", "", str(f.timestamp.ToMilliseconds())] for f in fixes]
    (tmp_path / "track.gpx").write_text(as_gpx(rows))
    done = das_sim("trip", "track.gpx", "--route", "zurich-luzern", "--vehicle", "re460-ic", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["reversed"]
    assert [stand["stop"] for stand in found["stands"]] == ["Zug", "Zürich HB"]
    assert any("try --from Zug" in note for note in found["not_known"])
    energy = found["energy"]
    assert energy["input_kwh"] == pytest.approx(float(said[1]), rel=0.06)
    assert energy["input_low_kwh"] < float(said[1]) < energy["input_high_kwh"]


def _unwritable(points: Points, folder: Path) -> dict[str, tuple[dict[str, Any], str]]:
    trip = write(folder, points, on_route=True)
    return {
        "itself": ({"write": trip}, "the file to write is the trip to read"),
        "nowhere": ({"plot": folder / "no" / "x.png"}, "no such folder"),
        "strict": ({"strict": True}, "line 43: time given twice"),
        "stops": ({"from_stop": "nowhere"}, "no stop 'nowhere'"),
        "no route": ({"route": None}, "a trip without a journey needs --route"),
        "a train that is none": ({"vehicle": "none"}, "not a bundled vehicle"),
    }


@pytest.mark.parametrize("name", ["itself", "nowhere", "strict", "stops", "no route", "a train that is none"])
def test_the_command_refuses_before_it_writes(tmp_path: Path, name: str) -> None:
    dirty = [q for i, p in enumerate(clean(6000.0)) for q in ([p, p] if i == 40 else [p])]
    changed, expected = _unwritable(dirty, tmp_path)[name]
    arguments: dict[str, Any] = {"file": tmp_path / "trip.csv", "route": "flat-6km", "write": tmp_path / "out.csv"}
    with pytest.raises(DasError, match=expected):
        trip_command.trip(**{**arguments, **changed})
    assert not (tmp_path / "out.csv").exists()
