"""Compares drives on one line at the same positions, and their energies at equal arrival.

Energy difference at equal arrival: the difference between the energies minus the difference between the optima for the
drives' own times, which is the value of the time difference (λ = −dE*/dT integrated over it). Energy saved by advice:
the difference at equal arrival between a run with advice and one without, with the same scenario and seed, driver and
brakes; without two such runs no saving is stated. Both are in % of the mean of both optima, so that a kWh is the same
share whatever the order of the drives.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np

from das.advice.advice import Source
from das.advice.regimes import Regime, mode_name
from das.domain.errors import DasError
from das.domain.summary import Summary
from das.domain.units import NS, kmh, kwh, kwh_figure, kwh_words
from sim.drive.above_optimum import NOT_COMPARABLE, AboveOptimum, energy_words, known_kwh
from sim.drive.drive import Drive
from sim.drive.events import place_text
from sim.drive.legs import DrivenLeg, since_departure_j
from sim.drive.table import DriveTable
from sim.drivers.kinds import DriverKind, FrictionPolicy, Presentation
from sim.recording.course import Floats, Times, known

ELECTRIC_FIRST: Final = "motors first"
"""Brakes assumed in estimates and for all simulated drivers but the human."""
SAME_BRAKES: Final = {
    True: "Both energies are those of the simulated train, with the same habit of braking.",
    False: "Both energies are estimates for the planned train: its mass, resistance, wind and brakes are not known.",
}
"""Conditions stated with a difference if both drives have the same brakes; the key: their energy was measured."""
OTHER_BRAKES: Final = (
    "The drives differ in their brakes or in the source of their energies. Both energies are therefore estimates for "
    "the planned train, braking with the motors first; neither accounts for the friction braking that took place."
)
"""Conditions stated with a difference if the drives have different brakes or energy sources."""


def run_of(drive: Drive) -> Mapping[str, str]:
    """The metadata of a simulated run; empty for any other drive."""
    run = drive.table.run
    return run if run.get("kind") == "run" else {}


def brakes_of(drive: Drive) -> str:
    """Words for the brakes used on a drive or assumed for it, and for whether its energy was measured."""
    run = run_of(drive)
    if not drive.energy.measured:
        known = any(leg.motion.friction_j is not None for leg in drive.energy.legs)
        return f"estimated, {'brake forces as recorded' if known else ELECTRIC_FIRST}"
    driver, policy = run.get("driver", ""), run.get("friction_policy", "")
    if driver != DriverKind.HUMAN:
        return ELECTRIC_FIRST if driver in list(DriverKind) else f"those of the driver {driver}"
    if policy == FrictionPolicy.BY_ADVICE:
        return f"{policy}, shown {run.get('advice')}"
    return ELECTRIC_FIRST if policy == FrictionPolicy.ELECTRIC_FIRST else policy


def same_brakes(drives: Sequence[Drive]) -> bool:
    """Whether the energies of drives have the same source and assume the same brakes."""
    return len({brakes_of(one) for one in drives}) == 1


@dataclass(frozen=True, kw_only=True)
class EqualArrival:
    """The extra energy of a drive over the first at equal arrival (J); None if that cannot be stated.

    `times_j` is the value of the time difference: the optimum for the times of the drive, less that for the times of
    the first. `ratio` is relative to the mean of the optima for both times. `hangs_on` are the conditions of the
    figure.
    """

    more_j: float | None
    times_j: float | None
    ratio: float | None
    hangs_on: str
    why_not: str = ""

    @classmethod
    def of(cls, first: Drive, other: Drive, *, own: bool) -> EqualArrival:
        """Compare two drives by their `own` energies, otherwise by estimates with the motors braking first."""
        hangs_on = SAME_BRAKES[first.energy.measured] if own else OTHER_BRAKES
        before, after = ((one.energy.above if own else one.energy.motors_first) for one in (first, other))
        if before is None or after is None:
            why_not = first.energy.not_comparable or other.energy.not_comparable
        else:
            why_not = (
                _trains_differ(first, other, own=own) or before.why_not or after.why_not or _stops_differ(before, after)
            )
        if why_not or before is None or after is None:
            return cls(more_j=None, times_j=None, ratio=None, hangs_on=hangs_on, why_not=why_not)
        times_j = after.optimum_j - before.optimum_j
        more_j = after.driven_j - before.driven_j - times_j
        optimum_j = 0.5 * (before.optimum_j + after.optimum_j)
        ratio = more_j / optimum_j if optimum_j > 0 else None
        return cls(more_j=more_j, times_j=times_j, ratio=ratio, hangs_on=hangs_on)

    def as_dict(self) -> dict[str, float | str | None]:
        """The figures for programs (kWh, share of the optimum)."""
        return {
            "more_energy_equal_arrival_kwh": known_kwh(self.more_j),
            "more_energy_equal_arrival_ratio": self.ratio,
            "times_worth_kwh": known_kwh(self.times_j),
            "equal_arrival_not_comparable": self.why_not or None,
            "hangs_on": self.hangs_on,
        }

    def sentence(self, first: str) -> str:
        """The figures in words; `first` is the name of the first drive."""
        if self.more_j is None or self.times_j is None:
            return f"At equal arrival: {NOT_COMPARABLE}: {self.why_not}."
        return (
            f"At equal arrival, against {first}: {energy_words(self.more_j, self.ratio)}; the time difference is worth "
            f"{kwh_words(self.times_j, signed=True)} at the optimum's price of time."
        )


def _trains_differ(first: Drive, other: Drive, *, own: bool) -> str:
    trains = [
        (one.table.inputs.vehicle.id, one.table.inputs.vehicle.mass_kg, one.table.inputs.level)
        for one in (first, other)
    ]
    same = trains[0] == trains[1] and (not own or _drawn(first).get("truth") == _drawn(other).get("truth"))
    return "" if same else "the trains differ"


def _drawn(drive: Drive) -> dict[str, Any]:
    drawn = json.loads(run_of(drive).get("drawn", "{}"))
    return drawn if isinstance(drawn, dict) else {}


def _stops_differ(before: AboveOptimum, after: AboveOptimum) -> str:
    stops = [[(section.start, section.end) for section in one.sections] for one in (before, after)]
    return "" if stops[0] == stops[1] else "they did not stop at the same stops"


DAY: Final = ("scenario_sha256", "seed", "route_sha256", "vehicle_sha256", "loss_map_sha256", "level")
"""Keys of metadata that are equal for two runs with the same scenario, seed, line and train."""
DRIVER: Final = ("driver", "driver_sha256")
"""Keys of metadata that are equal for two drives by the same driver."""


def why_not_saved(first: Drive, other: Drive) -> str:
    """The reason why the saving by advice cannot be found from two drives; empty if it can."""
    runs = run_of(first), run_of(other)
    if not all(runs):
        return "this needs two simulated runs with the same disturbances, one of them without advice"
    if _apart(runs, DAY) or _day(first) != _day(other):
        return "the runs differ in scenario, seed, line, train or disturbances"
    if _apart(runs, DRIVER) or _drawn(first).get("human") != _drawn(other).get("human"):
        return "the drivers differ"
    if not same_brakes((first, other)):
        return "the brakes differ"
    if sum(run.get("advice") == Presentation.NONE for run in runs) != 1:
        return "exactly one of them must be without advice"
    return ""


def _apart(runs: Sequence[Mapping[str, str]], keys: Sequence[str]) -> bool:
    return any(runs[0].get(key) != runs[1].get(key) for key in keys)


def _day(drive: Drive) -> tuple[Any, ...]:
    drawn, kept = _drawn(drive), json.loads(run_of(drive).get("what_if_kept", "{}"))
    return drawn.get("disturbances"), drawn.get("truth"), {key: value for key, value in kept.items() if value}


@dataclass(frozen=True, kw_only=True)
class SavedByAdvice:
    """The energy that advice saved at equal arrival (J), and its share of the optimum.

    Both are None if that cannot be stated, for the reason `why_not`.
    """

    saved_j: float | None
    ratio: float | None
    why_not: str

    @classmethod
    def of(cls, first: Drive, other: Drive) -> SavedByAdvice:
        """The energy that advice saved, from two drives, one with advice and one without."""
        why_not = why_not_saved(first, other)
        if not why_not:
            alone, advised = (first, other) if run_of(first)["advice"] == Presentation.NONE else (other, first)
            found = EqualArrival.of(alone, advised, own=True)
            if found.more_j is not None:
                return cls(saved_j=-found.more_j, ratio=None if found.ratio is None else -found.ratio, why_not="")
            why_not = found.why_not
        return cls(saved_j=None, ratio=None, why_not=why_not)

    def as_dict(self) -> dict[str, float | str | None]:
        """The figures for programs (kWh, share of the optimum)."""
        return {
            "saved_by_advice_kwh": known_kwh(self.saved_j),
            "saved_by_advice_ratio": self.ratio,
            "saved_by_advice_not_comparable": self.why_not or None,
        }

    @property
    def sentence(self) -> str:
        """The figures in words."""
        if self.saved_j is None:
            return f"Saved by advice: {NOT_COMPARABLE}: {self.why_not}."
        words = energy_words(self.saved_j, self.ratio)
        return f"Saved by advice: {words}, at equal arrival."


@dataclass(frozen=True, kw_only=True, eq=False)
class DriveOnTrack:
    """A drive from its first departure to its last arrival, arrays of shape (samples,); positions never decrease.

    `time_s` is on the drive's clock. `energy_j` is cumulative from the first departure, without stops;
    `motors_first_j` is its estimate for the planned train, braking with the motors first. `advised_mode` and
    `advised_mps` are the node's advice at each sample (0 and NaN: none).
    """

    label: str
    drive: Drive
    time_s: Floats
    s_m: Floats
    speed_mps: Floats
    energy_j: Floats
    motors_first_j: Floats
    advised_mode: Times
    advised_mps: Floats

    @property
    def train(self) -> str:
        """The id of the vehicle stated in the journey."""
        journey = self.drive.table.journey
        return "" if journey is None else journey.vehicle_id

    def at(self, s_m: Floats, values: Floats) -> Floats:
        """Values of the drive at positions; where the train stood, the value when it came to a stand."""
        first = np.append(True, np.diff(self.s_m) > 0)
        return np.asarray(np.interp(s_m, self.s_m[first], values[first]), dtype=np.float64)

    def advice_at(self, s_m: Floats) -> tuple[Times, Floats]:
        """Mode and speed of the last advice before the train came to each of the positions."""
        index = np.maximum(np.searchsorted(self.s_m, s_m + 1e-9, side="right") - 1, 0)
        first = np.searchsorted(self.s_m, self.s_m[index])  # where the train stood, the moment when it came to a stand
        return self.advised_mode[first], self.advised_mps[first]


def drives_on_track(drives: Sequence[Drive]) -> list[DriveOnTrack]:
    """Recorded drives by position, labelled with their files' names, and numbered if names are the same.

    DasError if a drive has no journey or no positions, or if its line or train is not known.
    """
    names = [drive.name for drive in drives]
    labels = [f"{name} ({i})" if names.count(name) > 1 else name for i, name in enumerate(names, start=1)]
    return [on_track(drive, label) for drive, label in zip(drives, labels, strict=True)]


def on_track(drive: Drive, label: str) -> DriveOnTrack:
    """A recorded drive by position; DasError if line or train is not known, or fewer than two stops were served."""
    motion, legs = drive.energy.motion, drive.energy.legs
    first = int(np.searchsorted(motion.time_ns, legs[0].motion.time_ns[0]))
    last = int(np.searchsorted(motion.time_ns, legs[-1].motion.time_ns[-1]))
    part = slice(max(first - 1, 0), last + 1)
    time_ns = motion.time_ns[part].copy()
    time_ns[0], time_ns[-1] = legs[0].motion.time_ns[0], legs[-1].motion.time_ns[-1]  # from rest to rest
    mode, advised_mps = _advised(drive.table, time_ns)
    return DriveOnTrack(
        label=label,
        drive=drive,
        time_s=np.asarray((time_ns - drive.table.clock.zero_ns) * NS, dtype=np.float64),
        s_m=_on_stops(motion.s_m[part], legs),
        speed_mps=motion.speed_mps[part],
        energy_j=since_departure_j(legs, drive.energy.of_legs, time_ns),
        motors_first_j=since_departure_j(legs, drive.energy.of_legs, time_ns, "motors_j"),
        advised_mode=mode,
        advised_mps=advised_mps,
    )


def _on_stops(s_m: Floats, legs: tuple[DrivenLeg, ...]) -> Floats:
    """Positions that never decrease, shifted by the few metres by which the train stood before or beyond its stops.

    Otherwise, if two trains stood a metre apart, one would seem to reach the stop only after its dwell.
    """
    stood_m = np.array([legs[0].motion.s_m[0], *(leg.motion.s_m[-1] for leg in legs)])
    stops_m = np.array([legs[0].start.s_m, *(leg.end.s_m for leg in legs)])
    return np.maximum.accumulate(s_m + np.interp(s_m, stood_m, stops_m - stood_m))


def _advised(table: DriveTable, time_ns: Times) -> tuple[Times, Floats]:
    """Mode and speed of the last advice at or before times; 0 and NaN where there was none."""
    advised_ns, source, mode, speed_mps = table.of_topic("advice", "source", "mode", "advised_speed_mps")
    given = source != Source.NONE
    modes = np.append(np.where(given, mode, 0), 0)
    speeds = np.append(np.where(given, speed_mps, np.nan), np.nan)
    last = np.searchsorted(advised_ns, time_ns, side="right") - 1  # −1 is the last entry: nothing
    return modes[last].astype(np.int64), speeds[last]


def check_one_line(drives: Sequence[Drive]) -> None:
    """Raise DasError if drives are not of one line and direction, because their positions mean different places."""
    ways = [_way(one.table) for one in drives]
    for other, way in zip(drives, ways, strict=True):
        if way != ways[0]:
            raise DasError(f"{other.recording.path}: drives {way}, {drives[0].recording.path} drives {ways[0]}")


def _way(table: DriveTable) -> str:
    journey = table.journey
    return "an unknown line" if journey is None else f"{journey.route_id}{' reversed' if journey.reversed else ''}"


STEP_M = 10.0
"""Default distance between two positions (m)."""
SAME_ADVICE_MPS = 0.5 / 3.6
"""Smallest difference (m/s) between two advised speeds that is shown."""
SAME_S, SAME_J = 1e-6, 1.0
"""Differences (s, J) below which two drives count as identical; they are due to rounding."""
EDGE_M = 0.5
"""Smallest distance (m) between ends of stretches; a closer end is left out."""


class Advised(NamedTuple):
    """The first place (m) where two drives were advised differently, and the advice to each, in words."""

    s_m: float
    first: str
    other: str


class PartedStretch(NamedTuple):
    """A stretch between stops or changes of the limit (m), and how much more the other drive needed there.

    `time_s` is the time, `energy_j` the energy drawn, `lost_j` the energy drawn minus the rise of the kinetic energy.
    """

    start_m: float
    end_m: float
    time_s: float
    energy_j: float
    lost_j: float

    @property
    def cells(self) -> tuple[str, ...]:
        """The stretch in a row of a table: its ends, the time in s, and both energies in kWh."""
        energies = (kwh_figure(energy_j, signed=True, finer=1) for energy_j in (self.energy_j, self.lost_j))
        return place_text(self.start_m), place_text(self.end_m), f"{self.time_s:+.1f}", *energies


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class AlignedDrives(Summary):
    """Drives at the same positions; arrays have the shape (drives, rows), and the first drive is the reference.

    `s_m` (rows,) rises in constant steps. A change of the line's limit is two rows at one position, with `limit_mps`
    before and after it. Times and energies count from the first row, at which the clock of each drive shows `start_s`
    (drives,). `own_energies`: the energies are those that each drive states; otherwise the motors are assumed to brake
    first.
    """

    drives: tuple[DriveOnTrack, ...]
    s_m: Floats
    limit_mps: Floats
    start_s: Floats
    time_s: Floats
    speed_mps: Floats
    energy_j: Floats
    lost_j: Floats
    own_energies: bool
    step_m: float = STEP_M

    @classmethod
    def of(cls, drives: Sequence[DriveOnTrack], step_m: float = STEP_M) -> AlignedDrives:
        """Align drives over the part of the line that all of them drove; DasError if there is none."""
        if not step_m > 0 or math.isinf(step_m):
            raise DasError(f"--step {step_m:g}: expected metres > 0")
        check_one_line([one.drive for one in drives])
        low_m = max(float(drive.s_m[0]) for drive in drives)
        high_m = min(float(drive.s_m[-1]) for drive in drives)
        if high_m - low_m < step_m:
            raise DasError("the drives have no part of the line in common, so they cannot be compared")
        s_m, limit_mps = _rows(drives[0].drive, low_m, high_m, step_m)
        speed = np.array([drive.at(s_m, drive.speed_mps) for drive in drives])
        own = same_brakes([drive.drive for drive in drives])
        energy = np.array([drive.at(s_m, drive.energy_j if own else drive.motors_first_j) for drive in drives])
        inertial_kg = np.array([[one.drive.table.inputs.vehicle.inertial_mass_kg] for one in drives])
        lost = energy - 0.5 * inertial_kg * speed**2
        time = np.array([drive.at(s_m, drive.time_s) for drive in drives])
        return cls(
            drives=tuple(drives),
            s_m=s_m,
            limit_mps=limit_mps,
            start_s=time[:, 0],
            time_s=time - time[:, :1],
            speed_mps=speed,
            energy_j=energy - energy[:, :1],
            lost_j=lost - lost[:, :1],
            own_energies=own,
            step_m=step_m,
        )

    @cached_property
    def pairs(self) -> tuple[AlignedDrives, ...]:
        """Each drive aligned with the first alone, so that other drives do not affect how the two differ.

        The pair of the first drive with itself is in front, so that a drive and its pair have the same number.
        """
        if len(self.drives) == 2:
            return self, self
        return tuple(AlignedDrives.of((self.drives[0], one), self.step_m) for one in self.drives)

    def facts(self) -> dict[str, str]:
        """Sentences on the part of the line compared, the differences from the first drive, and the advice's saving."""
        told = {
            drive.label: f"{sentences(self, number)[0]} {self.pairs[number].saved_by_advice(1).sentence}"
            for number, drive in enumerate(self.drives)
            if number
        }
        first_m, last_m = (place_text(float(at_m)) for at_m in self.s_m[[0, -1]])
        return {"way": f"{first_m} to {last_m}", "first": self.drives[0].label, **told}

    def columns(self) -> dict[str, Floats]:
        """The drives as arrays of shape (rows,), by names with units; columns of a drive end in its number, from 1."""
        names, drives = ("time_s", "speed_mps", "energy_j", "lost_j"), range(len(self.drives))
        each = {f"{name}_{number + 1}": getattr(self, name)[number] for number in drives for name in names}
        return {"s_m": self.s_m, "limit_mps": self.limit_mps, **each}

    @property
    def clock_s(self) -> Floats:
        """The time on the clock of each drive at each row (s): 0 at the timetable's first departure."""
        return self.start_s[:, None] + self.time_s

    @property
    def trains_differ(self) -> bool:
        """Whether the drives are of different trains, by name or by mass."""
        return len({(one.train, one.drive.table.inputs.vehicle.mass_kg) for one in self.drives}) > 1

    def is_same(self, other: int) -> bool:
        """Whether a drive agrees with the first in time, speed, energy and advice at every row."""
        return bool(
            np.abs(self.time_s[other] - self.time_s[0]).max() < SAME_S
            and np.abs(self.speed_mps[other] - self.speed_mps[0]).max() < SAME_S
            and np.abs(self.energy_j[other] - self.energy_j[0]).max() < SAME_J
            and self.first_different_advice(other) is None
        )

    def first_different_advice(self, other: int) -> Advised | None:
        """The first place where a drive was advised another mode or speed than the first drive; None if nowhere."""
        (mode, speed), (modes, speeds) = (self.drives[i].advice_at(self.s_m) for i in (0, other))
        apart = np.nan_to_num(np.abs(speed - speeds)) > SAME_ADVICE_MPS
        places = np.flatnonzero((mode != modes) | apart | (np.isnan(speed) != np.isnan(speeds)))
        if not len(places):
            return None
        at = int(places[0])
        return Advised(float(self.s_m[at]), *told_apart((mode[at], speed[at]), (modes[at], speeds[at])))

    def equal_arrival(self, other: int) -> EqualArrival:
        """The extra energy of a drive over the first at equal arrival."""
        return EqualArrival.of(self.drives[0].drive, self.drives[other].drive, own=self.own_energies)

    def saved_by_advice(self, other: int) -> SavedByAdvice:
        """The energy that advice saved, if this drive and the first show it."""
        return SavedByAdvice.of(self.drives[0].drive, self.drives[other].drive)

    def stretches(self, other: int) -> list[PartedStretch]:
        """The stretches between stops and changes of the limit, and how much more the other drive needed there."""
        edges = self._edges()
        ends_m = pairwise(self.s_m[edges].tolist())
        more = (np.diff((values[other] - values[0])[edges]) for values in (self.time_s, self.energy_j, self.lost_j))
        return [PartedStretch(*end_m, *map(float, one)) for end_m, *one in zip(ends_m, *more, strict=True)]

    def _edges(self) -> list[int]:
        stops_m = [end.s_m for leg in self.drives[0].drive.energy.legs for end in (leg.start, leg.end)]
        rows = {0, len(self.s_m) - 1}
        rows |= {int(row) + 1 for row in np.flatnonzero(np.diff(self.s_m) == 0)}
        rows |= {int(np.searchsorted(self.s_m, stop)) for stop in stops_m if self.s_m[0] < stop < self.s_m[-1]}
        kept = sorted(rows)
        return [kept[0], *(b for a, b in pairwise(kept) if self.s_m[b] - self.s_m[a] > EDGE_M)]


