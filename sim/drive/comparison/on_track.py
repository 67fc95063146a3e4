"""A recorded drive over the track: when it was where, how fast, with how much energy, and what was advised."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from das.advice.advice import Source
from das.bus import topics
from das.bus.recording import Recording
from das.domain.errors import DasError
from das.domain.units import NS
from sim.drive.attribution.committed import section_of_leg
from sim.drive.attribution.driven_legs import DrivenLeg, DrivenMotion, leg_energies
from sim.drive.attribution.inputs import DriveInputs
from sim.drive.drive import Drive
from sim.recording.course import Floats, Times


@dataclass(frozen=True, kw_only=True, eq=False)
class DriveOnTrack:
    """A drive from its first departure to its last arrival, arrays of shape (samples,); positions do not fall.

    `time_s` is on the drive's clock, `energy_j` since the first departure, estimated unless `measured`. `advised_mode`
    and `advised_mps` are what the node advised at each sample (0 and NaN: nothing).
    """

    label: str
    recording: Recording
    inputs: DriveInputs
    legs: tuple[DrivenLeg, ...]
    time_s: Floats
    s_m: Floats
    speed_mps: Floats
    energy_j: Floats
    measured: bool
    advised_mode: Times
    advised_mps: Floats

    @property
    def train(self) -> str:
        """The vehicle, as the journey names it."""
        return str(self.recording.of(topics.JOURNEY)[-1].message.vehicle_id)

    @property
    def route(self) -> tuple[str, bool]:
        """The route as the journey names it, and whether it is driven from its end."""
        journey = self.recording.of(topics.JOURNEY)[-1].message
        return str(journey.route_id), bool(journey.reversed)

    def at(self, s_m: Floats, values: Floats) -> Floats:
        """Values over the drive at positions; at a stand, the value on coming to it."""
        first = np.append(True, np.diff(self.s_m) > 0)
        return np.asarray(np.interp(s_m, self.s_m[first], values[first]), dtype=np.float64)

    def advice_at(self, s_m: Floats) -> tuple[Times, Floats]:
        """Mode and speed that were advised when the train came to positions; the last before each."""
        index = np.maximum(np.searchsorted(self.s_m, s_m + 1e-9, side="right") - 1, 0)
        first = np.searchsorted(self.s_m, self.s_m[index])  # of a stand the moment of coming to it
        return self.advised_mode[first], self.advised_mps[first]


def drives_on_track(paths: Sequence[Path]) -> list[DriveOnTrack]:
    """Read recorded drives; DasError where one has no journey, no positions, or its line and train are not known.

    Drives are called by their files' names, with numbers where these are the same.
    """
    stems = [path.stem for path in paths]
    labels = [f"{stem} ({i})" if stems.count(stem) > 1 else stem for i, stem in enumerate(stems, start=1)]
    return [on_track(Drive.read(path), label) for path, label in zip(paths, labels, strict=True)]


def on_track(drive: Drive, label: str) -> DriveOnTrack:
    """A recorded drive over the track; DasError where its line and train are not known, or it served no two stops."""
    recording, inputs, motion, legs = drive.recording, drive.inputs, drive.motion, drive.legs
    first = int(np.searchsorted(motion.time_ns, legs[0].motion.time_ns[0]))
    last = int(np.searchsorted(motion.time_ns, legs[-1].motion.time_ns[-1]))
    part = slice(max(first - 1, 0), last + 1)
    time_ns = motion.time_ns[part].copy()
    time_ns[0], time_ns[-1] = legs[0].motion.time_ns[0], legs[-1].motion.time_ns[-1]  # from rest to rest
    mode, advised_mps = _advised(recording, time_ns)
    return DriveOnTrack(
        label=label,
        recording=recording,
        inputs=inputs,
        legs=legs,
        time_s=np.asarray((time_ns - drive.clock.zero_ns) * NS, dtype=np.float64),
        s_m=_on_stops(motion.s_m[part], legs),
        speed_mps=motion.speed_mps[part],
        energy_j=_energy_j(inputs, motion, legs, time_ns),
        measured=motion.input_j is not None,
        advised_mode=mode,
        advised_mps=advised_mps,
    )


def _on_stops(s_m: Floats, legs: tuple[DrivenLeg, ...]) -> Floats:
    """Positions that do not fall, moved by the few metres by which the train stood before or beyond its stops.

    Without that, of two trains that stood a metre apart one would come to the stop after its dwell.
    """
    stood_m = np.array([legs[0].motion.s_m[0], *(leg.motion.s_m[-1] for leg in legs)])
    stops_m = np.array([legs[0].start.s_m, *(leg.end.s_m for leg in legs)])
    return np.maximum.accumulate(s_m + np.interp(s_m, stood_m, stops_m - stood_m))


def _energy_j(inputs: DriveInputs, motion: DrivenMotion, legs: tuple[DrivenLeg, ...], time_ns: Times) -> Floats:
    """Energy since the first departure (J): measured, or estimated on the legs, where nothing is drawn at stops."""
    if motion.input_j is not None:
        energy_j = np.interp(time_ns, motion.time_ns, motion.input_j)
        return np.asarray(energy_j - energy_j[0])
    total_j = np.zeros(len(time_ns))
    for leg in legs:
        energies = leg_energies(section_of_leg(inputs, leg), leg)
        total_j += np.interp(time_ns, leg.motion.time_ns, energies.ledger_j)
    return total_j


def _advised(recording: Recording, time_ns: Times) -> tuple[Times, Floats]:
    """Mode and speed of the last advice at or before times; 0 and NaN where there was none."""
    advice = recording.columns(topics.ADVICE, "time_ns", "source", "mode", "advised_speed_mps")
    given = advice["source"] != Source.NONE
    modes = np.append(np.where(given, advice["mode"], 0), 0)
    speeds = np.append(np.where(given, advice["advised_speed_mps"], np.nan), np.nan)
    last = np.searchsorted(advice["time_ns"], time_ns, side="right") - 1  # −1 is the last entry: nothing
    return modes[last].astype(np.int64), speeds[last]


def check_one_line(drives: list[DriveOnTrack]) -> None:
    """Raise DasError where drives are not of one line and direction: their positions mean other places."""
    first = drives[0]
    for other in drives[1:]:
        if other.route != first.route:
            ways = [f"{name}{' reversed' if back else ''}" for name, back in (first.route, other.route)]
            raise DasError(f"{other.recording.path}: drives {ways[1]}, {first.recording.path} drives {ways[0]}")
