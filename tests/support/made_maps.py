"""The fictitious map of the example in several formats and drawings of the same line."""

from __future__ import annotations

import copy
import json
import random
from itertools import pairwise
from pathlib import Path
from typing import Any

from das.domain.files.load import load_route
from das.domain.route import Route
from tests.support.made_map import EXAMPLE

ROUTE = load_route(str(EXAMPLE / "route.toml"))
FILES = {name: (EXAMPLE / name).read_bytes() for name in ("tracks.geojson", "heights.csv")}
OTHER = {"forward": "backward", "backward": "forward"}


def made_map() -> dict[str, Any]:
    """The map of the example as GeoJSON."""
    found: dict[str, Any] = json.loads(FILES["tracks.geojson"])
    return found


def feature(coordinates: Any, kind: str = "LineString", **tags: str) -> dict[str, Any]:
    """A feature of GeoJSON; a keyword `maxspeed__forward` is the tag `maxspeed:forward`. A line is a track."""
    properties = {name.replace("__", ":"): text for name, text in tags.items()}
    if kind in ("LineString", "MultiLineString"):
        properties = {"railway": "rail", "maxspeed": "100", **properties}
    return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}


def collection(*features: dict[str, Any], **more: Any) -> dict[str, Any]:
    """A collection of features."""
    return {"type": "FeatureCollection", **more, "features": list(features)}


def written(path: Path, content: Any) -> Path:
    """A file with JSON."""
    path.write_text(json.dumps(content, ensure_ascii=False), encoding="utf-8")
    return path


def as_overpass(of: dict[str, Any], *, geometry: bool = False) -> dict[str, Any]:
    """The answer of Overpass with the same objects, with nodes (`out skel`) or with geometries (`out geom`)."""
    numbers: dict[tuple[float, float], int] = {}
    ways, nodes = [], []
    for i, one in enumerate(of["features"], 1):
        kind, coordinates = one["geometry"]["type"], one["geometry"]["coordinates"]
        if kind == "Point":
            nodes.append({"type": "node", "id": 10**6 + i, "lat": coordinates[1], "lon": coordinates[0],
                          "tags": one["properties"]})  # fmt: skip
            continue
        line = coordinates[0] if kind == "Polygon" else coordinates
        keys = [numbers.setdefault((x, y), len(numbers) + 1) for x, y in line]
        place = {"geometry": [{"lat": y, "lon": x} for x, y in line]} if geometry else {"nodes": keys}
        ways.append({"type": "way", "id": i, **place, "tags": one["properties"]})
    skeleton = [] if geometry else [{"type": "node", "id": n, "lat": y, "lon": x} for (x, y), n in numbers.items()]
    return {"version": 0.6, "generator": "Overpass API", "elements": [*ways, *nodes, *skeleton]}


def drawn_otherwise(of: dict[str, Any], seed: int) -> dict[str, Any]:
    """The same map with tracks reversed and cut at random vertices, and all features shuffled."""
    chance = random.Random(seed)
    found: list[dict[str, Any]] = []
    for one in copy.deepcopy(of["features"]):
        if one["geometry"]["type"] != "LineString":
            found.append(one)
            continue
        line = one["geometry"]["coordinates"]
        cuts = sorted({0, len(line) - 1, *(chance.randrange(len(line)) for _ in range(chance.randrange(3)))})
        for a, b in pairwise(cuts):
            piece = copy.deepcopy(one)
            piece["geometry"]["coordinates"] = line[a : b + 1]
            found.append(_turned(piece) if chance.random() < 0.5 else piece)
    chance.shuffle(found)
    return {**of, "features": found}


def _turned(one: dict[str, Any]) -> dict[str, Any]:
    """The same track drawn from its other end."""
    one["geometry"]["coordinates"].reverse()
    tags = {}
    for key, text in one["properties"].items():
        head, colon, tail = key.rpartition(":")
        name = f"{head}{colon}{OTHER.get(tail, tail)}"
        tags[name] = OTHER.get(text, text) if key == "railway:preferred_direction" else text
    one["properties"] = tags
    return one


def same_line(one: Route, other: Route) -> bool:
    """Whether two routes have the same limits, gradients, tunnels, stops and geometry, to within 1 mm."""
    return _figures(one) == _figures(other)


def _figures(route: Route) -> Any:
    return (
        round(route.length_m, 3),
        [(stop.name, round(stop.position_m, 3)) for stop in route.stops],
        *([x.round(6).tolist() for x in (steps.start_m, steps.value)] for _, steps in route.quantities()),
        [(round(x.start_m, 3), round(x.length_m, 3), x.area_m2) for x in route.tunnels],
        [x.round(7).tolist() for x in (route.geometry_latitude_deg, route.geometry_longitude_deg)],
    )
