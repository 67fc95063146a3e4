"""Plausible limits for the values of trains and lines: they reveal a wrong unit or an extra digit.

`checked` rejects a value beyond a limit unless the file lists that check as accepted.
`warnings_of` returns a line for each value that is unusual or was accepted. This module prints nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Final, NamedTuple, TypeVar

import numpy as np

from das.domain.earth import steps_m
from das.domain.errors import InputError
from das.domain.route import Altitudes, Route
from das.domain.units import KM, KMH, PERMILLE, STANDARD_GRAVITY_MPS2, TONNE
from das.domain.vehicle import Vehicle

_Thing = TypeVar("_Thing", Vehicle, Route)

ACCEPTED = "implausible_accepted"
"""The key in a TOML file that names the checks whose limits the file's values may exceed."""
INSIST = f'to accept it, set {ACCEPTED} = ["{{check}}"] in [%s]'
"""The end of the error for an implausible value: how to accept the value; `%s` is the table of the file."""
SPEEDS = 200
"""Number of speeds, from standstill to the top speed, at which efforts are checked."""
NOISE_OVER_M = 2000.0
"""Smoothing length (m) of altitudes; the part removed by smoothing is called noise."""
NOISE_CLIMB_RATIO = 0.003
"""Climb removed by smoothing, per length, above which a line is noisy: 1 m of noise every 100 m gives 0.0055, real
lines give less than 0.002."""
FLAT_ERROR = "energies are those of a flat line; on four real sections they were 1 to 29 % too low"
FLAT = f"no altitudes: {FLAT_ERROR} (docs/explanation/own-lines.md)"
FEW_POINTS = (
    "altitudes of a few points: with those of the stops alone, energies of four real sections were up to 11 % too low, "
    "most where a summit was missing"
)
SMOOTHED = "smoothed altitudes: noise of 4 m changed energies of four real sections by -3 to +3 %"
NOISY = "raw altitudes: noise of 4 m changed energies of four real sections by -10 to +11 %; smooth them (--smooth-m)"
"""Effect of a line's kind of altitudes on energies; the figures are from docs/explanation/own-lines.md."""


class Check(NamedTuple):
    """The name of a value in messages, its unit there with the factor to SI, and the ranges (SI) of the value.

    A value outside `possible` is refused, one outside `usual` causes a warning.
    """

    words: str
    unit: str
    si: float
    possible: tuple[float, float]
    usual: tuple[float, float]


OF_VEHICLES: Final = {
    # Assumption: magnetic track brakes stay below 3, service brakes of passenger trains below 1.6; with less than 0.3 a
    # train needs kilometres to stop. At most the train's largest deceleration.
    "max_deceleration": Check("all brakes over mass", "m/s²", 1.0, (0.0, 3.0), (0.3, 1.6)),
    # With all axles driven, adhesion on a dry rail limits it to 3.2 (Curtius & Kniffler 1944, at standstill).
    # Assumption: metros reach 1.3. At most the train's largest acceleration.
    "max_acceleration": Check("traction over mass", "m/s²", 1.0, (0.0, 3.0), (0.01, 1.6)),
    # Mass of the whole train. Assumption: from a track trolley to the heaviest coal trains.
    "mass": Check("mass", "t", TONNE, (1e3, 2e7), (1e4, 1e7)),
    # The record of a wheeled train is 574.8 km/h (2007); none in service exceeds 400.
    "max_speed": Check("max_speed", "km/h", KMH, (1.0, 600 * KMH), (5.0, 400 * KMH)),
    # Assumption: a heavy freight train has 0.5, a high-speed train 25, a locomotive alone up to 75.
    "power_per_mass": Check("traction power over mass", "kW/t", 1.0, (0.05, 150.0), (0.2, 50.0)),
    # Assumption: as for traction; a train may have none.
    "brake_power_per_mass": Check("electric brake power over mass", "kW/t", 1.0, (0.0, 150.0), (0.0, 50.0)),
    # Assumption: 0.007 to 0.03 is usual; a resistance above the weight indicates a wrong unit.
    "resistance_per_weight": Check("resistance at top speed over weight", "", 1.0, (0.0, 1.0), (0.0005, 0.1)),
    # Assumption: 0.02 to 0.15 is usual, 0.3 is a light locomotive.
    "rotating_mass": Check("rotating_mass_ratio", "", 1.0, (0.0, 0.5), (0.0, 0.3)),
    # Assumption: the longest train ever run was 7.4 km long; a length of 0 is a point.
    "length": Check("length", "m", 1.0, (0.0, 1e4), (0.0, 2e3)),
}
"""The checks of trains by name."""
_OF_GEOMETRY = "geometry: length on the map over that of the positions"
_OF_JUMPS = "geometry: map distance to the next point beyond that of the positions"
OF_ROUTES: Final = {
    # At most half the Earth's circumference; the longest line, Moscow to Vladivostok, is 9 289 km.
    "length": Check("length", "km", KM, (1.0, 2e7), (10.0, 1e7)),
    # Every speed limit. The bounds are the same as for a train's top speed.
    "speed_limit": Check("speed_limits", "km/h", KMH, (0.0, 600 * KMH), (3 * KMH, 400 * KMH)),
    # Every gradient, up or down. Assumption: no adhesion railway exceeds 120 ‰, and few exceed 80 ‰.
    "gradient": Check("gradients", "‰", PERMILLE, (0.0, 0.2), (0.0, 0.08)),
    # The chord of a 90° curve is 10 % shorter than the curve. Assumption: below 0.6 the polyline belongs to another
    # line.
    "geometry_length": Check(_OF_GEOMETRY, "", 1.0, (0.6, 1.3), (0.95, 1.03)),
    # Between neighbouring points. A chord is never longer than its track. Assumption: rounded positions explain up to
    # 100 m.
    "geometry_jump": Check(_OF_JUMPS, "m", 1.0, (0.0, 2000.0), (0.0, 100.0)),
    # Before the first and after the last point of the geometry.
    "geometry_missing": Check("share of the line without geometry", "", 1.0, (0.0, 0.5), (0.0, 0.02)),
}
"""The checks of lines by name."""
_LISTS = ("speed_limit", "gradient")
"""Checks of a list: the message names the entry."""
VEHICLE_CHECKS, ROUTE_CHECKS = tuple(OF_VEHICLES), tuple(OF_ROUTES)
"""Names of the checks that a file can accept."""


