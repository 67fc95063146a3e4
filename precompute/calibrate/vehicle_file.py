"""Writing calibrated parameters into a copy of a bundled vehicle's file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from das.domain.errors import DasError
from das.domain.files.load import locate_vehicle
from das.domain.loss_chain import LossChain
from das.domain.units import KMH, KN, KW
from precompute.calibrate.fit import DIGITS, value_of

_UNITS: Final = {"w": ("kw", KW), "n": ("kn", KN), "mps": ("kmh", KMH)}
"""Suffix of a field → suffix and factor of its key in the file."""


def vehicle_toml(name: str, chain: LossChain, parameters: Mapping[str, float]) -> str:
    """The bundled vehicle's file with the named parameters of its block [losses.l3] as in `chain`.

    Sources and everything else stay. Raises DasError where the file has no line for one of them.
    """
    path = locate_vehicle(name)
    wanted = {_key(parameter): value_of(chain, parameter) for parameter in parameters}
    table, lines = "", []
    for line in path.read_text(encoding="utf-8").splitlines():
        table = line.strip("[]") if line.startswith("[") else table
        key = (table, line.partition(" = ")[0])
        lines.append(f"{key[1]} = {_in_file(key[1], wanted.pop(key))}" if key in wanted else line)
    if wanted:
        raise DasError(f"{path}: no line {' = … in '.join(reversed(next(iter(wanted))))}")
    return "\n".join(lines) + "\n"


def _key(parameter: str) -> tuple[str, str]:
    """Table and key of a parameter like "motors.copper_w" in a vehicle file."""
    component, name = parameter.split(".")
    stem, _, suffix = name.rpartition("_")
    return f"losses.l3.{component}", f"{stem}_{_UNITS[suffix][0]}" if suffix in _UNITS else name


def _in_file(key: str, value_si: float) -> str:
    factors = dict(_UNITS.values())
    return f"{value_si / factors.get(key.rpartition('_')[2], 1.0):.{DIGITS}g}"
