"""Looking at a trip: energies with their ranges against closed forms, the command, and dirty files replayed whole."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.bus.recording import read_recording
from das.bus.topics import LOCATION
from das.domain.effort import EffortEnvelope
from das.domain.errors import DasError
from das.domain.route import Floats
from das.domain.units import kwh
from das.domain.vehicle import BrakePolicy, Vehicle
from das.solver.front import Front
from das.solver.section import Section, SectionOptions, build_section
from das.solver.solve import solve_front
from sim.cli import trips as trip_command
from sim.drive.legs import ComparedLeg, DrivenLeg, LikelyRange, likely_range
from sim.drivers.kinds import DriverKind, Presentation
from sim.options import ReplayOptions, TripOptions
from sim.runs import replay_figures as replay_report
from sim.runs.replay import ReplayOutcome, driven_legs, prepare, stated_parts
from sim.runs.replay_figures import trip_energies
from sim.trips.estimate import (
    ESTIMATE_FOREIGN_RATIO,
    ESTIMATE_MASS_RATIO,
    ESTIMATE_RESISTANCE_RATIO,
    ESTIMATE_WIND_MPS,
    MASS,
    RESISTANCE,
    EnergyRange,
    doubt,
    energy_range,
    estimate_run,
    strongest_held_n,
)
from sim.trips.profile import to_profile
from sim.trips.trip import Trip
from sim.world.in_process import InProcess
from sim.world.lockstep import Traffic
from sim.world.loop import World
from tests.support.dirt import LENGTH_M, Point, all_together, clean, dropouts, late_end, on_route, spikes, write
from tests.support.flat_days import flat_day
from tests.support.made_line import north, posts_file, route
from tests.support.make_trip import made_trip
from tests.support.making import das_sim, das_sim_json, flat, make_train
from tests.support.tracks import as_gpx

C0_N, C2, LIMIT_MPS = 2000.0, 8.0, 35.0
ELECTRIC, FRICTION = BrakePolicy.ELECTRIC, BrakePolicy.FRICTION


def lossless() -> Section:
    return build_section(flat(LENGTH_M, LIMIT_MPS), make_train(resistance=(C0_N, 0.0, C2)))


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> tuple[Trip, Section, EnergyRange]:
    """The clean trip on a level line with a lossless train of 100 t that feeds back all it can."""
    section = lossless()
    trip = on_route(tmp_path_factory.mktemp("trip"), clean(), section.route, positions=True)
    return trip, section, energy_range(section, stated_parts(trip, section)[0])


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
    wind = {
        sign: C2 * np.trapezoid((2 * sign * ESTIMATE_WIND_MPS * v + ESTIMATE_WIND_MPS**2) * v, t) for sign in (-1, 1)
    }
    off = {
        "mass": (-ESTIMATE_MASS_RATIO * C0_N * LENGTH_M, ESTIMATE_MASS_RATIO * C0_N * LENGTH_M),
        "running resistance": (
            -ESTIMATE_RESISTANCE_RATIO * found.estimate_j,
            ESTIMATE_RESISTANCE_RATIO * found.estimate_j,
        ),
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
    names = ("geometry_position_m", "geometry_latitude_deg", "geometry_longitude_deg")
    mapped = route(LENGTH_M, geometry=True)
    on = replace(section.route, **{name: getattr(mapped, name) for name in names})
    run = on_route(tmp_path, all_together(clean()), on).run
    energy_j = estimate_run(section, run.time_s, run.s_m, run.speed_mps).balance.input
    assert energy_j == pytest.approx(found.estimate_j, rel=0.01)


def test_the_command_shows_and_writes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A made-up trip with many defects: they are named, and the cleaned file has none left."""
    monkeypatch.setenv("COLUMNS", "140")  # No phrase is broken over lines.
    trip = write(tmp_path, late_end(dropouts(spikes(clean(6000.0)))))
    posts = posts_file(tmp_path, *north(np.arange(-1000.0, 7001.0, 1000.0)))
    where = ("--route", "flat-6km", "--vehicle", "re460-ic", "--no-reverse")
    files = ("--out", "cleaned.csv")
    done = das_sim("trip", str(trip), *where, "--posts", str(posts), *files, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for told in (
        "points kept",
        "impossible speed",
        "speed dropout",
        "long stand at the end",
        "median / 95 % / most",
        "running resistance",
    ):
        assert told in done.stdout
    again = das_sim("trip", "cleaned.csv", *where, "--json", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    found = json.loads(again.stdout)
    assert found["cleaning"]["findings"] == []
    assert found["whole_section"]
    assert found["trip_time_s"] == pytest.approx(260, abs=1.0)  # times of stands are known to half a sample
    energy = found["energy"]
    assert energy["energy_low_kwh"] < energy["energy_kwh"] < energy["energy_high_kwh"]


def test_the_estimate_finds_the_energy_and_the_losses_of_a_simulated_run() -> None:
    """The train model integrates force and losses on its own; the estimate knows times, positions and speeds alone."""
    day = flat_day()
    states = (
        World(day, day.driver(DriverKind.PERFECT), Presentation.SPEED_AND_EFFORT, InProcess(day.service)).run().states
    )
    time_s, s_m, speed_mps = (
        np.array([getattr(one, name) for one in states]) for name in ("time_s", "s_m", "speed_mps")
    )
    section = build_section(day.service.route, day.service.vehicle, level=day.service.level)
    found, truth = estimate_run(section, time_s, s_m, speed_mps).balance, day.plant.balance(states[0], states[-1])
    assert found.input == pytest.approx(truth.input, rel=0.02)
    assert found.component_loss == pytest.approx(truth.component_loss, rel=0.03)


@pytest.mark.nightly
def test_the_estimate_finds_the_energy_of_a_simulated_train(tmp_path: Path) -> None:
    """The plant integrates on its own: its true energy against that from a track without speeds, and the direction."""
    states = made_trip(tmp_path / "made.mcap", "zurich-luzern", between=("Zug", "Zürich HB"), reverse=True)
    fixes = [m.message for m in read_recording(tmp_path / "made.mcap").of(LOCATION)]
    rows = [[f"{f.latitude:.6f}", f"{f.longitude:.6f}", "", str(f.timestamp.ToMilliseconds())] for f in fixes]
    (tmp_path / "track.gpx").write_text(as_gpx(rows))
    found = das_sim_json("trip", "track.gpx", "--route", "zurich-luzern", "--vehicle", "re460-ic", cwd=tmp_path)
    assert found["reversed"]
    assert [stand["stop"] for stand in found["stands"]] == ["Zug", "Zürich HB"]
    assert any("try --from Zug" in note for note in found["not_known"])
    energy, true_kwh = found["energy"], kwh(states[-1].energy_input_j)
    assert energy["energy_kwh"] == pytest.approx(true_kwh, rel=0.06)
    assert energy["energy_low_kwh"] < true_kwh < energy["energy_high_kwh"]


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "itself": ({"out": "trip.csv"}, "the output file is also an input"),
    "nowhere": ({"out": "no/x.csv"}, "no such folder"),
    "stops": ({"from_stop": "nowhere"}, "no stop 'nowhere'"),
    "no route": ({"route": None}, "a trip without a journey needs --route"),
    "a train that is none": ({"vehicle": "none"}, "not a bundled vehicle"),
}


@pytest.mark.parametrize(("changed", "expected"), REFUSED.values(), ids=REFUSED)
def test_the_command_refuses_before_it_writes(tmp_path: Path, changed: dict[str, Any], expected: str) -> None:
    dirty = [q for i, p in enumerate(clean(6000.0)) for q in ([p, p] if i == 40 else [p])]
    trip = write(tmp_path, dirty, on_route=True)
    files = {"out": "out.csv", **{key: changed[key] for key in ("out",) if key in changed}}
    said = {"route": "flat-6km", **{key: value for key, value in changed.items() if key not in files}}
    with pytest.raises(DasError, match=expected):
        trip_command.trip(trip, TripOptions(**said), **{key: tmp_path / name for key, name in files.items()})
    assert not (tmp_path / "out.csv").exists()


SEEN = np.zeros(10_000, dtype=bool)
"""No point lies in a gap."""


def braked_hard_at_last() -> tuple[Floats, Floats, Floats]:
    """t, s, v at 10 Hz: from rest 60 s at 0.5 m/s², 60 s of cruising, 57 s at −0.5 m/s², at last 1 s at −1.5 m/s²."""
    t = np.arange(0.0, 178.01, 0.1)
    v = np.interp(t, [0, 60, 120, 177, 178], [0, 30, 30, 1.5, 0])
    return t, np.append(0.0, np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))), v


