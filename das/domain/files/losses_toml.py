"""The losses in a vehicle's TOML file: efficiencies, a loss map, or a chain (docs/reference/file-formats.md)."""

from __future__ import annotations

from typing import Any

import numpy as np

from das.domain.errors import MISSING, InputError
from das.domain.files.loss_map_csv import check_cells, read_loss_map
from das.domain.files.reading import Fields, in_si
from das.domain.loss_chain import Auxiliaries, Converter, Gear, LossChain, Motors, Transformer
from das.domain.losses import EfficiencyLoss, Level, LossMap, LossModel
from das.domain.units import KMH, KN
from das.domain.vehicle import Vehicle


def read_losses(fields: Fields, vehicle: Vehicle) -> tuple[dict[Level, LossModel], Level]:
    """The loss models of a table `[losses]`, and the level it names as the default (else the first it gives)."""
    fields.check_keys(["source", "default", "own", "l1", "l2", "l3"])
    losses: dict[Level, LossModel] = {}
    for level in (Level.OWN, Level.L1, Level.L2):
        if fields.has(level):
            losses[level] = _efficiency_loss(fields.table(level))
    if fields.has(Level.L3):
        table = fields.table(Level.L3)
        losses[Level.L3] = _loss_map(table, vehicle)
    return losses, fields.choice("default", Level, next(iter(losses), Level.L0_REG))


def _loss_map(fields: Fields, vehicle: Vehicle) -> LossMap:
    """The loss map of a CSV file, or one made from a chain of components."""
    kind = fields.text("kind")
    if kind == "csv":
        fields.check_keys(["source", "kind", "path"])
        return read_loss_map(fields.source.parent / fields.text("path"))
    if kind != "components":
        raise fields.error("kind", kind, "components or csv")
    chain = read_chain(fields)
    traction_n, brake_n = vehicle.traction.max_force_n, vehicle.electric_brake.max_force_n
    check_cells(fields.source, round(vehicle.max_speed_mps / KMH), round((traction_n + brake_n) / KN) + 1)
    with np.errstate(all="ignore"):  # A map with a loss that is no finite number is refused.
        return chain.to_map(f"{fields.source} [losses.l3]", traction_n, brake_n, vehicle.max_speed_mps)


def _efficiency_loss(fields: Fields) -> EfficiencyLoss:
    idle = {"idle": "power"}
    if fields.has("mean_efficiency_ratio"):
        fields.check_keys(["source", "mean_efficiency_ratio", *fields.quantity_keys(idle)])
        return EfficiencyLoss.symmetric(_efficiency(fields, "mean_efficiency"), fields.quantity("idle", "power", 0.0))
    keys = ["traction_efficiency_ratio", "brake_efficiency_ratio"]
    fields.check_keys(["source", *keys, *fields.quantity_keys(idle)])
    return EfficiencyLoss.from_efficiencies(
        _efficiency(fields, "traction_efficiency"),
        _efficiency(fields, "brake_efficiency"),
        fields.quantity("idle", "power", 0.0),
    )


def _efficiency(fields: Fields, name: str) -> float:
    value = fields.quantity(name, "ratio")
    if not 0 < value <= 1:
        raise fields.error(f"{name}_ratio", value, "more than 0 and at most 1")
    return value


_COMPONENTS: dict[str, tuple[type[Any], dict[str, str]]] = {
    "auxiliaries": (Auxiliaries, {"base": "power", "fan": "power", "rated_heat": "power"}),
    "transformer": (Transformer, {"no_load": "power", "copper": "power", "rated_power": "power"}),
    "converter": (
        Converter,
        {
            "fixed": "power",
            "line": "ratio",
            "line_brake": "ratio",
            "conduction": "power",
            "switching": "power",
            "snubber": "power",
            "asynchronous": "frequency",
            "stator": "frequency_per_speed",
        },
    ),
    "motors": (
        Motors,
        {
            "base_speed": "speed",
            "rated_force": "force",
            "magnetising": "ratio",
            "pull_out": "ratio",
            "brake_current": "ratio",
            "copper": "power",
            "iron": "power",
        },
    ),
    "gear": (Gear, {"mesh": "ratio", "churning": "power", "churning_speed": "speed"}),
}
"""Component of a loss chain → its class and its quantities (name → dimension)."""
_SI_SUFFIX = {
    "power": "w",
    "ratio": "ratio",
    "frequency": "hz",
    "frequency_per_speed": "hz_per_mps",
    "speed": "mps",
    "force": "n",
}


def read_chain(fields: Fields) -> LossChain:
    """The parametric loss chain of a table `[losses.l3]`."""
    fields.check_keys(["source", "kind", *_COMPONENTS])
    return LossChain(**{name: _component(fields.table(name), name) for name in _COMPONENTS})


def _component(fields: Fields, name: str) -> Any:
    made, quantities = _COMPONENTS[name]
    clock = ["clock_speeds_kmh", "clock_pulses"] if made is Converter else []
    fields.check_keys(["source", *fields.quantity_keys(quantities), *clock])
    values: dict[str, object] = {
        f"{quantity}_{_SI_SUFFIX[dimension]}": fields.quantity(quantity, dimension)
        for quantity, dimension in quantities.items()
    }
    if clock:
        values["clock_speeds_mps"] = tuple(x * KMH for x in _numbers(fields, "clock_speeds_kmh"))
        values["clock_pulses"] = _numbers(fields, "clock_pulses")
    try:
        return made(**values)
    except InputError as error:
        raise InputError(fields.source, fields.prefix + error.key, error.value, error.expected) from None


def _numbers(fields: Fields, key: str) -> tuple[float, ...]:
    values = fields.data.get(key, MISSING)
    if not isinstance(values, list):
        raise fields.error(key, values, "a list of numbers")
    fields.check_count(key, values)
    return tuple(in_si(fields.source, f"{fields.prefix}{key}[{i}]", x, ("-", "ratio")) for i, x in enumerate(values))
