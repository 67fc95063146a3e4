"""Freezes a design: the resolved design as JSON, and the hash that tells whether anything of it was changed since."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from das.domain.errors import DasError
from das.domain.files.reading import read_json, read_text
from das.domain.files.writing import write_whole
from sim.drivers.own_class import driver_versions
from sim.drivers.population import load_population
from sim.experiment.design import SCHEMA_VERSION, Design
from sim.experiment.factors import Setting
from sim.experiment.files import DESIGN_JSON, DESIGN_TEXT
from sim.recording.inputs import sha256
from sim.world.service import scenario_files


def resolved(design: Design) -> dict[str, Any]:
    """The design with all defaults and with the hashes of its files, and its own hash; raises DasError for a missing
    file.

    It holds no path, so that the same design has the same hash on every machine.
    """
    found: dict[str, Any] = {
        "schema_version": SCHEMA_VERSION,
        "name": design.name,
        "title": design.title,
        "description": design.description,
        "seed": design.seed,
        "participants": {**asdict(design.people), "population": load_population(design.people.population).id},
        "procedure": asdict(design.procedure),
        "fixed": {name: level.text for name, level in sorted(design.fixed.items())},
        "factors": {
            factor.name: {"levels": [level.text for level in factor.levels], "within": factor.within}
            for factor in design.factors
        },
        "measures": list(design.plan.measures),
        "comparisons": [asdict(one) for one in design.plan.comparisons],
        "alpha": design.plan.alpha,
        "correction": design.plan.correction,
        "files": design_files(design),
    }
    return {"hash": design_sha256(found), **found}


def design_sha256(found: Mapping[str, Any]) -> str:
    """SHA-256 of a resolved design without its hash, in one canonical form: keys sorted, nothing between the values.

    The order of the factors is part of it, because it decides the names of the conditions.
    """
    content = {key: value for key, value in found.items() if key != "hash"}
    content["factor_order"] = list(found["factors"])
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def design_files(design: Design) -> dict[str, str]:
    """The hashes of all files that decide the result, by what they are; raises DasError for one that is missing."""
    found = {"population": sha256(Path(load_population(design.people.population).source))}
    for setting in design.settings():
        found |= setting_files(setting)
    return dict(sorted(found.items()))


def setting_files(setting: Setting) -> dict[str, str]:
    """The hashes of the files of one setting: scenario, route, vehicle, losses, and the driver of one's own."""
    scenario = setting.read_scenario()
    where = scenario.id if setting.train is None else f"{scenario.id} with {Path(scenario.vehicle).stem}"
    found = {f"{where}: {name}": sha256(path) for name, path in scenario_files(scenario).items()}
    return found | {f"{setting.driver}: {name}": text for name, text in driver_versions(setting.driver).items()}


def freeze(design: Design, folder: Path) -> dict[str, Any]:
    """Write the design into a study's folder, which is made; its resolved form.

    Where the folder holds a frozen design, it must be this one: DasError for another.
    """
    found = resolved(design)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DasError(f"{folder}: cannot be made ({error.strerror})") from error
    kept = folder / DESIGN_JSON
    if kept.exists():
        check_frozen(design, folder, found["hash"])
    else:
        write_whole(folder / DESIGN_TEXT, read_text(design.source).encode())
        write_whole(kept, json.dumps(found, indent=2, ensure_ascii=False).encode() + b"\n")
    return found


def check_frozen(design: Design, folder: Path, own_sha256: str) -> None:
    """Raise DasError where the frozen design of a folder is not this one, or was altered."""
    kept = read_json(folder / DESIGN_JSON)
    text = kept.text("hash")
    if text != design_sha256(kept.data):
        raise DasError(f"{folder / DESIGN_JSON}: hash = {text[:12]}…: the file was altered after it was frozen")
    if text != own_sha256:
        was, now = text[:12], own_sha256[:12]
        how = "expected the same design, or another folder"
        raise DasError(f"{design.source}: its hash is {now}…, but {folder} holds the frozen design {was}…: {how}")
