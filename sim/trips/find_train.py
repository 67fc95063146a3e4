"""Finding the train of a recorded trip among several trains, with its mass and running resistance.

A record shows the motion, not the forces. Three things still distinguish trains. A train cannot exceed its effort. Its
driver often uses the full effort, or none: the force is then known for each train, so that the motion gives mass and
resistance. Finally, the speeds may or may not come near the top speed. The windows of motion are those of the
calibration on board, with the full effort of the train instead of a measured force (docs/explanation/find-train.md).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from das.command_line.files import load_vehicle
from das.domain.conditions import Conditions
from das.domain.errors import DasError
from das.domain.files.load import catalogue
from das.domain.route import Floats
from das.domain.units import KMH, NS, STANDARD_GRAVITY_MPS2
from das.domain.vehicle import Vehicle
from das.estimate.calibration import NORMAL_MAD, SLOWEST_MPS, SPEED_SD_MPS, LineIntegral, MeasuredWindow
from sim.trips.estimate import CHOICE_OVERSPEED_RATIO, ESTIMATE_BEYOND_RATIO, ESTIMATE_HELD_S
from sim.trips.record import Bools
from sim.trips.trip import Trip

WINDOW_SAMPLES: Final = 12
"""Samples of a window, one a second: fewer hide the acceleration in the noise, more mix several acts of a driver."""
WINDOW_WEIGHT: Final = 0.5
"""Weight of a window, because each overlaps half of the previous one."""
WINDOW_LEAST: Final = 8
"""Least number of windows of a trip from which its train can be found."""
WINDOW_UNMEASURED_SPEED_SD_MPS: Final = 0.3
"""Noise (m/s) of the speeds of a record that reports none."""
WINDOW_LINE_SD_RATIO: Final = 5e-4
"""Uncertainty of gradients and curves, as a share of the weight (one standard deviation)."""
WINDOW_FULL_SD_RATIO: Final = 0.02
"""Uncertainty of the train's full effort (one standard deviation)."""
WINDOW_HELD_SD_MPS2: Final = 0.02
"""Acceleration (m/s², one standard deviation) of a driver who holds a speed."""
WINDOW_HARDEST_BRAKING_MPS2: Final = 1.0
"""Hardest braking (m/s²) of a driver in service, however strong the brakes are."""
SHARE_COASTING: Final = 0.08
SHARE_FULL: Final = 0.12
"""Weight of full traction in the mixture of driving."""
SHARE_HELD: Final = 0.4
"""Weight of holding a speed."""
SHARE_TRACTION: Final = 0.45
"""Weight of any other traction; its density is the same for all trains that have the effort."""
SHARE_BRAKING: Final = 0.3
"""Weight of any braking; its density is the same for all trains that have the brakes."""
SHARE_UNEXPLAINED: Final = 2.5e-4
"""Weight of any other motion: a force that the train does not have, or a wrong record."""
RATIO_MASS_BOUNDS: Final = (0.7, 1.4)
"""Bounds of the mass: an empty train, and an overloaded train."""
RATIO_RESISTANCE_BOUNDS: Final = (0.5, 2.0)
"""Bounds of the resistance: a long tail wind, and a storm from ahead."""
RATIO_STEPS: Final = 36
"""Number of values of either ratio that are tried."""
RATIO_MASS_SD: Final = 0.1
"""Prior standard deviation of the mass ratio."""
RATIO_RESISTANCE_LOG_SD: Final = 0.15
"""Prior standard deviation of the logarithm of the resistance ratio."""
RATIO_MODEL_SD: Final = 0.015
"""The uncertainty of either ratio that remains whatever the motion (one standard deviation)."""
RATIO_KNOWN_SD_RATIO: Final = 0.6
"""Largest posterior standard deviation of a mass that the record shows, as a share of the prior one."""
RATIO_EVIDENCE_WEIGHT: Final = 0.5
"""Weight of the evidence between trains, because windows of one driver are similar: on simulated drives, the likeliest
train is then right about as often as its probability states."""
CHOICE_CERTAIN_SDS: Final = 2.0
"""Number of standard deviations of noise by which a window must exceed the train's effort to count."""
CHOICE_BEYOND_RATIO: Final = 0.02
"""Largest share of the time with too much effort in a trip that a train can have made."""
CHOICE_BEYOND_WINDOWS: Final = 3
"""Least number of windows with too much effort in a trip that a train cannot have made."""
CHOICE_HIGH_PERCENTILE: Final = 90.0
"""Percentile over the distance that counts as the high speed of a trip, and likewise of the allowed speed."""
CHOICE_SLOWER_RATIO: Final = 0.1
"""Share (the mean of an exponential distribution) by which drivers stay below what line and train allow."""
CHOICE_PLACES: Final = 500
"""Number of places along the trip at which speeds are compared."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FoundTrain:
    """A train that was tried on a trip: whether it can have made the trip, with its mass and resistance.

    `names` are trains with the same motion, as named by the user. The ratios are as in
    `das.domain.conditions.Conditions`, each with one standard deviation. `beyond_ratio` is the share of the time that
    stays unexplained, because the trip needs more effort than this train has. `why_not` is empty for a possible train.
    `evidence` is the logarithm of the probability density of the motion with this train.
    """

    names: tuple[str, ...]
    vehicle: Vehicle
    mass_ratio: float
    mass_sd: float
    resistance_ratio: float
    resistance_sd: float
    beyond_ratio: float
    evidence: float
    why_not: str = ""

    @property
    def possible(self) -> bool:
        """Whether this train can have made the trip."""
        return not self.why_not

    @property
    def fitted(self) -> Vehicle:
        """The train with the mass and the resistance that fit best."""
        return Conditions(mass_ratio=self.mass_ratio, resistance_ratio=self.resistance_ratio).train(self.vehicle)

    @property
    def mass_known(self) -> bool:
        """Whether the record shows the mass better than it is known beforehand."""
        return self.mass_sd <= RATIO_KNOWN_SD_RATIO * RATIO_MASS_SD


def candidates(text: str) -> list[tuple[str, Vehicle]]:
    """The trains of a list with commas: bundled names, files, folders of vehicle files, `all` for the bundled ones.

    Each has the name given by the user. Raises DasError or InputError for a train that cannot be used.
    """
    found: dict[str, Vehicle] = {}
    for part in (one.strip() for one in text.split(",")):
        if not part:
            raise DasError(f"--vehicles {text!r}: a name is missing, expected trains with commas between them, or all")
        names = list(catalogue("vehicles")) if part == "all" else _in_folder(Path(part)) or [part]
        found.update((name, load_vehicle(name)) for name in names if name not in found)
    return list(found.items())


def _in_folder(folder: Path) -> list[str]:
    """The vehicle files of a folder; empty if the path is no folder. Files of other kinds are left out."""
    if not folder.is_dir():
        return []
    marks = {".toml": "[vehicle]", ".json": '"rolling resistance r0"'}
    files = (one for one in sorted(folder.iterdir()) if one.suffix.lower() in marks and one.is_file())
    found = [str(one) for one in files if marks[one.suffix.lower()] in one.read_text("utf-8", errors="replace")]
    if not found:
        raise DasError(f"{folder}: no vehicle file in this folder (.toml, or .json of TTOBench)")
    return found


def find_train(trip: Trip, vehicles: Sequence[tuple[str, Vehicle]]) -> tuple[FoundTrain, ...]:
    """Try trains, each with the name that the user gave it, on a trip; possible ones first, by decreasing likelihood.

    Trains that do not differ in their motion are tried once. Raises DasError if the trip is too short.
    """
    noise_mps = speed_noise_mps(trip)
    tried = [_tried(trip, names, vehicle, noise_mps) for names, vehicle in _alike(vehicles)]
    return tuple(sorted(tried, key=lambda one: (not one.possible, -one.evidence)))


def shares(found: Iterable[FoundTrain]) -> dict[str, float]:
    """The probability of each possible train (by its first name) if one of them drove and all were equally likely."""
    possible = [one for one in found if one.possible]
    if not possible:
        return {}
    off = np.array([one.evidence for one in possible]) - max(one.evidence for one in possible)
    weights = np.exp(RATIO_EVIDENCE_WEIGHT * off)
    return {one.names[0]: float(weight) for one, weight in zip(possible, weights / weights.sum(), strict=True)}


def _alike(vehicles: Sequence[tuple[str, Vehicle]]) -> list[tuple[tuple[str, ...], Vehicle]]:
    """The vehicles; vehicles with the same motion are joined, with all their names."""
    groups: dict[Any, list[tuple[str, Vehicle]]] = {}
    for name, vehicle in vehicles:
        groups.setdefault(_motion_key(vehicle), []).append((name, vehicle))
    return [(tuple(name for name, _ in group), group[0][1]) for group in groups.values()]


def _motion_key(vehicle: Vehicle) -> tuple[Any, ...]:
    """All figures of a vehicle that decide how it moves."""
    return (
        vehicle.mass_kg,
        vehicle.rotating_mass_ratio,
        vehicle.train_length_m,
        vehicle.max_speed_mps,
        vehicle.resistance,
        vehicle.traction,
        vehicle.electric_brake,
        vehicle.friction_brake_force_n,
        vehicle.max_acceleration_mps2,
        vehicle.adhesive_mass_kg,
        vehicle.tunnel_resistance_n_per_mps2,
    )


def _tried(trip: Trip, names: tuple[str, ...], vehicle: Vehicle, noise_mps: float) -> FoundTrain:
    windows = windows_of(trip, vehicle, noise_mps)
    if len(windows) < WINDOW_LEAST:
        raise DasError(
            f"{trip.path}: too short to find its train: {len(windows)} stretches of {WINDOW_SAMPLES} s above "
            f"{SLOWEST_MPS / KMH:.0f} km/h, expected at least {WINDOW_LEAST}"
        )
    log_densities, too_much = zip(*(_fit(means, brakes_n, vehicle) for means, brakes_n in windows), strict=True)
    posterior = RATIOS.log_prior + WINDOW_WEIGHT * sum(log_densities)
    evidence = _log_sum(posterior)
    weight = np.exp(posterior - evidence)
    (mass, mass_sd), (resistance, resistance_sd) = (_moments(one, weight) for one in (RATIOS.mass, RATIOS.resistance))
    beyond = np.array(too_much)[:, posterior.argmax()]
    found = FoundTrain(
        names=names,
        vehicle=vehicle,
        mass_ratio=mass,
        mass_sd=math.hypot(mass_sd, RATIO_MODEL_SD),
        resistance_ratio=resistance,
        resistance_sd=math.hypot(resistance_sd, RATIO_MODEL_SD),
        beyond_ratio=float(beyond.mean()),
        evidence=evidence + _speed_evidence(trip, vehicle),
    )
    return replace(found, why_not=_why_not(trip, found, int(beyond.sum())))


def _why_not(trip: Trip, found: FoundTrain, beyond: int) -> str:
    """The reason why the trip is impossible for a train, or empty. `beyond` windows need more effort than it has."""
    top_mps, own_mps = held_speed_mps(trip), found.vehicle.max_speed_mps
    if top_mps > CHOICE_OVERSPEED_RATIO * own_mps:
        return f"the trip held {top_mps / KMH:.0f} km/h, this train runs {own_mps / KMH:.0f} km/h"
    if beyond >= CHOICE_BEYOND_WINDOWS and found.beyond_ratio > CHOICE_BEYOND_RATIO:
        return f"in {100 * found.beyond_ratio:.0f} % of the time the trip needs more effort than this train has"
    return ""


def held_speed_mps(trip: Trip) -> float:
    """The highest speed (m/s) that the trip held for the time over which the record is smoothed."""
    speed = np.where(trip.run.inferred, 0.0, trip.run.speed_mps)  # a speed in a gap was not measured
    held = np.lib.stride_tricks.sliding_window_view(speed, min(ESTIMATE_HELD_S, len(speed)))
    return float(held.min(axis=1).max())


def speed_noise_mps(trip: Trip) -> float:
    """The noise of the reported speeds (m/s, one standard deviation), by their median distance from the smooth run."""
    matched, run = trip.matched, trip.run
    seen = ~(matched.invalid | matched.dropout | matched.standing)
    if np.count_nonzero(seen) < WINDOW_SAMPLES:
        return WINDOW_UNMEASURED_SPEED_SD_MPS
    since_s = (matched.time_ns[seen] - run.start_time_ns) * NS - run.speed_lag_s
    off = matched.speed_mps[seen] - np.interp(since_s, run.time_s, run.speed_mps)
    return max(float(np.median(np.abs(off - np.median(off)))) / NORMAL_MAD, SPEED_SD_MPS)


def windows_of(trip: Trip, vehicle: Vehicle, noise_mps: float) -> list[tuple[MeasuredWindow, float]]:
    """The windows of the smooth run above a low speed; each overlaps half of the one before.

    A window has the full effort of the train as its force; beside it are the full brakes (N) at its mean speed.
    """
    run, samples = trip.run, WINDOW_SAMPLES
    line = LineIntegral(trip.route, vehicle, vehicle.train_length_m, speed_sd_mps=noise_mps)
    effort_n = vehicle.traction_effort_n(np.maximum(run.speed_mps, SLOWEST_MPS))
    found = []
    for first in range(0, len(run.time_s) - samples + 1, samples // 2):
        part = slice(first, first + samples)
        speed = run.speed_mps[part]
        if speed.min() < SLOWEST_MPS:
            continue
        means = line.window(run.time_s[part], run.s_m[part], speed, effort_n[part], np.zeros(samples))
        if means is not None:
            found.append((means, float(vehicle.brake_effort_n(float(speed.mean())))))
    return found


class Ratios:
    """The pairs of a mass and a resistance ratio that are tried, (pairs,), and their prior probabilities."""

    def __init__(self) -> None:
        axes = (np.linspace(low, high, RATIO_STEPS) for low, high in (RATIO_MASS_BOUNDS, RATIO_RESISTANCE_BOUNDS))
        self.mass, self.resistance = (grid.ravel() for grid in np.meshgrid(*axes))
        off = (self.mass - 1.0) / RATIO_MASS_SD, np.log(self.resistance) / RATIO_RESISTANCE_LOG_SD
        log_prior = -0.5 * (off[0] ** 2 + off[1] ** 2)
        self.log_prior = log_prior - _log_sum(log_prior)


def _fit(means: MeasuredWindow, full_brakes_n: float, train: Vehicle) -> tuple[Floats, Bools]:
    """The fit of a window to a train for every pair of ratios (pairs,), and whether it needs more than full effort.

    The fit is the logarithm of the density of the acceleration (per m/s²), a mixture of the acts of drivers: coasting
    has no force, full traction the full effort; a driver who holds a speed hardly accelerates; anything else lies
    within the effort of the train. F = µ·m·(a + line) + rotating·a + κ·(µ·c0 + c1·v + c2·v²) + q·v².
    """
    a = means.acceleration_mps2
    carried_kg = RATIOS.mass * train.mass_kg
    moved_kg = carried_kg + train.mass_kg * train.rotating_mass_ratio
    c0_n = RATIOS.mass * train.resistance.c0_n
    held_n = carried_kg * means.line_mps2 + RATIOS.resistance * (c0_n + means.moving_n) + means.tunnel_n
    force_n = moved_kg * a + held_n
    full_n = np.maximum(np.minimum(means.force_n, moved_kg * train.max_acceleration_mps2 + held_n), 1.0)
    brakes_n = np.minimum(full_brakes_n, moved_kg * WINDOW_HARDEST_BRAKING_MPS2)
    line_n = WINDOW_LINE_SD_RATIO * carried_kg * STANDARD_GRAVITY_MPS2
    sd_n = np.sqrt(moved_kg**2 * means.acceleration_variance + line_n**2)
    full_sd_n = np.sqrt(sd_n**2 + means.force_variance + (WINDOW_FULL_SD_RATIO * full_n) ** 2)
    held_sd = math.hypot(math.sqrt(means.acceleration_variance), WINDOW_HELD_SD_MPS2)
    below = _step((full_n - force_n) / full_sd_n)
    density = moved_kg * (
        SHARE_COASTING * _normal(force_n / sd_n) / sd_n
        + SHARE_FULL * _normal((force_n - full_n) / full_sd_n) / full_sd_n
    )
    density += SHARE_HELD * float(_normal(a / held_sd)) / held_sd * below
    density += SHARE_TRACTION * np.minimum(_step(force_n / sd_n), below)
    density += SHARE_BRAKING * np.minimum(_step(-force_n / sd_n), _step((force_n + brakes_n) / sd_n))
    beyond = force_n - CHOICE_CERTAIN_SDS * sd_n > ESTIMATE_BEYOND_RATIO * full_n
    return np.log(density + SHARE_UNEXPLAINED), beyond


def _normal(off: Any) -> Any:
    return np.exp(-0.5 * np.square(off)) / math.sqrt(2.0 * math.pi)


def _step(off: Floats) -> Floats:
    """Nearly the cumulative normal distribution: the logistic function is within 0.01 of it."""
    return np.asarray(1.0 / (1.0 + np.exp(-1.702 * np.clip(off, -100.0, 100.0))))


def _log_sum(logarithms: Floats) -> float:
    top = float(logarithms.max())
    return top + math.log(float(np.exp(logarithms - top).sum()))


def _moments(values: Floats, weight: Floats) -> tuple[float, float]:
    mean = float(values @ weight)
    return mean, math.sqrt(max(float((values - mean) ** 2 @ weight), 0.0))


def _speed_evidence(trip: Trip, vehicle: Vehicle) -> float:
    """The logarithm of the density of the trip's high speed, given that drivers come near the allowed speed."""
    run = trip.run
    place_m = np.linspace(run.s_m[0], run.s_m[-1], CHOICE_PLACES)
    limit = np.minimum(trip.route.limits_over_train(vehicle.train_length_m).at(place_m), vehicle.max_speed_mps)
    allowed, driven = (
        float(np.percentile(speed, CHOICE_HIGH_PERCENTILE))
        for speed in (limit, np.interp(place_m, run.s_m, run.speed_mps))
    )
    slower_ratio = CHOICE_SLOWER_RATIO
    return -max(1.0 - driven / allowed, 0.0) / slower_ratio - math.log(slower_ratio * allowed)


RATIOS: Final = Ratios()