def compared(drives: Sequence[Drive]) -> tuple[AlignedDrives | None, str]:
    """Several drives aligned by position, or None and the reason why they cannot be; None for a single drive."""
    if len(drives) < 2:
        return None, ""
    try:
        return AlignedDrives.of(drives_on_track(drives)), ""
    except DasError as error:
        return None, str(error)


def _rows(first: Drive, low_m: float, high_m: float, step_m: float) -> tuple[Floats, Floats]:
    """Positions in constant steps, and every change of the limit twice, with the limit (m/s) before and after it."""
    limits = first.table.inputs.route.limits_mps
    even = np.append(np.arange(low_m, high_m, step_m), high_m)
    changes = limits.start_m[(limits.start_m > low_m) & (limits.start_m < high_m)]
    changes = changes[limits.at(changes) != limits.at(changes - 1e-6)]
    s_m = np.sort(np.concatenate((even[~np.isin(even, changes)], changes, changes)))
    limit_mps = limits.at(s_m)
    before = np.append(np.diff(s_m) == 0, False)  # the first row of two at one position
    limit_mps[before] = limits.at(s_m[before] - 1e-6)
    return s_m, limit_mps


def told_apart(first: tuple[int, float], other: tuple[int, float]) -> tuple[str, str]:
    """The advice (mode, speed in m/s) of two drives in words, precise enough to distinguish the two."""
    whole = (_said(*first, 0), _said(*other, 0))
    return whole if whole[0] != whole[1] else (_said(*first, 1), _said(*other, 1))


