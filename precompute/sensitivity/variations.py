"""What a plan may meet instead of what it was made for: one parameter at a time."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from das.domain.conditions import Conditions
from das.domain.errors import DasError
from das.domain.units import KMH, PERCENT


class Parameter(StrEnum):
    """What differs from the plan."""

    MASS = "mass"
    RESISTANCE = "resistance"
    WIND = "wind"
    RECEPTIVITY = "receptivity"
    ADHESION = "adhesion"


RELATIVE = (Parameter.MASS, Parameter.RESISTANCE)
"""Varied in % of the plan's value; the others are given as values in place of the plan's."""
RANGE_VALUES = 5
"""Values of a range a..b, evenly from one end to the other."""
_FIELDS = {
    Parameter.MASS: "mass_ratio",
    Parameter.RESISTANCE: "resistance_ratio",
    Parameter.WIND: "head_wind_mps",
    Parameter.RECEPTIVITY: "receptivity_ratio",
    Parameter.ADHESION: "adhesion_ratio",
}
_NUMBER = r"[+\-−]?\d*\.?\d+"
_RANGE = re.compile(rf"({_NUMBER})\.\.({_NUMBER})")
_BOTH_WAYS = re.compile(r"(?:±|\+/?-)(\d*\.?\d+)")


@dataclass(frozen=True, kw_only=True)
class Variation:
    """One parameter that differs from the plan.

    `value`: change in % of the plan's (mass, resistance), head wind in km/h, or ratio (receptivity, adhesion). `step`:
    by how much that differs from the plan, in % (receptivity and adhesion: points of 1 %) or km/h. `conditions`: all
    that holds then.
    """

    parameter: Parameter
    value: float
    step: float
    conditions: Conditions

    @classmethod
    def of(cls, plan: Conditions, parameter: Parameter, value: float) -> Variation:
        """A parameter of a plan changed to (or by) a value; DasError where it cannot be."""
        planned = getattr(plan, _FIELDS[parameter])
        if parameter in RELATIVE:
            changed, step = planned * (1 + value * PERCENT), value
        elif parameter is Parameter.WIND:
            changed, step = value * KMH, value - planned / KMH
        else:
            changed, step = value, (value - planned) / PERCENT
        conditions = replace(plan, **{_FIELDS[parameter]: changed})
        return cls(parameter=parameter, value=value, step=0.0 if conditions == plan else step, conditions=conditions)

    @property
    def unit(self) -> str:
        """The unit of `step`."""
        return "km/h" if self.parameter is Parameter.WIND else "%"

    @property
    def label(self) -> str:
        if self.parameter is Parameter.WIND:
            return f"{'tail' if self.value < 0 else 'head'} wind {abs(self.value):g} km/h"
        return (
            f"{self.parameter} {self.value:+g} %" if self.parameter in RELATIVE else f"{self.parameter} {self.value:g}"
        )


def parse_variations(text: str, plan: Conditions) -> list[Variation]:
    """The variations of `mass=±5%,±10%,wind=-20..20,…`: values, ± both ways, ranges a..b; each once.

    A range leaves out what the plan has. Raises DasError for what cannot be read or cannot be.
    """
    found: dict[tuple[Parameter, float], Variation] = {}
    parameter = None
    for part in text.replace(" ", "").split(","):
        name, given, values = part.rpartition("=")
        if given:
            parameter = _parameter(text, name)
        if parameter is None:
            raise _unreadable(text, part)
        for value in _values(text, parameter, values):
            variation = _variation(text, plan, parameter, value)
            if ".." not in values or variation.conditions != plan:
                found.setdefault((parameter, value), variation)
    if not found:
        raise DasError(f"--vary {text}: nothing that differs from the plan")
    return list(found.values())


def _variation(text: str, plan: Conditions, parameter: Parameter, value: float) -> Variation:
    try:
        return Variation.of(plan, parameter, value)
    except DasError as error:
        raise DasError(f"--vary {text}: {error}") from None


def _parameter(text: str, name: str) -> Parameter:
    if name not in list(Parameter):
        raise DasError(f"--vary {text}: no parameter {name!r}; expected one of {', '.join(Parameter)}")
    return Parameter(name)


def _values(text: str, parameter: Parameter, values: str) -> list[float]:
    relative = parameter in RELATIVE
    plain = values.removesuffix("%")
    if relative is not values.endswith("%"):
        unit = "a change in %, like ±10%" if relative else "a value without %, like 0.5"
        raise DasError(f"--vary {text}: {parameter}={values}: expected {unit}")
    if both := _BOTH_WAYS.fullmatch(plain):
        size = float(both[1])
        return [-size, size]
    if ends := _RANGE.fullmatch(plain):
        first, last = (_number(end) for end in ends.groups())
        return [float(value) for value in np.linspace(first, last, RANGE_VALUES)]
    if not re.fullmatch(_NUMBER, plain):
        raise _unreadable(text, f"{parameter}={values}")
    return [_number(plain)]


def _number(text: str) -> float:
    return float(text.replace("−", "-"))


def _unreadable(text: str, part: str) -> DasError:
    return DasError(
        f"--vary {text}: cannot read {part!r}; expected something like mass=±10%,wind=-20..20,receptivity=0.5"
    )
