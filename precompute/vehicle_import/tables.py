"""Trains from tables: efforts as CSV, Davis' coefficients and the other figures as text with their units."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from das.domain.errors import MISSING, DasError, InputError
from das.domain.files.reading import MOST_OF_A_NAME
from das.domain.files.vehicles import MOST_POINTS
from das.domain.units import FACTORS
from das.domain.vehicle import Resistance
from precompute.foreign_text import read_csv
from precompute.vehicle_import.train import (
    EXAMPLES,
    LONGEST,
    ImportedTrain,
    Mode,
    Points,
    known_unit,
    quantity,
    resistance_term,
)


@dataclass(frozen=True, kw_only=True)
class Figures:
    """The figures of a train other than its efforts, as text with their units; None: not given.

    `davis` holds the three coefficients, separated by commas. `units` are those of speed and force if the table has
    none.
    """

    name: Annotated[str | None, typer.Option(help="Name of the train [default: that of the file].")] = None
    mass: Annotated[str | None, typer.Option(metavar="T", help="Mass, like '440 t'.")] = None
    length: Annotated[str | None, typer.Option(metavar="M", help="Length, like '200 m'.")] = None
    max_speed: Annotated[str | None, typer.Option(metavar="KMH", help="Top speed, like '160 km/h'.")] = None
    rotating_mass: Annotated[
        str | None, typer.Option(metavar="%", help="Rotating mass on top of the mass, like '6 %'.")
    ] = None
    deceleration: Annotated[
        str | None, typer.Option(metavar="MPS2", help="Deceleration in service, like '0.5 m/s^2'.")
    ] = None
    davis: Annotated[
        str | None,
        typer.Option(metavar="A,B,C", help="Running resistance, like '20 N/t, 0.1 N/t/(km/h), 0.003 N/t/(km/h)^2'."),
    ] = None
    units: Annotated[
        str | None, typer.Option(metavar="SPEED,FORCE", help="Units of a CSV table whose header has none: km/h,kN.")
    ] = None

    def given(self) -> dict[str, str]:
        """The figures that are given, by name."""
        return {name: text for name, text in vars(self).items() if text is not None}


MOST_BYTES = 1_000_000
MOST_COLUMNS = 50
"""Largest number of columns of a table: one for the speed, and one for each mode."""
BRAKE = "brake"
"""First word of the name of a column that holds forces of the electric brake."""
_UNIT = re.compile(r"(.*?)[\s_,]*(?:[\[(]\s*([^\[\]()]+?)\s*[\])]|\bin\s+(\S+)|_(\w+)|\s(\S+/?\S*))\s*$")


def read_efforts(path: Path, figures: Figures) -> ImportedTrain:
    """A train from a CSV table of its efforts and further figures; DasError or InputError if unusable.

    The first column holds speeds, each other one the forces of a mode (or, if there is one, of the train). The header
    states the units: `speed_kmh,force_kn`, `v [km/h];F [kN]`. A column called brake… holds the electric brake.
    """
    table = read_csv(path, MOST_BYTES, "a header and rows of speed and force")
    rows = table.rows
    if not 2 <= len(rows) <= MOST_POINTS + 1:
        raise InputError(path, "number of rows", len(rows), f"a header and 1 to {MOST_POINTS} rows of speed and force")
    line, first = rows[0]
    width = len(first)
    if not 2 <= width <= MOST_COLUMNS:
        expected = f"2 to {MOST_COLUMNS} columns: the speed, and the force of each mode"
        raise InputError(path, f"line {line}", table.joined(first), expected)
    header, body = (first, rows[1:]) if table.number(first[0]) is None else ([], rows)
    names, factors = _columns(path, header, width, figures.units)
    points = []
    for line, cells in body:
        numbers = [table.number(cell) for cell in cells]
        if None in numbers or len(numbers) != width:
            raise InputError(path, f"line {line}", ",".join(cells), f"{width} numbers")
        points.append([value * x for value, x in zip(numbers, factors, strict=True) if value is not None])
    if len(set(names)) < len(names):
        expected = "a different name for each column, which is the name of its mode"
        raise InputError(path, "header", ",".join(names), expected)
    speeds, *forces = zip(*points, strict=True)
    curves = {name: tuple(zip(speeds, force, strict=True)) for name, force in zip(names[1:], forces, strict=True)}
    return _train(path, figures.given(), _modes(path, curves))


def _columns(path: Path, header: list[str], width: int, units: str | None) -> tuple[list[str], list[float]]:
    """The name of each column, and the factor of its unit, from the header or the option."""
    dimensions = ["speed", *["force"] * (width - 1)]
    if units is not None:
        said = [one.strip() for one in units.split(",")]
        if len(said) != 2 or not known_unit(said[0], "speed") or not known_unit(said[1], "force"):
            raise DasError(f"--units {units}: expected the units of speed and force, like km/h,kN")
        split = [(name, said[min(i, 1)]) for i, name in enumerate(header or [f"column {i + 1}" for i in range(width)])]
    elif not header:
        raise DasError(f"{path}: no header, so that the units are not known; say --units km/h,kN")
    else:
        split = [_name_and_unit(cell) for cell in header]
    factors = []
    for i, ((_, unit), dimension) in enumerate(zip(split, dimensions, strict=True)):
        known_as = known_unit(unit, dimension)
        if known_as is None:
            known = "km/h or m/s" if dimension == "speed" else "N, daN or kN"
            expected = f"a {dimension} with its unit, like [{known}]; or say --units km/h,kN"
            raise InputError(path, f"header of column {i + 1}", header[i], expected)
        factors.append(FACTORS[dimension][known_as])
    return [name.strip() or f"column {i + 1}" for i, (name, _) in enumerate(split)], factors


def _name_and_unit(cell: str) -> tuple[str, str]:
    """A column's name and its unit: "speed_kmh", "F [kN]", "v (km/h)", "force in kN"."""
    found = _UNIT.fullmatch(cell) if len(cell) <= LONGEST else None
    if found is None:
        return cell, cell
    return found[1], next(part for part in found.groups()[1:] if part is not None)