def _said(mode: int, speed_mps: float, digits: int) -> str:
    if math.isnan(speed_mps) or int(mode) == Regime.NONE:
        return "no advice"
    return f"{mode_name(Regime(int(mode)))} at {kmh(speed_mps):.{digits}f} km/h"


TOLD_S, TOLD_KWH = 0.5, 0.05
"""Differences of time (s) and energy (kWh) below which the sentences call the drives equal."""


def as_dict(aligned: AlignedDrives) -> dict[str, Any]:
    """The comparison for programs: s, kWh and m; differences are > 0 if a drive needed more than the first."""
    return {
        "from_m": float(aligned.s_m[0]),
        "to_m": float(aligned.s_m[-1]),
        "trains_differ": aligned.trains_differ,
        "drives": [drive_dict(aligned, index) for index in range(len(aligned.drives))],
    }


def drive_dict(aligned: AlignedDrives, index: int) -> dict[str, Any]:
    """One drive compared with the first, for programs."""
    on_track, pair = aligned.drives[index], aligned.pairs[index]
    drive, row = on_track.drive, min(index, 1)
    advised = None if index == 0 else pair.first_different_advice(1)
    found: dict[str, Any] = {
        "recording": str(drive.recording.path),
        "label": on_track.label,
        "train": on_track.train,
        "time_s": float(pair.time_s[row, -1]),
        "compared_energy_kwh": kwh(float(pair.energy_j[row, -1])),
        "motors_first": not pair.own_energies,
        "energy_kwh": known_kwh(drive.energy.driven_j),
        "measured": drive.energy.measured,
        **({} if drive.energy.above is None else drive.energy.above.as_dict()),
        "arrived_late_s": [known(leg.end.arrived_late_s) for leg in drive.energy.legs],
    }
    if index:
        found |= {
            "same": pair.is_same(1),
            "more_time_s": float(pair.time_s[1, -1] - pair.time_s[0, -1]),
            "more_energy_kwh": kwh(float(pair.energy_j[1, -1] - pair.energy_j[0, -1])),
            **pair.equal_arrival(1).as_dict(),
            **pair.saved_by_advice(1).as_dict(),
            "first_different_advice": None if advised is None else advised._asdict(),
            "stretches": [
                {
                    "start_m": one.start_m,
                    "end_m": one.end_m,
                    "more_time_s": one.time_s,
                    "more_energy_kwh": kwh(one.energy_j),
                    "more_lost_kwh": kwh(one.lost_j),
                }
                for one in pair.stretches(1)
            ],
        }
    return found


