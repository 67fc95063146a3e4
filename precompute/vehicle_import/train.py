"""A train from a foreign file, and its vehicle file with the origin of the figures and the assumptions.

Quantities that state their units are read here.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from das.domain.errors import MISSING, DasError, InputError, seen
from das.domain.files.load import load_vehicle
from das.domain.files.reading import LARGEST, Fields, in_si
from das.domain.files.writing import toml_string
from das.domain.formulary import largest_power_w
from das.domain.levels import Level
from das.domain.losses import EfficiencyLoss
from das.domain.units import FACTORS, KMH, KN, PERMILLE, STANDARD_GRAVITY_MPS2, TONNE, to_si
from das.domain.vehicle import Load, Resistance

EXAMPLES = {
    "mass": "440 t or 68000 kg",
    "length": "200 m",
    "speed": "160 km/h or 44.4 m/s",
    "acceleration": "0.7 m/s^2",
    "ratio": "6 % or 0.06",
    "force": "200 kN, 20000 daN or 200000 N",
}
"""Examples of quantities with their units, by dimension, for messages."""

LONGEST = 200
"""Longest text (characters) of a figure or of a column's name; matching time grows with its square."""
_FIGURE = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?)\s*(.*?)\s*")
_TERM = re.compile(
    r"(?P<force>kN|daN|N|‰|permille|permil)(?:/(?P<mass>t|kg))?"
    r"(?:/(?P<speed>km/h|kmh|m/s|mps)(?P<square>\^?2)?|/(?P<inverse>s/m|s\^?2/m\^?2))?"
)
_TERMS = (
    "N, kN, daN, N/t or ‰",
    "N/(km/h), kN/(m/s), N/t/(km/h) or ‰/(km/h)",
    "N/(km/h)^2, kN/(m/s)^2 or N/t/(km/h)^2",
)


def number_in_si(fields: Fields, key: str, unit: tuple[str, str], default: float | None = None) -> float:
    """The number under a key, in SI, from the unit that the format prescribes; InputError as for `in_si`."""
    value = fields.data.get(key, MISSING if default is None else default)
    return in_si(fields.source, fields.prefix + key, value, unit)


def known_unit(unit: str, dimension: str) -> str | None:
    """A unit as spelled in the tables of `das.domain.units`, ignoring case; None if it is unknown."""
    unit = unit.strip().replace("²", "^2")
    return next((one for one in (unit, unit.lower()) if one in FACTORS[dimension]), None)


def quantity(source: str | Path, key: str, value: str, dimension: str) -> float:
    """A quantity with a unit, in SI; InputError (source, key, value, expectation) for other texts."""
    figure, unit = _parts(value)
    known = known_unit(unit or ("-" if dimension == "ratio" else ""), dimension)
    if figure is None or known is None:
        raise InputError(source, key, value, f"a number with its unit, like {EXAMPLES[dimension]}")
    return _checked(source, key, value, to_si(figure, known, dimension))


def resistance_term(source: str | Path, key: str, value: str, order: int, mass_kg: float) -> float:
    """A coefficient of Davis' formula (N, N/(m/s) or N/(m/s)² for the order 0, 1 or 2) from a figure with its unit.

    A coefficient per mass or in permille of the weight is multiplied by the mass. Raises InputError for anything else.
    """
    figure, unit = _parts(value)
    plain = re.sub(r"[·*]", "/", unit.replace("²", "^2").replace(" ", "")).replace("(", "").replace(")", "")
    found = _TERM.fullmatch(plain)
    if figure is None or found is None or _order(found) != order:
        raise InputError(source, key, value, f"a number with its unit ({_TERMS[order]})")
    if found["force"] in FACTORS["force"]:
        factor = FACTORS["force"][found["force"]]
        factor *= mass_kg / FACTORS["mass"][found["mass"]] if found["mass"] else 1.0
    elif found["mass"]:
        raise InputError(source, key, value, "permille of the weight, not per mass")
    else:
        factor = PERMILLE * STANDARD_GRAVITY_MPS2 * mass_kg
    speed = FACTORS["speed"][found["speed"]] if found["speed"] else 1.0
    return _checked(source, key, value, figure * factor / speed**order)


def _checked(source: str | Path, key: str, value: str, result: float) -> float:
    if not abs(result) <= LARGEST:
        raise InputError(source, key, value, f"a number of at most {LARGEST:g} in SI units")
    return result


def _order(found: re.Match[str]) -> int:
    if found["inverse"]:
        return 1 if found["inverse"] == "s/m" else 2
    return 0 if not found["speed"] else 2 if found["square"] else 1