def test_the_strongest_force_is_one_that_is_held(driven: tuple[Trip, Section, EnergyRange]) -> None:
    """The least m·a + R of the best 8 s: those up to 30 m/s, of which the first is at 26 m/s, and those from 5 m/s."""
    _, section, _ = driven
    found = estimate_run(section, *braked_hard_at_last())
    mass_kg = section.vehicle.inertial_mass_kg
    traction_n, braking_n = strongest_held_n(found, SEEN)
    force_n = found.trajectory.force_el_n + found.trajectory.force_friction_n
    assert -force_n.min() == pytest.approx(1.5 * mass_kg - C0_N, rel=0.02)  # of the last second alone
    assert traction_n == pytest.approx(0.5 * mass_kg + C0_N + C2 * 26.0**2, rel=0.01)
    assert braking_n == pytest.approx(0.5 * mass_kg - C0_N - C2 * 5.0**2, rel=0.01)
    in_gap = SEEN.copy()
    in_gap[1170:] = True  # all of the braking, at 10 Hz
    assert strongest_held_n(found, in_gap) == (traction_n, 0.0)


@pytest.mark.parametrize(("seconds", "beyond_s"), [(2, 0), (12, 12)])
def test_more_force_than_the_vehicle_has_counts_if_it_is_held(
    driven: tuple[Trip, Section, EnergyRange], seconds: int, beyond_s: int
) -> None:
    """0.5 m/s², then 1.25 m/s² (of 100 kN and 100 t) for a while, then a steady speed."""
    t = np.arange(0.0, 121.0)
    v = np.interp(t, [0, 30, 30 + seconds, 120], [0, 15, 15 + 1.25 * seconds, 15 + 1.25 * seconds])
    found = estimate_run(driven[1], t, np.append(0.0, np.cumsum(0.5 * (v[1:] + v[:-1]))), v)
    assert found.beyond_ratio * 120 == pytest.approx(beyond_s, abs=4)
    assert not found.beyond[:25].any()