def as_csv(aligned: AlignedDrives) -> bytes:
    """A CSV table with one row per position, two at a change of the limit; columns of a drive end in its number.

    Drives are numbered from 1. `clock_s` is on the drive's clock; `time_s` and the energies count from the first row.
    """
    columns = {"s_m": aligned.s_m, "limit_kmh": kmh(aligned.limit_mps)}
    each = {
        "clock_s": aligned.clock_s,
        "time_s": aligned.time_s,
        "speed_kmh": kmh(aligned.speed_mps),
        "energy_kwh": kwh(aligned.energy_j),
        "lost_kwh": kwh(aligned.lost_j),
    }
    for i in range(len(aligned.drives)):
        columns |= {f"{name}_{i + 1}": values[i] for name, values in each.items()}
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(
        [f"{value:.6g}" if j else f"{value:.3f}" for j, value in enumerate(row)]
        for row in np.column_stack(list(columns.values()))
    )
    return text.getvalue().encode()


def _more_s(time_s: float) -> str:
    return f"{abs(time_s):.0f} s {'more' if time_s >= 0 else 'less'}"


def _more_energy(energy_j: float) -> str:
    return f"{kwh_words(abs(energy_j))} {'more' if energy_j >= 0 else 'less'}"


def result(aligned: AlignedDrives, index: int) -> str:
    """The difference in time from the first drive, and in energy at equal arrival if that is known, in few words."""
    more_j = aligned.equal_arrival(index).more_j
    energy = "" if more_j is None else f", {_more_energy(more_j)} at equal arrival"
    return _more_s(float(aligned.time_s[index, -1] - aligned.time_s[0, -1])) + energy


