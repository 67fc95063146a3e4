"""Trains from rolling stock files of OSRD (JSON): effort curves by mode and condition, and Davis' coefficients."""

from __future__ import annotations

import re
from collections.abc import Iterator

from das.domain.errors import is_seen
from das.domain.files.reading import LARGEST, MOST_OF_A_NAME, Fields, in_si
from das.domain.files.vehicles import MOST_POINTS
from das.domain.vehicle import Resistance
from precompute.vehicle_import.train import ImportedTrain, Mode, Points, number_in_si

MOST_MODES = 500
"""Largest number of modes and conditions of a rolling stock file."""
_CONDITIONS = ("comfort", "electrical_profile_level", "power_restriction_code")
_VOLTS = re.compile(r"(\d{3,6})\s*V")


def is_rolling_stock(fields: Fields) -> bool:
    """Whether a JSON file is a rolling stock file of OSRD."""
    return fields.has("effort_curves") or {"rolling_resistance", "inertia_coefficient"} <= set(fields.data)


def read_rolling_stock(fields: Fields) -> ImportedTrain:
    """The train of a rolling stock file; raises InputError (file, key, value, expectation) for anything unusable.

    The file is in kg, m, s and N. The curve of a mode without a condition has the mode's name, those with a condition
    both names: "25000V-heating-22500V-C1".
    """
    name = fields.name("name")
    curves = fields.table("effort_curves")
    given, default = dict(_modes(curves)), curves.text("default_mode")
    modes = {name: mode for name, mode in given.items() if name == default or any(force for _, force in mode.traction)}
    if default not in modes:
        raise curves.error("default_mode", default, f"one of the modes {', '.join(list(modes)[:20])}")
    inertia = number_in_si(fields, "inertia_coefficient", ("-", "ratio"))
    if not 1 <= inertia < 10:
        raise fields.error("inertia_coefficient", inertia, "a number from 1 to 10")
    version = fields.name("railjson_version", "unknown")
    return ImportedTrain(
        id=name,
        name=name,
        source=f"{fields.source.name} (OSRD rolling stock, version {version})",
        mass_kg=number_in_si(fields, "mass", ("kg", "mass")),
        rotating_mass_ratio=inertia - 1.0,
        length_m=number_in_si(fields, "length", ("m", "length")),
        max_speed_mps=number_in_si(fields, "max_speed", ("m/s", "speed")),
        resistance=_resistance(fields.table("rolling_resistance")),
        modes={default: modes[default], **modes},
        deceleration_mps2=_gamma(fields),
        notes=(
            *_notes(fields),
            *(f"the mode {name} is left out: it has no force" for name in given if name not in modes),
        ),
    )


def _notes(fields: Fields) -> Iterator[str]:
    yield "the file gives no losses and no electric brake"
    yield "gamma is used both as the service deceleration and as that of all brakes together"
    unused = [
        f"{key} = {fields.data[key]:g}"
        for key in ("comfort_acceleration", "startup_acceleration", "startup_time")
        if isinstance(fields.data.get(key), int | float) and abs(fields.data[key]) < LARGEST
    ]
    if unused:
        yield f"the effort curve alone limits the acceleration; not used: {', '.join(unused)}"


def _resistance(fields: Fields) -> Resistance:
    if fields.text("type", "davis") != "davis":
        raise fields.error("type", fields.data["type"], "davis")
    return Resistance(
        c0_n=number_in_si(fields, "A", ("N", "force")),
        c1_n_per_mps=number_in_si(fields, "B", ("N/(m/s)", "resistance_1")),
        c2_n_per_mps2=number_in_si(fields, "C", ("N/(m/s)^2", "resistance_2")),
    )


def _gamma(fields: Fields) -> float:
    """The braking deceleration (m/s²): a number (`const_gamma`), or the value of the table `gamma`."""
    if fields.has("const_gamma"):
        return abs(number_in_si(fields, "const_gamma", ("m/s^2", "acceleration")))
    return abs(number_in_si(fields.table("gamma"), "value", ("m/s^2", "acceleration")))


def _modes(fields: Fields) -> Iterator[tuple[str, Mode]]:
    """Every mode by its name, first with its curve for any condition, then with the curve of each condition."""
    modes = fields.table("modes")
    modes.check_count("modes", list(modes.data), MOST_MODES)
    for name in modes.data:
        mode = modes.table(name)
        yield _named(modes, name), Mode(_points(mode.table("default_curve")), voltage_v=_volts(name))
        entries = mode.data.get("curves", [])
        if not isinstance(entries, list):
            raise mode.error("curves", entries, "a list of curves with their conditions")
        mode.check_count("curves", entries, MOST_MODES)
        for i, entry in enumerate(entries):
            one = Fields.of(mode.source, entry, f"{mode.prefix}curves[{i}].")
            words = [one.optional_table("cond").data.get(key) for key in _CONDITIONS]
            said = [word.lower() if word == words[0] else word for word in words if isinstance(word, str)]
            if said:
                volts = _volts(words[1]) if isinstance(words[1], str) else None
                points = _points(one.table("curve"))
                yield _named(mode, "-".join([name, *said])), Mode(points, voltage_v=volts or _volts(name))


def _named(fields: Fields, name: str) -> str:
    if not name or not is_seen(name) or len(name) > MOST_OF_A_NAME:
        raise fields.error("name of a mode", name, f"1 to {MOST_OF_A_NAME} characters without control characters")
    return name


def _volts(name: str) -> float | None:
    found = _VOLTS.fullmatch(name)
    return float(found[1]) if found else None


def _points(fields: Fields) -> Points:
    speeds, efforts = (fields.rows(key, "a list of numbers", MOST_POINTS) for key in ("speeds", "max_efforts"))
    if len(speeds) != len(efforts):
        raise fields.error("max_efforts", f"{len(efforts)} numbers", f"{len(speeds)} numbers, one per speed")
    return tuple(
        (
            in_si(fields.source, f"{fields.prefix}speeds[{i}]", speed, ("m/s", "speed")),
            in_si(fields.source, f"{fields.prefix}max_efforts[{i}]", effort, ("N", "force")),
        )
        for i, (speed, effort) in enumerate(zip(speeds, efforts, strict=True))
    )