def _parts(value: str) -> tuple[float | None, str]:
    found = _FIGURE.fullmatch(value) if len(value) <= LONGEST else None
    return (float(found[1]), found[2]) if found else (None, "")


STEEPEST_RATIO = 0.04
"""Steepest descent on which the assumed friction brake reaches the train's deceleration."""
LOSSLESS = "lossless"
_WORDS_APART = re.compile(r"[\s/]+")
Points = tuple[tuple[float, float], ...]
"""The points of an effort curve: speed (m/s) and force (N)."""


class Mode(NamedTuple):
    """The efforts of a train in one mode, as given by a foreign file."""

    traction: Points
    electric_brake: Points = ()
    voltage_v: float | None = None


@dataclass(frozen=True, kw_only=True)
class ImportedTrain:
    """A train as described by a foreign file, in SI units, without losses.

    `modes` holds its efforts by name, the default mode first; a train with one mode may call it "". `notes` are the
    assumptions, and the unused data of the file. `empty` is the train without its load, if `mass_kg` includes one.
    """

    id: str
    name: str
    source: str
    mass_kg: float
    rotating_mass_ratio: float
    length_m: float
    max_speed_mps: float
    resistance: Resistance
    modes: Mapping[str, Mode]
    deceleration_mps2: float
    notes: tuple[str, ...] = ()
    empty: Load | None = None

    @property
    def default(self) -> str:
        """The default mode of the train."""
        return next(iter(self.modes))

    @property
    def power_w(self) -> float:
        """The largest power (W) of traction in the default mode."""
        speeds_mps, forces_n = np.array(self.modes[self.default].traction).T
        with np.errstate(all="ignore"):  # Speeds that do not rise are rejected when the file is read.
            return largest_power_w(speeds_mps, forces_n)

    def with_electric_brake(self, ratio: float) -> ImportedTrain:
        """The train with an electric brake of this share of its traction in each mode that had none."""
        braked = {
            name: mode
            if mode.electric_brake
            else mode._replace(electric_brake=tuple((v, ratio * f) for v, f in mode.traction))
            for name, mode in self.modes.items()
        }
        note = f"the electric brake has {ratio:g} times the force of the traction at each speed (--electric-brake)"
        return replace(self, modes=braked, notes=(*self.notes, note))

    def up_to_its_speed(self) -> ImportedTrain:
        """The train with every effort curve from standstill to the top speed, at constant force beyond its ends."""
        curves = [points for mode in self.modes.values() for points in (mode.traction, mode.electric_brake) if points]
        first_mps, last_mps = max(points[0][0] for points in curves), min(points[-1][0] for points in curves)
        notes, held = list(self.notes), "where a curve {}, the force is that of its {} point"
        if first_mps > 0:
            notes.append(f"below {first_mps / KMH:.4g} km/h, {held.format('begins', 'first')}")
        if last_mps < self.max_speed_mps * (1 - 1e-9):
            notes.append(f"beyond {last_mps / KMH:.4g} km/h, {held.format('ends', 'last')}")
        modes = {
            name: mode._replace(
                traction=_extended(mode.traction, self.max_speed_mps),
                electric_brake=_extended(mode.electric_brake, self.max_speed_mps),
            )
            for name, mode in self.modes.items()
        }
        return replace(self, modes=modes, notes=tuple(notes))


def _extended(points: Points, top_mps: float) -> Points:
    """The points, extended to standstill and to the top speed if necessary, without duplicates."""
    points = tuple(dict.fromkeys(points))
    before = ((0.0, points[0][1]),) if points and points[0][0] > 0 else ()
    behind = ((top_mps, points[-1][1]),) if points and points[-1][0] < top_mps * (1 - 1e-9) else ()
    return (*before, *points, *behind)


class NamedLosses(NamedTuple):
    """The losses that the user names for a train: the lines of their tables, and their origin."""

    lines: tuple[str, ...]
    note: str


def named_losses(name: str, power_w: float) -> NamedLosses:
    """The losses that `--losses` names, for a train of a power (W): lossless, an efficiency, or those of a vehicle.

    From a vehicle, the two efficiencies or the mean efficiency are used (levels own, l2 or l1), and its idle power,
    scaled by the traction power. Raises DasError for any other name.
    """
    if name == LOSSLESS:
        return NamedLosses(("[losses]",), "no losses (--losses lossless): energies are those at the wheel")
    try:
        efficiency = float(name)
    except ValueError:
        return _losses_of(name, power_w)
    if not 0 < efficiency <= 1:
        raise DasError(f"--losses {name}: expected a mean efficiency above 0 and at most 1, lossless, or a vehicle")
    lines = ("[losses.l1]", f"mean_efficiency_ratio = {efficiency!r}")
    return NamedLosses(lines, f"the mean efficiency of the traction chain is {efficiency:g} (--losses)")


