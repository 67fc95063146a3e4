"""All unit factors of the project, and gravity. The program computes in SI units and converts other units only here.

A quantity read from a file names its unit; `to_si` multiplies by that unit's factor, or rejects an unknown unit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, TypeVar

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_Number = TypeVar("_Number", float, "NDArray[np.float64]")

STANDARD_GRAVITY_MPS2: Final = 9.81
"""Gravity (m/s²) of the public benchmark, used throughout."""

KMH: Final = 1.0 / 3.6
"""1 km/h in m/s."""
MPH: Final = 0.44704
"""1 mile an hour in m/s."""
KN: Final = 1e3
"""1 kN in N."""
KW: Final = 1e3
"""1 kW in W."""
KM: Final = 1e3
"""1 km in m."""
TONNE: Final = 1e3
"""1 t in kg."""
PERMILLE: Final = 1e-3
PERCENT: Final = 1e-2
KWH: Final = 3.6e6
"""1 kWh in J."""
MEGABYTE: Final = 1e6
"""1 MB in bytes."""
NS: Final = 1e-9
"""1 ns in s."""
MS: Final = 1e-3
"""1 ms in s."""

FACTORS: Final[dict[str, dict[str, float]]] = {
    "length": {"m": 1.0, "km": KM},
    "area": {"m^2": 1.0, "m2": 1.0},
    "speed": {"m/s": 1.0, "mps": 1.0, "km/h": KMH, "kmh": KMH, "mph": MPH},
    "acceleration": {"m/s^2": 1.0, "mps2": 1.0},
    "time": {"s": 1.0, "min": 60.0, "ms": MS},
    "mass": {"kg": 1.0, "t": TONNE},
    "force": {"N": 1.0, "n": 1.0, "daN": 10.0, "dan": 10.0, "kN": KN, "kn": KN},
    "power": {"W": 1.0, "w": 1.0, "kW": KW, "kw": KW, "MW": 1e6},
    "voltage": {"V": 1.0, "v": 1.0, "kV": 1e3, "kv": 1e3},
    "ratio": {"-": 1.0, "ratio": 1.0, "%": PERCENT, "percent": PERCENT},
    "gradient": {
        "permil": PERMILLE,
        "permille": PERMILLE,
        "‰": PERMILLE,
        "%": PERCENT,
        "percent": PERCENT,
        "ratio": 1.0,
        "-": 1.0,
    },
    "resistance_1": {
        "N/(m/s)": 1.0,
        "n_per_mps": 1.0,
        "kN/(m/s)": KN,
        "kn_per_mps": KN,
        "kN/(km/h)": KN / KMH,
        "kn_per_kmh": KN / KMH,
        "N/(km/h)": 1.0 / KMH,
        "n_per_kmh": 1.0 / KMH,
    },
    "resistance_2": {
        "N/(m/s)^2": 1.0,
        "n_per_mps2": 1.0,
        "kN/(m/s)^2": KN,
        "kn_per_mps2": KN,
        "kN/(km/h)^2": KN / KMH**2,
        "kn_per_kmh2": KN / KMH**2,
        "N/(km/h)^2": 1.0 / KMH**2,
        "n_per_kmh2": 1.0 / KMH**2,
    },
    "frequency": {"Hz": 1.0, "hz": 1.0},
    "frequency_per_speed": {"hz_per_mps": 1.0, "hz_per_kmh": 1.0 / KMH},
    "angle": {"deg": 1.0},
}
"""Conversion factor to SI for every unit accepted in a file, by dimension (angles stay in degrees: WGS 84)."""


def to_si(value: float, unit: str, dimension: str) -> float:
    """Convert `value` from `unit` to the SI unit of `dimension`; KeyError if the unit is not of that dimension."""
    return value * FACTORS[dimension][unit]


def kmh(speed_mps: _Number) -> _Number:
    """Speed in km/h."""
    return speed_mps / KMH


def kwh(energy_j: _Number) -> _Number:
    """Energy in kWh."""
    return energy_j / KWH


KWH_DIGITS: Final = 1
"""Number of decimals of an energy in kWh, in all outputs for people; `finer` adds to the number."""


def kwh_figure(energy_j: float, *, signed: bool = False, finer: int = 0) -> str:
    """Energy in kWh as it is printed, without its unit; never as -0.0.

    `finer` is 1 for the parts of a whole, 2 for solvers compared, −1 for a range or a large sum.
    """
    return in_kwh(kwh(energy_j), signed=signed, finer=finer)


def in_kwh(energy_kwh: float, *, signed: bool = False, finer: int = 0) -> str:
    """Energy that is in kWh already, in the form of `kwh_figure`."""
    return f"{energy_kwh:{'+' if signed else ''}z.{KWH_DIGITS + finer}f}"


def kwh_words(energy_j: float, *, signed: bool = False, finer: int = 0) -> str:
    """Energy in kWh as it is printed, with its unit."""
    return f"{kwh_figure(energy_j, signed=signed, finer=finer)} kWh"
