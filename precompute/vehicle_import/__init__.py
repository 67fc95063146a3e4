"""Converts a foreign file to the text of a vehicle file; the text is checked by reading it before it is written."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from importlib.metadata import entry_points
from pathlib import Path
from typing import NamedTuple

from das.domain.errors import DasError
from das.domain.files.load import VEHICLES, refuse_foreign
from das.domain.files.reading import Fields, read_json
from das.domain.files.vehicles import vehicle_of
from das.domain.vehicle import Vehicle
from precompute.foreign_text import read_yaml
from precompute.vehicle_import import osrd, railtoolkit, tables
from precompute.vehicle_import.tables import Figures
from precompute.vehicle_import.train import ImportedTrain, named_losses, vehicle_text

IMPORTERS = "das.importers"
"""Entry points of other packages: functions that read a train from a path, by the suffix of such a file's name."""


class Imported(NamedTuple):
    """The text of a vehicle file, the vehicle that it describes, and the assumptions."""

    text: str
    vehicle: Vehicle
    notes: tuple[str, ...]


def import_train(
    source: Path,
    losses: str,
    figures: Figures | None = None,
    *,
    train_id: str | None = None,
    electric_brake: float | None = None,
    accepted: Sequence[str] = (),
) -> Imported:
    """The vehicle file of a train from rolling stock of OSRD or railtoolkit, or from a table of efforts.

    `losses` names its losses (see `named_losses`), `figures` are those that a table does not hold, `train_id` is the
    train of a railtoolkit file, `electric_brake` the share of the traction that an electric brake gets, and `accepted`
    names the checks that implausible values may fail. Raises DasError or InputError for anything unusable.
    """
    found = _read(source, figures or Figures(), train_id)
    if electric_brake is not None:
        if not 0 < electric_brake <= 5:
            raise DasError(f"--electric-brake {electric_brake:g}: expected a number above 0 and at most 5")
        found = found.with_electric_brake(electric_brake)
    found = found.up_to_its_speed()
    chosen = named_losses(losses, found.power_w)
    text = vehicle_text(found, chosen, accepted)
    vehicle = vehicle_of(Fields.of(source, tomllib.loads(text)), "to accept it, use --accept {check}")
    return Imported(text, vehicle, (*found.notes, chosen.note))


def _read(source: Path, figures: Figures, train_id: str | None) -> ImportedTrain:
    """The train of a file, by the kind of the file; DasError for a kind that cannot be imported."""
    suffix = source.suffix.lower()
    for door in entry_points(group=IMPORTERS):
        if door.name == suffix.removeprefix("."):
            brought: ImportedTrain = door.load()(source)
            return brought
    refuse_foreign(source, "train", reads=VEHICLES)
    if suffix in (".csv", ".tsv", ".txt"):
        return tables.read_efforts(source, figures)
    if suffix not in (".json", ".yaml", ".yml"):
        raise DasError(f"{source}: expected rolling stock (.json, .yaml) or a table (.csv)")
    fields = read_json(source) if suffix == ".json" else read_yaml(source)
    is_stock = suffix != ".json" and railtoolkit.is_rolling_stock(fields)
    if train_id is not None and not is_stock:
        raise DasError(f"--train {train_id}: only a file of railtoolkit holds several trains")
    if suffix != ".json" and not is_stock and not fields.has("schema"):
        expected = "expected a table of efforts as CSV, with its other figures as options"
        raise DasError(f"{source}: no rolling stock; {expected}")
    for name in figures.given():
        raise DasError(f"--{name.replace('_', '-')}: only a table needs it, {source.name} gives its own")
    if is_stock:
        return railtoolkit.read_rolling_stock(fields, train_id)
    if suffix == ".json" and osrd.is_rolling_stock(fields):
        return osrd.read_rolling_stock(fields)
    raise DasError(f"{source}: neither rolling stock of OSRD or railtoolkit nor a table of efforts")