class Finding(NamedTuple):
    """A value outside its usual range: the name of its check, the check, its name in messages, and the value (SI)."""

    name: str
    check: Check
    key: str
    value: float

    def in_words(self) -> str:
        """The value and the usual range as text."""
        unit = self.check.unit
        return f"{self.key} = {self.shown():g}{unit and f' {unit}'}: {self.bounds(self.check.usual)} is usual"

    def shown(self) -> float:
        """The value in the unit of messages, to four figures."""
        return float(f"{self.value / self.check.si:.4g}")

    def bounds(self, ends: tuple[float, float]) -> str:
        """A range (SI) as text."""
        least, most = (end / self.check.si for end in ends)
        upper = f"{most:g}{self.check.unit and f' {self.check.unit}'}"
        return f"{least:g} to {upper}" if least > 0 else f"at most {upper}"


def checked(thing: _Thing, accepted: Collection[str] = (), *, insist: str) -> _Thing:
    """The vehicle or route; InputError for the first impossible value whose check is not accepted.

    A vehicle is checked in every load state. `insist` is the end of the message: how to accept the value. `{check}` in
    it is replaced by the check's name.
    """
    for one in _findings(thing):
        least, most = one.check.possible
        if not least <= one.value <= most and one.name not in accepted:
            unit = f" ({one.check.unit})" if one.check.unit else ""
            expected = f"{one.bounds(one.check.possible)}; {insist.format(check=one.name)}"
            raise InputError(thing.source, f"{one.key}{unit}", one.shown(), expected)
    return thing


def warnings_of(thing: Vehicle | Route) -> tuple[str, ...]:
    """The unusual values of a train or line and, if altitudes are uncertain, the possible error of energies."""
    if isinstance(thing, Vehicle) or thing.altitudes is Altitudes.SMOOTHED or not (energy := energy_range(thing)):
        return unusual_in(thing)
    return (*unusual_in(thing), f"{thing.source}: {energy}")


def unusual_in(thing: Vehicle | Route) -> tuple[str, ...]:
    """A line for each unusual value of a train or line: file, key, value and the usual range."""
    return tuple(f"{thing.source}: {one.in_words()}" for one in _findings(thing))


def energy_range(route: Route) -> str:
    """The possible error of energies on this line because of its altitudes, as text; empty if unknown.

    A line is flat if its file says so, or if all gradients are 0 and the file does not state that the real line is
    level. It is noisy if its file says that its altitudes are raw, or does not state their kind and smoothing over
    `NOISE_OVER_M` removes more than `NOISE_CLIMB_RATIO` metres of climb per metre.
    """
    kind = route.altitudes
    may_be_level = route.illustrative or not route.source.lower().endswith(".toml")  # other formats cannot state it
    if kind is None and not route.gradients_ratio.value.any() and not may_be_level:
        kind = Altitudes.NONE
    if kind is None and vanishing_climb_ratio(route) > NOISE_CLIMB_RATIO:
        kind = Altitudes.RAW
    words = {Altitudes.NONE: FLAT, Altitudes.RAW: NOISY, Altitudes.POINTS: FEW_POINTS, Altitudes.SMOOTHED: SMOOTHED}
    return "" if kind is None else words.get(kind, "")


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


def _findings(thing: Vehicle | Route) -> Iterator[Finding]:
    return _of_vehicle(thing) if isinstance(thing, Vehicle) else _of_route(thing)


def _of_vehicle(vehicle: Vehicle) -> Iterator[Finding]:
    """The unusual values of a train, then of its load states for checks that found nothing so far."""
    known = set()
    for name, train in (("", vehicle), *((name, vehicle.loaded(name)) for name in vehicle.loads)):
        for of, value in _vehicle_values(train).items():
            check = OF_VEHICLES[of]
            if not check.usual[0] <= value <= check.usual[1] and (of, value) not in known:
                known.add((of, value))
                yield Finding(of, check, f"loads.{name}: {check.words}" if name else check.words, value)


def _vehicle_values(train: Vehicle) -> dict[str, float]:
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
    for name, values in lists.items():
        check = OF_ROUTES[name]
        beyond, unusual = (np.flatnonzero((values < a) | (values > b)) for a, b in (check.possible, check.usual))
        for i in (*beyond[:1], *unusual[: 0 if len(beyond) else 1]):
            yield Finding(name, check, f"{check.words}[{i}]" if name in _LISTS else check.words, float(values[i]))


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