def _modes(path: Path, curves: Mapping[str, Points]) -> dict[str, Mode]:
    """The modes of a table from its columns of force by name: a single traction column has no name."""
    brakes = {name: points for name, points in curves.items() if name.lower().startswith(BRAKE)}
    tractions = {name: points for name, points in curves.items() if name not in brakes}
    if len(brakes) > 1 or not tractions:
        raise DasError(f"{path}: expected a column of traction forces for each mode, and at most one of the brake")
    electric = next(iter(brakes.values()), ())
    if len(tractions) == 1:
        return {"": Mode(next(iter(tractions.values())), electric)}
    return {name: Mode(points, electric) for name, points in tractions.items()}


def _train(path: Path, given: Mapping[str, str], modes: dict[str, Mode]) -> ImportedTrain:
    def figure(key: str, dimension: str, default: str | None = None) -> float:
        value = given.get(key, default)
        if value is None:
            expected = f"a figure with its unit, like {EXAMPLES[dimension]}"
            raise InputError(path, f"option --{key.replace('_', '-')}", MISSING, expected)
        return quantity(path, key, value, dimension)

    mass_kg, name = figure("mass", "mass"), given.get("name", path.stem)
    if not name:
        raise InputError(path, "name", name, f"a text of at most {MOST_OF_A_NAME} characters")
    notes = ["the table gives no losses"]
    if "rotating_mass" not in given:
        notes.append("the rotating mass is 6 % of the mass, an assumption of a usual size (--rotating-mass)")
    if "deceleration" not in given:
        notes.append("the deceleration in service is 0.5 m/s², an assumption of a usual size (--deceleration)")
    if all(not mode.electric_brake for mode in modes.values()):
        notes.append("the train has no electric brake: the table gives none")
    return ImportedTrain(
        id=name,
        name=name,
        source=f"{path.name} (table of efforts)",
        mass_kg=mass_kg,
        rotating_mass_ratio=figure("rotating_mass", "ratio", "6 %"),
        length_m=figure("length", "length"),
        max_speed_mps=figure("max_speed", "speed"),
        resistance=_davis(path, given.get("davis", MISSING), mass_kg),
        modes=modes,
        deceleration_mps2=abs(figure("deceleration", "acceleration", "0.5 m/s^2")),
        notes=tuple(notes),
    )


def _davis(path: Path, value: object, mass_kg: float) -> Resistance:
    terms = value.split(",") if isinstance(value, str) else []
    if len(terms) != 3:
        expected = "three coefficients with their units, like 2.4 kN, 0.02 kN/(km/h), 0.0005 kN/(km/h)^2"
        raise InputError(path, "option --davis", value, expected)
    c0, c1, c2 = (resistance_term(path, f"davis[{i}]", term, i, mass_kg) for i, term in enumerate(terms))
    return Resistance(c0_n=c0, c1_n_per_mps=c1, c2_n_per_mps2=c2)
