"""Hashes of everything that determines a solved section, so that a table is used for no other section than its own."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from das.domain.losses import Level, LossMap
from das.domain.route import Route, Stretches, Zone
from das.domain.vehicle import Vehicle
from das.solver import tolerances as tol

Floats = NDArray[np.float64]

_KEPT_BITS = 30
"""Numbers count to about nine digits: the last bits differ between processors where a loss map is computed."""
_LINE_IGNORES = frozenset({
    *("id", "name", "source", "illustrative", "length_m", "stops", "altitude_at_start_m"),
    *("geometry_position_m", "geometry_latitude_deg", "geometry_longitude_deg"),
})  # fmt: skip
_TRAIN_IGNORES = frozenset(
    {"id", "name", "source", "train_length_m", "comfort_power_w", "default_level", "losses", "loads"}
)
_SOLVER_IGNORES = frozenset({
    *("LADDER_IDLE_RATIOS", "JOURNEY_FRONTS_BYTES", "JOURNEY_TIME_TOLERANCE_S"),
    *("PASSING_SPEED_STEP_MPS", "PASSING_BAND_RATIO"),
})  # fmt: skip
"""Settings that have no part in a section's grid, policies or runs; every other one counts."""
_LOSSES_IGNORE = frozenset({"name", "filled_w", "force_low_n", "force_high_n"})


def section_hashes(
    route: Route,
    vehicle: Vehicle,
    *,
    level: Level,
    start_m: float,
    end_m: float,
    start_speed_mps: float = 0.0,
    end_speed_mps: float = 0.0,
    length_m: float | None = None,
) -> dict[str, str]:
    """SHA-256 of each part of what determines a section: line, train, losses, ends, and the solver's settings.

    Names, geometry and what lies outside the section do not count. `length_m` is the train's, 0 for a point mass.
    Raises DasError where the vehicle has no such level.
    """
    length_m = vehicle.train_length_m if length_m is None else length_m
    line = {
        field.name: _part(getattr(route, field.name), start_m - length_m, end_m)
        for field in fields(route)
        if field.name not in _LINE_IGNORES
    }
    train = {field.name: getattr(vehicle, field.name) for field in fields(vehicle) if field.name not in _TRAIN_IGNORES}
    parts = {
        "line": line,
        "train": {**train, "length_m": length_m, "brakes": vehicle.brakes_at(level)},
        "losses": vehicle.loss_model(level),
        "ends": (start_m, end_m, start_speed_mps, end_speed_mps),
        "solver": {name: value for name, value in vars(tol).items() if name.isupper() and name not in _SOLVER_IGNORES},
    }
    return {name: _sha256(part) for name, part in parts.items()}


def combined(hashes: Mapping[str, str]) -> str:
    """One SHA-256 of several named hashes."""
    return _sha256(hashes)


def _part(thing: Any, from_m: float, to_m: float) -> Any:
    """What a stretch of the line sees of one of its properties."""
    if isinstance(thing, Stretches):
        first = max(int(np.searchsorted(thing.start_m, from_m, side="right")) - 1, 0)
        last = int(np.searchsorted(thing.start_m, to_m, side="left"))
        return np.maximum(thing.start_m[first:last], from_m), thing.value[first:last]
    if isinstance(thing, tuple) and all(isinstance(zone, Zone) for zone in thing):
        return [zone for zone in thing if zone.start_m < to_m and zone.start_m + zone.length_m > from_m]
    return thing


def _sha256(thing: Any) -> str:
    digest = hashlib.sha256()
    for token in _tokens(thing):
        digest.update(token)
    return digest.hexdigest()


def _tokens(thing: Any) -> Iterator[bytes]:
    """A canonical form: every value with its kind, numbers rounded, mappings and dataclasses sorted by name."""
    if isinstance(thing, np.ndarray):
        yield f"array{thing.shape}".encode()
        yield _rounded(thing).tobytes()
    elif isinstance(thing, bool | int | float | np.number) and not isinstance(thing, str):
        yield b"number" + struct.pack("<d", float(_rounded(np.array(float(thing)))))
    elif isinstance(thing, str) or thing is None:
        yield f"text{len(str(thing))}:{thing}".encode()
    elif isinstance(thing, list | tuple):
        yield f"list{len(thing)}".encode()
        for item in thing:
            yield from _tokens(item)
    elif isinstance(thing, Mapping):
        yield f"mapping{len(thing)}".encode()
        for key in sorted(thing):
            yield from _tokens(str(key))
            yield from _tokens(thing[key])
    elif is_dataclass(thing):
        ignored = _LOSSES_IGNORE if isinstance(thing, LossMap) else frozenset()
        yield from _tokens({f.name: getattr(thing, f.name) for f in fields(thing) if f.name not in ignored})
    else:
        raise TypeError(f"no canonical form of a {type(thing).__name__}")


def _rounded(values: NDArray[Any]) -> Floats:
    """Float64 (little-endian) with the mantissa rounded to `_KEPT_BITS` bits; one NaN, one zero."""
    values = np.asarray(values, dtype="<f8")
    mantissa, exponent = np.frexp(np.where(np.isfinite(values), values, 0.0))
    rounded = np.ldexp(np.round(np.ldexp(mantissa, _KEPT_BITS)), exponent - _KEPT_BITS) + 0.0
    return np.where(np.isnan(values), np.nan, np.where(np.isinf(values), values, rounded))
