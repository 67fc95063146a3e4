"""Plausible limits for the values of trains and lines: they reveal a wrong unit or an extra digit.

`check_vehicle` and `check_route` reject a value beyond a limit unless the file lists that check as accepted.
`warnings_of` returns a line for each value that is unusual or was accepted. This module prints nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from das.domain.earth import steps_m
from das.domain.errors import InputError
from das.domain.route import Altitudes, Route
from das.domain.units import KM, KMH, PERMILLE, STANDARD_GRAVITY_MPS2, TONNE
from das.domain.vehicle import Vehicle

ACCEPTED = "implausible_accepted"
"""The key in a TOML file that names the checks whose limits the file's values may exceed."""
INSIST = f'to accept it, set {ACCEPTED} = ["{{check}}"] in [%s]'
"""The end of the error for an implausible value: how to accept it; `%s` is the table of the file."""
SPEEDS = 200
"""Number of speeds, from standstill to the top speed, at which efforts are checked."""
NOISE_OVER_M = 2000.0
"""Smoothing length (m) of altitudes; the part removed by smoothing is called noise."""
NOISE_CLIMB_RATIO = 0.003
"""Removed climb per length from which a line is noisy: 1 m of noise every 100 m gives 0.0055, real lines below
0.002."""
FLAT_ERROR = "energies are those of a flat line; on four real sections they were 1 to 29 % too low"
FLAT = f"no altitudes: {FLAT_ERROR} (docs/explanation/own-lines.md)"
FEW_POINTS = (
    "altitudes of a few points: with those of the stops alone, energies of four real sections were up to 11 % too low, "
    "most where a summit was missing"
)
SMOOTHED = "smoothed altitudes: noise of 4 m changed energies of four real sections by -3 to +3 %"
NOISY = "raw altitudes: noise of 4 m changed energies of four real sections by -10 to +11 %; smooth them (--smooth-m)"
"""Effect of a line's kind of altitudes on energies; the figures are from docs/explanation/own-lines.md."""


@dataclass(frozen=True, kw_only=True)
class Range:
    """A value from `least` to `most` is possible; a value outside `usual_least` to `usual_most` causes a warning."""

    least: float = 0.0
    usual_least: float = 0.0
    usual_most: float
    most: float


@dataclass(frozen=True, kw_only=True)
class VehicleLimits:
    """The limits of trains in SI units; each field has the name of its check."""

    max_deceleration: Range = Range(usual_least=0.3, usual_most=1.6, most=3.0)
    """Force of all brakes over mass, at most the train's largest deceleration (m/s²).

    Assumption: magnetic track brakes stay below 3, service brakes of passenger trains below 1.6; with less than 0.3 a
    train needs kilometres to stop."""
    max_acceleration: Range = Range(usual_least=0.01, usual_most=1.6, most=3.0)
    """Traction force over mass, at most the train's largest acceleration (m/s²).

    With all axles driven, adhesion on a dry rail limits it to 3.2 (Curtius & Kniffler 1944, at standstill). Assumption:
    metros reach 1.3."""
    mass: Range = Range(least=1e3, usual_least=1e4, usual_most=1e7, most=2e7)
    """Mass of the whole train (kg). Assumption: from a track trolley to the heaviest coal trains."""
    max_speed: Range = Range(least=1.0, usual_least=5.0, usual_most=400 * KMH, most=600 * KMH)
    """Top speed (m/s). The record of a wheeled train is 574.8 km/h (2007); none in service exceeds 400."""
    power_per_mass: Range = Range(least=0.05, usual_least=0.2, usual_most=50.0, most=150.0)
    """Traction power over mass (W/kg, the same as kW/t).

    Assumption: a heavy freight train has 0.5, a high-speed train 25, a locomotive alone up to 75.
    """
    brake_power_per_mass: Range = Range(usual_most=50.0, most=150.0)
    """Power of the electric brake over mass (W/kg). Assumption: as for traction; a train may have none."""
    resistance_per_weight: Range = Range(usual_least=0.0005, usual_most=0.1, most=1.0)
    """Running resistance at the top speed over weight.

    Assumption: 0.007 to 0.03 is usual; a resistance above the weight indicates a wrong unit."""
    rotating_mass: Range = Range(usual_most=0.3, most=0.5)
    """Rotating mass over mass. Assumption: 0.02 to 0.15 is usual, 0.3 is a light locomotive."""
    length: Range = Range(usual_most=2e3, most=1e4)
    """Length (m). Assumption: the longest train ever run was 7.4 km long; a length of 0 is a point."""