def _losses_of(name: str, power_w: float) -> NamedLosses:
    try:
        vehicle = load_vehicle(name)
    except DasError as error:
        raise DasError(
            f"--losses {name}: expected lossless, a mean efficiency like 0.85, or the vehicle whose efficiency the "
            f"train has ({error})"
        ) from None
    for level in (Level.OWN, Level.L2, Level.L1):
        with suppress(DasError):
            loss = vehicle.loss_model(level)
            if isinstance(loss, EfficiencyLoss):
                driving, braking = 1.0 / (1.0 + loss.traction_ratio), 1.0 - loss.brake_ratio
                idle_kw = loss.idle_w * power_w / vehicle.traction.max_power_w / KN
                ratios = f"traction_efficiency_ratio = {driving:.6g}", f"brake_efficiency_ratio = {braking:.6g}"
                scaled = f"{vehicle.id} (level {level}), the idle power scaled by the traction's"
                note = f"efficiency and idle power are those of {scaled}"
                return NamedLosses(("[losses.own]", *ratios, f"idle_kw = {idle_kw:.6g}"), note)
    raise DasError(f"--losses {vehicle.id}: it has no efficiency (levels own, l2 or l1)")


def vehicle_text(train: ImportedTrain, losses: NamedLosses, accepted: Sequence[str]) -> str:
    """The vehicle file of a train: its source and command, the assumptions, and its figures."""
    head = [f"# {train.name}. Made by das-precompute vehicle import from {train.source}."]
    head += [f"# Note: {note}." for note in (*train.notes, losses.note)]
    return "\n".join([*map(seen, head), "", *_body(train, accepted), *losses.lines]) + "\n"


def _body(train: ImportedTrain, accepted: Sequence[str]) -> Iterator[str]:
    yield from ("schema_version = 1", "", "[vehicle]", f"id = {_quoted(_WORDS_APART.sub('-', train.id))}")
    yield from (f"name = {_quoted(train.name)}", f"source = {_quoted(train.source)}")
    if accepted:
        yield f"implausible_accepted = [{', '.join(map(_quoted, accepted))}]"
    if train.default:
        yield f"default_mode = {_quoted(train.default)}"
    figures = {"mass_t": train.mass_kg / TONNE, "rotating_mass_ratio": train.rotating_mass_ratio}
    figures |= {"length_m": train.length_m, "max_speed_kmh": train.max_speed_mps / KMH}
    yield from (f"{key} = {_number(x)}" for key, x in figures.items())
    yield from (f"max_deceleration_mps2 = {_number(train.deceleration_mps2)}", "", "[resistance]")
    yield from (f"{key} = {_number(x)}" for key, x in vars(train.resistance).items())
    yield from ("", "[service_brake]", f"deceleration_mps2 = {_number(train.deceleration_mps2)}", "")
    inertial_kg = train.mass_kg * (1 + train.rotating_mass_ratio)
    rubs_n = inertial_kg * train.deceleration_mps2 + train.mass_kg * STANDARD_GRAVITY_MPS2 * STEEPEST_RATIO
    yield f"[friction_brake]  # assumed: enough for the deceleration on a descent of {STEEPEST_RATIO * 1000:g} ‰"
    yield from (f"max_force_kn = {_number(rubs_n / KN)}", "")
    if train.empty is not None:
        yield from ("[loads.empty]", f"mass_t = {_number(train.empty.mass_kg / TONNE)}")
        yield from (f"c0_n = {_number(train.empty.c0_n or 0.0)}", "")
    if list(train.modes) == [""]:
        yield from _efforts("", train.modes[""])
        return
    for name, mode in train.modes.items():
        prefix = f"modes.{_quoted(name)}"
        yield f"[{prefix}]"
        if mode.voltage_v is not None:
            yield f"voltage_v = {_number(mode.voltage_v)}"
        yield ""
        yield from _efforts(f"{prefix}.", mode)


def _efforts(prefix: str, mode: Mode) -> Iterator[str]:
    for table, points in (("traction", mode.traction), ("electric_brake", mode.electric_brake)):
        if points:
            yield from (f"[{prefix}{table}.curve]", 'columns = ["speed_kmh", "force_kn"]', "rows = [")
            yield from (f"  [{_number(v / KMH)}, {_number(f / KN)}]," for v, f in points)
            yield from ("]", "")


def _quoted(text: str) -> str:
    return toml_string(seen(text))


def _number(value: float) -> str:
    return f"{value + 0.0:.10g}"