def hand_made(mass: float, resistance: float, wind_mps: float) -> Vehicle:
    """The train of the fixture with other figures: c0 grows with the mass, R(v) = c0 + c2·(v + w)²."""
    c0, c2 = mass * resistance * C0_N, resistance * C2
    return replace(make_train(resistance=(c0 + c2 * wind_mps**2, 2 * c2 * wind_mps, c2)), mass_kg=mass * 1e5)


def likely_above(
    trip: Trip, front: Front, shortest_s: float | None = None, lacking_ratio: float = 0.0
) -> tuple[float, LikelyRange]:
    """The energy above the optimum (J) of a trip on one section, and its range.

    Of a trip that took a shorter time where that is given (s), and of a train that lacks this share of a force.
    """

    def legs(jerk_ratio: float) -> list[DrivenLeg]:
        (leg,) = driven_legs(trip, to_profile(trip.matched, jerk_ratio))
        if shortest_s is None:
            return [leg]
        ratio, time_ns = shortest_s / leg.trip_s, leg.motion.time_ns
        faster_ns = time_ns[0] + np.rint(ratio * (time_ns - time_ns[0])).astype(np.int64)
        return [replace(leg, motion=replace(leg.motion, time_ns=faster_ns))]

    (found,) = [ComparedLeg.of(one, front) for one in legs(1.0)]
    lacks = replace(found.energies, beyond_s=lacking_ratio * found.leg.trip_s, lacking_ratio=lacking_ratio)
    above_j = found.driven_j - found.optimum.balance.input
    return above_j, likely_range([replace(found, energies=lacks)], legs)