@dataclass(frozen=True, kw_only=True)
class RouteLimits:
    """The limits of lines in SI units; each field has the name of its check."""

    length: Range = Range(least=1.0, usual_least=10.0, usual_most=1e7, most=2e7)
    """Length (m), at most half the Earth's circumference; the longest line, Moscow to Vladivostok, is 9 289 km."""
    speed_limit: Range = Range(usual_least=3 * KMH, usual_most=400 * KMH, most=600 * KMH)
    """Every speed limit (m/s). The bounds are those of a train's top speed."""
    gradient: Range = Range(usual_most=0.08, most=0.2)
    """Every gradient, up or down (m/m). Assumption: no adhesion railway exceeds 120 ‰, and few exceed 80 ‰."""
    geometry_length: Range = Range(least=0.6, usual_least=0.95, usual_most=1.03, most=1.3)
    """Length of the geometry on the map over the distance of its positions.

    The chord of a 90° curve is 10 % shorter than the curve. Assumption: below 0.6 the polyline belongs to another
    line."""
    geometry_jump: Range = Range(usual_most=100.0, most=2000.0)
    """Excess (m) of the map distance between two neighbouring points over the difference of their positions. A chord is
    never longer than its track. Assumption: rounded positions explain up to 100 m."""
    geometry_missing: Range = Range(usual_most=0.02, most=0.5)
    """Share of the line before the first and after the last point of its geometry."""


class Unit(NamedTuple):
    """The unit in which messages show a value: `si` is its size in SI."""

    name: str
    si: float = 1.0


class Finding(NamedTuple):
    """A value outside its range: names of the check and of the value, value and range (SI), and unit in messages."""

    check: str
    key: str
    value: float
    range: Range
    unit: Unit

    @property
    def refused(self) -> bool:
        """Whether the value is impossible."""
        return not self.range.least <= self.value <= self.range.most

    def expected(self) -> str:
        """The possible range as text."""
        return self._bounds(self.range.least, self.range.most)

    def in_words(self) -> str:
        """The value and the usual range as text."""
        usual = self._bounds(self.range.usual_least, self.range.usual_most)
        unit = f" {self.unit.name}" if self.unit.name else ""
        return f"{self.key} = {self.shown():g}{unit}: {usual} is usual"

    def shown(self) -> float:
        """The value in the unit of messages, to four figures."""
        return float(f"{self.value / self.unit.si:.4g}")

    def _bounds(self, least: float, most: float) -> str:
        unit = f" {self.unit.name}" if self.unit.name else ""
        upper = f"at most {most / self.unit.si:g}{unit}"
        return f"{least / self.unit.si:g} to {most / self.unit.si:g}{unit}" if least > 0 else upper


_ACCELERATION, _RATIO = Unit("m/s²"), Unit("")
_VEHICLE: Mapping[str, tuple[str, Unit]] = {
    "max_deceleration": ("all brakes over mass", _ACCELERATION),
    "max_acceleration": ("traction over mass", _ACCELERATION),
    "mass": ("mass", Unit("t", TONNE)),
    "max_speed": ("max_speed", Unit("km/h", KMH)),
    "power_per_mass": ("traction power over mass", Unit("kW/t")),
    "brake_power_per_mass": ("electric brake power over mass", Unit("kW/t")),
    "resistance_per_weight": ("resistance at top speed over weight", _RATIO),
    "rotating_mass": ("rotating_mass_ratio", _RATIO),
    "length": ("length", Unit("m")),
}
_ROUTE: Mapping[str, tuple[str, Unit]] = {
    "length": ("length", Unit("km", KM)),
    "speed_limit": ("speed_limits", Unit("km/h", KMH)),
    "gradient": ("gradients", Unit("‰", PERMILLE)),
    "geometry_length": ("geometry: length on the map over that of the positions", _RATIO),
    "geometry_jump": ("geometry: map distance to the next point beyond that of the positions", Unit("m")),
    "geometry_missing": ("share of the line without geometry", _RATIO),
}
_LISTS = ("speed_limit", "gradient")
"""Checks of a list: the message names the entry."""
VEHICLE_CHECKS, ROUTE_CHECKS = tuple(_VEHICLE), tuple(_ROUTE)
"""Names of the checks that a file can accept."""