def sentences(aligned: AlignedDrives, index: int) -> list[str]:
    """Sentences on the differences of a drive from the first."""
    aligned, index = aligned.pairs[index], 1
    first, other = aligned.drives[0], aligned.drives[index]
    if aligned.is_same(index):
        return [f"{other.label} does not differ from {first.label}: times, speeds, energies and advice are the same."]
    more_s = float(aligned.time_s[index, -1] - aligned.time_s[0, -1])
    more_j = float(aligned.energy_j[index, -1] - aligned.energy_j[0, -1])
    told = [f"{other.label} took {_more_s(more_s)} and {_more_energy(more_j)} than {first.label}."]
    if abs(more_s) < TOLD_S and abs(kwh(more_j)) < TOLD_KWH:
        told = [f"{other.label} took the same time and energy as {first.label}."]
    if other.train != first.train:
        told.append(f"They are different trains: {first.train} and {other.train}.")
    elif other.drive.table.inputs.vehicle.mass_kg != first.drive.table.inputs.vehicle.mass_kg:
        told.append("The train is the same, but its mass differs.")
    found = aligned.equal_arrival(index)
    told += [found.sentence(first.label), found.hangs_on, aligned.saved_by_advice(index).sentence]
    advised = aligned.first_different_advice(index)
    if advised is None:
        told.append("The advice was the same everywhere.")
    else:
        told.append(
            f"The advice differs first at {place_text(advised.s_m)}: {advised.first} in {first.label}, "
            f"{advised.other} in {other.label}."
        )
    return told
