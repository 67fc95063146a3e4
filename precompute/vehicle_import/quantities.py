"""Figures in SI: numbers whose unit a format fixes, and text with a unit ("440 t", "2.1 N/t", "0.02 kN/(km/h)")."""

from __future__ import annotations

import re
from pathlib import Path

from das.domain.errors import MISSING, InputError
from das.domain.files.reading import LARGEST, Fields, in_si
from das.domain.units import FACTORS, PERMILLE, STANDARD_GRAVITY_MPS2, to_si

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
"""Longest text (characters) of a figure or of a column's name; the time of the patterns grows with its square."""
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
    """The number under a key, of the unit and dimension that its format fixes, in SI; InputError as for `in_si`."""
    value = fields.data.get(key, MISSING if default is None else default)
    return in_si(fields.source, fields.prefix + key, value, unit)


def known_unit(unit: str, dimension: str) -> str | None:
    """A unit as spelled in the tables of `das.domain.units`, ignoring case; None if it is unknown."""
    unit = unit.strip().replace("²", "^2")
    return next((one for one in (unit, unit.lower()) if one in FACTORS[dimension]), None)


def quantity(source: str | Path, key: str, value: object, dimension: str) -> float:
    """A quantity with a unit, in SI; InputError (source, key, value, expectation) if the text is none."""
    figure, unit = _parts(value)
    known = known_unit(unit or ("-" if dimension == "ratio" else ""), dimension)
    if figure is None or known is None:
        raise InputError(source, key, value, f"a number with its unit, like {EXAMPLES[dimension]}")
    return _checked(source, key, value, to_si(figure, known, dimension))


def resistance_term(source: str | Path, key: str, value: object, order: int, mass_kg: float) -> float:
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


def _checked(source: str | Path, key: str, value: object, result: float) -> float:
    if not abs(result) <= LARGEST:
        raise InputError(source, key, value, f"a number of at most {LARGEST:g} in SI units")
    return result


def _order(found: re.Match[str]) -> int:
    if found["inverse"]:
        return 1 if found["inverse"] == "s/m" else 2
    return 0 if not found["speed"] else 2 if found["square"] else 1


def _parts(value: object) -> tuple[float | None, str]:
    """A number and its unit; None for any other text."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value) if abs(value) <= LARGEST else None, ""
    found = _FIGURE.fullmatch(value) if isinstance(value, str) and len(value) <= LONGEST else None
    return (float(found[1]), found[2]) if found else (None, "")