def check_vehicle(vehicle: Vehicle, accepted: Collection[str] = (), *, insist: str) -> Vehicle:
    """Return the vehicle; InputError for the first impossible value, in any load state, whose check is not accepted.

    `insist` is the end of the message: how to accept the value. `{check}` in it is replaced by the check's name.
    """
    _refuse(vehicle.source, _of_vehicle(vehicle), accepted, insist)
    return vehicle


def check_route(route: Route, accepted: Collection[str] = (), *, insist: str) -> Route:
    """Return the route; InputError for the first impossible value whose check is not accepted.

    `insist` is the end of the message: how to accept the value. `{check}` in it is replaced by the check's name.
    """
    _refuse(route.source, _of_route(route), accepted, insist)
    return route


def warnings_of(thing: Vehicle | Route) -> tuple[str, ...]:
    """The unusual values of a train or line, and for a line the possible error of energies unless its altitudes are
    well known.
    """
    if isinstance(thing, Vehicle) or thing.altitudes is Altitudes.SMOOTHED or not (energy := energy_range(thing)):
        return unusual_in(thing)
    return (*unusual_in(thing), f"{thing.source}: {energy}")


def unusual_in(thing: Vehicle | Route) -> tuple[str, ...]:
    """A line for each unusual value of a train or line: file, key, value and the usual range."""
    found = _of_vehicle(thing) if isinstance(thing, Vehicle) else _of_route(thing)
    return tuple(f"{thing.source}: {one.in_words()}" for one in found)


def energy_range(route: Route) -> str:
    """The possible error of energies on this line because of its altitudes, as text; empty if unknown.

    A line is flat if its file says so, or if all gradients are 0 and the file does not state that the real line is
    level. It is noisy if its file says that its altitudes are raw, or does not state their kind and smoothing over
    `NOISE_OVER_M` removes more than `NOISE_CLIMB_RATIO` metres of climb per metre.
    """
    kind = route.altitudes
    if kind is None and not route.gradients_ratio.value.any() and _states_its_altitudes(route):
        kind = Altitudes.NONE
    if kind is None and vanishing_climb_ratio(route) > NOISE_CLIMB_RATIO:
        kind = Altitudes.RAW
    words = {Altitudes.NONE: FLAT, Altitudes.RAW: NOISY, Altitudes.POINTS: FEW_POINTS, Altitudes.SMOOTHED: SMOOTHED}
    return "" if kind is None else words.get(kind, "")


def _states_its_altitudes(route: Route) -> bool:
    """Whether the format of the file can state that the real line is level, and the line represents a real one."""
    return route.source.lower().endswith(".toml") and not route.illustrative


def vanishing_climb_ratio(route: Route) -> float:
    """Climb per metre of line that smoothing over `NOISE_OVER_M` removes; 0 for a shorter line."""
    if route.length_m < 2 * NOISE_OVER_M:
        return 0.0
    every_m = np.arange(0.0, route.length_m - NOISE_OVER_M, NOISE_OVER_M / 40)
    inside = route.gradients_ratio.start_m
    ends = np.union1d(inside[inside < every_m[-1]], every_m)
    climbed_m = np.maximum(np.diff(route.altitude_m(ends)), 0.0).sum()
    gentle = route.gradients_ratio.mean(every_m, every_m + NOISE_OVER_M)
    return float((climbed_m - np.maximum(gentle, 0.0).sum() * NOISE_OVER_M / 40) / ends[-1])