@pytest.mark.slow
def test_the_range_above_the_optimum_is_that_of_all_trains_it_may_have_been(
    driven: tuple[Trip, Section, EnergyRange],
) -> None:
    """By brute force: every train solved again, and the part above 0 of ∫(m·a + R)ds where friction alone brakes."""
    trip, section, _ = driven
    run = trip.run
    trip_s = float(run.time_s[-1])
    v, a = 0.5 * (run.speed_mps[1:] + run.speed_mps[:-1]), np.diff(run.speed_mps) / np.diff(run.time_s)

    def above_j(mass: float = 1.0, more: float = 1.0, wind: float = 0.0, brakes: BrakePolicy = ELECTRIC) -> float:
        train = hand_made(mass, more, wind)
        front = solve_front(build_section(section.route, train, options=SectionOptions(brakes=brakes)))
        force = train.mass_kg * a + mass * more * C0_N + more * C2 * (v + wind) ** 2
        taken = np.maximum(force, 0.0) if brakes is FRICTION else force
        return float((taken * np.diff(run.s_m)).sum()) - front.trajectory(trip_s).balance.input

    estimate_j, found = likely_above(trip, solve_front(section))
    assert estimate_j == pytest.approx(above_j(), rel=0.06)
    assert found.by_friction_j == pytest.approx(above_j(brakes=FRICTION), rel=0.01)
    unknown = {one.name: one for one in found.unknowns}
    smoothing = unknown["smoothing of the record"]
    off = [(smoothing.low_j - estimate_j, smoothing.high_j - estimate_j)]
    for name, ends in (
        (MASS, ({"mass": 0.95}, {"mass": 1.05})),
        (RESISTANCE, ({"more": 0.9}, {"more": 1.1})),
        ("wind along the line", ({"wind": -5.0}, {"wind": 5.0})),
    ):
        low_j, high_j = sorted(above_j(**end) - above_j() for end in ends)
        off.append((min(low_j, 0.0), max(high_j, 0.0)))
        told = unknown[name].low_j - estimate_j, unknown[name].high_j - estimate_j
        assert told == pytest.approx(off[-1], abs=0.1 * (high_j - low_j)), name
    assert estimate_j - found.low_j == pytest.approx(np.hypot.reduce([low_j for low_j, _ in off]), rel=0.1)
    assert found.high_j - estimate_j == pytest.approx(np.hypot.reduce([high_j for _, high_j in off]), rel=0.1)


def test_trains_that_could_not_have_arrived_are_left_out(driven: tuple[Trip, Section, EnergyRange]) -> None:
    """One that is heavier could not: the range of its mass ends at the assumed one."""
    trip, section, _ = driven
    front = solve_front(section)
    estimate_j, found = likely_above(trip, front, shortest_s=front.fastest().time_s + 0.2)
    mass = next(one for one in found.unknowns if one.name == MASS)
    assert estimate_j in (mass.low_j, mass.high_j)
    assert mass.low_j < mass.high_j
    assert found.low_j <= estimate_j <= found.high_j


def test_who_drove_the_optimum_is_not_told_to_be_above_it(tmp_path: Path) -> None:
    """The optimum's own trajectory as a record once a second: nothing is above it, and nothing is claimed."""
    section = lossless()
    front = solve_front(section)
    best = front.trajectory(340.0).trajectory
    t = np.arange(0.0, 341.0)
    s, v = np.interp(t, best.t_s, best.s_m), np.interp(t, best.t_s, best.v_mps)
    points = [Point(float(a), float(b), float(c)) for a, b, c in zip(t, s, v, strict=True)]
    trip = on_route(tmp_path, points, section.route, positions=True)
    estimate_j, found = likely_above(trip, front)
    least_j = best.balance(section.vehicle, section.loss).input
    assert abs(estimate_j) < 0.01 * least_j
    assert not replay_report.likely_above(found, least_j)
    assert replay_report.likely_above(replace(found, low_j=0.1 * least_j, by_friction_j=math.nan), least_j)
    assert not replay_report.likely_above(replace(found, low_j=0.1 * least_j, by_friction_j=0.0), least_j)
    figures: dict[str, Any] = {"above_optimum_kwh": 1.0, "above_optimum_ratio": 0.01, "beyond_vehicle_ratio": 0.0}
    figures |= {"above_optimum_likely_low_kwh": 0.7, "above_optimum_likely_high_kwh": 1.2}
    figures |= {"above_optimum_by_friction_kwh": 2.0, "likely_above_optimum": False}
    likely = [("  likely", "1 to 1 kWh"), ("  if friction alone braked", "2 kWh")]
    assert replay_report.above_rows(figures) == [("above the optimum", "perhaps nothing"), *likely]
    figures |= {"above_optimum_by_friction_kwh": None, "likely_above_optimum": True}
    told = replay_report.above_rows(figures)
    assert told == [("above the optimum", "+1.0 kWh (1.0 % of the optimum)"), likely[0]]


def weaker(section: Section, force_n: float) -> Section:
    """The section of a train with this traction only, which cannot have driven the clean trip (0.5 m/s² with 100 t)."""
    traction = EffortEnvelope(max_force_n=force_n, max_power_w=1e12)
    return build_section(section.route, replace(section.vehicle, traction=traction))