def _refuse(source: str, findings: Iterator[Finding], accepted: Collection[str], insist: str) -> None:
    for one in findings:
        if one.refused and one.check not in accepted:
            unit = f" ({one.unit.name})" if one.unit.name else ""
            way = insist.format(check=one.check)
            raise InputError(source, f"{one.key}{unit}", one.shown(), f"{one.expected()}; {way}")


def _of_vehicle(vehicle: Vehicle) -> Iterator[Finding]:
    """The unusual values of a train, then those of its load states for checks that found nothing before."""
    known = set()
    for name, train in (("", vehicle), *((name, vehicle.loaded(name)) for name in vehicle.loads)):
        for check, value in _vehicle_values(train).items():
            words, unit = _VEHICLE[check]
            key = f"loads.{name}: {words}" if name else words
            found = Finding(check, key, value, _range(VehicleLimits(), check), unit)
            if not _is_usual(found) and (check, value) not in known:
                known.add((check, value))
                yield found


def _vehicle_values(train: Vehicle) -> dict[str, float]:
    """The value of each check, in SI."""
    speeds_mps = np.linspace(0.0, train.max_speed_mps, SPEEDS)
    brakes_mps2 = float(train.brake_effort_n(speeds_mps).max()) / train.inertial_mass_kg
    traction_mps2 = float(train.traction_effort_n(speeds_mps).max()) / train.inertial_mass_kg
    weight_n = train.mass_kg * STANDARD_GRAVITY_MPS2
    return {
        "mass": train.mass_kg,
        "rotating_mass": train.rotating_mass_ratio,
        "max_speed": train.max_speed_mps,
        "length": train.train_length_m,
        "max_deceleration": min(brakes_mps2, train.max_deceleration_mps2),
        "max_acceleration": min(traction_mps2, train.max_acceleration_mps2),
        "power_per_mass": train.traction.max_power_w / train.mass_kg,
        "brake_power_per_mass": train.electric_brake.max_power_w / train.mass_kg,
        "resistance_per_weight": float(train.resistance.force_n(train.max_speed_mps)) / weight_n,
    }


def _of_route(route: Route) -> Iterator[Finding]:
    """The unusual values of a line; for a list only the first impossible value, else the first unusual one."""
    lists = {
        "length": np.array([route.length_m]),
        "speed_limit": route.limits_mps.value,
        "gradient": np.abs(route.gradients_ratio.value),
    }
    lists |= {check: np.array([value]) for check, value in _geometry_values(route).items()}
    for check, values in lists.items():
        words, unit = _ROUTE[check]
        limits = _range(RouteLimits(), check)
        beyond = np.flatnonzero((values < limits.least) | (values > limits.most))
        unusual = np.flatnonzero((values < limits.usual_least) | (values > limits.usual_most))
        for i in (*beyond[:1], *unusual[: 0 if len(beyond) else 1]):
            key = words if len(values) == 1 and check not in _LISTS else f"{words}[{i}]"
            yield Finding(check, key, float(values[i]), limits, unit)


def _geometry_values(route: Route) -> dict[str, float]:
    """The value of each check of the geometry; empty for a line without geometry."""
    at_m = route.geometry_position_m
    if len(at_m) < 2:
        return {}
    chords_m, steps = steps_m(route.geometry_latitude_deg, route.geometry_longitude_deg), np.diff(at_m)
    covered_m = float(at_m[-1] - at_m[0])
    return {
        "geometry_jump": max(float((chords_m - steps).max()), 0.0),
        "geometry_length": float(chords_m.sum()) / covered_m,
        "geometry_missing": max(1.0 - covered_m / route.length_m, 0.0),
    }


def _range(limits: VehicleLimits | RouteLimits, check: str) -> Range:
    found: Range = getattr(limits, check)
    return found


def _is_usual(one: Finding) -> bool:
    return one.range.usual_least <= one.value <= one.range.usual_most