def test_the_range_of_a_train_that_lacks_force_contains_a_train_that_has_it(
    driven: tuple[Trip, Section, EnergyRange],
) -> None:
    """A tenth of the force is lacking in the start: the mass is off by as much more, and so are energy and distance."""
    trip, own, _ = driven
    run = trip.run
    needed_n = strongest_held_n(estimate_run(own, run.time_s, run.s_m, run.speed_mps), run.inferred)[0]
    section = weaker(own, 0.9 * needed_n)
    found = estimate_run(section, run.time_s, run.s_m, run.speed_mps)
    assert ESTIMATE_FOREIGN_RATIO < found.beyond_ratio < 0.2
    assert found.lacking_ratio == pytest.approx(0.1, abs=0.03)
    doubt_ratio = doubt(found.beyond_ratio, found.lacking_ratio)
    assert doubt_ratio == found.lacking_ratio
    mass_ratio = ESTIMATE_MASS_RATIO + doubt_ratio
    lighter = replace(section, vehicle=section.vehicle.with_mass((1 - mass_ratio) * section.vehicle.mass_kg))
    assert estimate_run(lighter, run.time_s, run.s_m, run.speed_mps).beyond_ratio == 0.0
    parts = stated_parts(trip, section)[0]
    known, doubted = energy_range(section, parts), energy_range(section, parts, doubt_ratio)
    assert doubted.low_j < known.low_j < known.high_j < doubted.high_j
    unknown = {one.name: one for one in doubted.unknowns}
    assert unknown[MASS].assumed == f"± {100 * mass_ratio:.0f} %"
    off_j = {name: one.high_j - one.low_j for name, one in unknown.items()}
    assert off_j[MASS] == pytest.approx(2 * mass_ratio * C0_N * LENGTH_M, rel=0.02)
    resistance_ratio = ESTIMATE_RESISTANCE_RATIO + doubt_ratio
    assert off_j[RESISTANCE] == pytest.approx(2 * resistance_ratio * doubted.estimate_j, rel=0.02)


@pytest.mark.parametrize(("beyond_ratio", "lacking_ratio", "doubt_ratio"), [
    (0.0, 0.0, 0.0), (0.004, 0.12, 0.0), (0.01, 0.12, 0.12), (0.04, 0.6, 0.25),
])  # fmt: skip
def test_a_train_is_doubted_by_the_force_that_it_lacks(
    beyond_ratio: float, lacking_ratio: float, doubt_ratio: float
) -> None:
    assert doubt(beyond_ratio, lacking_ratio) == pytest.approx(doubt_ratio)


def test_a_heavier_train_is_not_left_out_for_efforts_that_are_doubted(
    driven: tuple[Trip, Section, EnergyRange],
) -> None:
    """The trip takes hardly more than the fastest run, so that the efforts of the file do not suffice for more mass."""
    trip, section, _ = driven
    front = solve_front(section)
    shortest_s = front.fastest().time_s + 0.2
    (_, known), (estimate_j, doubted) = (likely_above(trip, front, shortest_s, one) for one in (0.0, 0.1))
    mass = next(one for one in doubted.unknowns if one.name == MASS)
    assert mass.high_j - estimate_j == pytest.approx(estimate_j - mass.low_j)
    assert doubted.low_j < known.low_j < known.high_j < doubted.high_j


@pytest.mark.parametrize("reverse", [None, False])
def test_nothing_is_compared_before_the_direction_is_known(tmp_path: Path, reverse: bool | None) -> None:
    """By kilometre posts, in the trip's own order, either direction may be right: the user must say."""
    posts = posts_file(tmp_path, *north(np.arange(-1000.0, 7001.0, 1000.0)))
    trip = write(tmp_path, clean(6000.0), on_route=False)
    options = ReplayOptions(trip=TripOptions(route="flat-6km", vehicle="re460-ic", posts=posts, reverse=reverse))
    job = prepare(trip, options, tmp_path / "out.mcap", "test")
    found = replay_report.result(job, ReplayOutcome(traffic=Traffic(), replay_s=1.0), trip_energies(job))
    assert found["direction_known"] == (reverse is not None)
    assert (found["above_optimum_kwh"] is None) == (reverse is None)
    told = [note for note in replay_report.notes(found) if "the direction of the trip:" in note]
    assert len(told) == (reverse is None)
    if reverse is not None:
        assert found["above_optimum_likely_low_kwh"] < found["above_optimum_kwh"]
        assert found["above_optimum_kwh"] < found["above_optimum_likely_high_kwh"]
    elif told:
        assert told[0].endswith("give --no-reverse if it is so, --reverse if not")
        assert "not comparable: the direction of the trip is not known" in replay_report.notes(found)
