"""The tracks of a map as a graph, and the path of a train through it without sharp turns or reversing.

Vertices and pieces are sorted by their places on the map. The result therefore does not depend on the order of the
tracks in a file, on the direction in which a track is drawn, or on how a line is divided into tracks.
"""

from __future__ import annotations

import heapq
import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from das.domain.earth import Floats, distances_m
from das.domain.errors import DasError
from das.domain.units import KM
from precompute.polylines import nearest_on_segments, plane_m
from precompute.route_import.track_map import UNITS_PER_DEGREE, Key, MapPlace, TrackLine, TrackMap

NEAR_M: Final = 400.0
"""Largest distance (m) from a station at which a track counts as one of the station's tracks."""
SHARPEST_TURN_COS: Final = math.cos(math.radians(40.0))
"""Largest angle (as its cosine) by which a train turns from one piece of track to the next."""
SHORT_M: Final = 15.0
"""Length (m) below which the direction of a piece is uncertain: if no track branches off, it may turn by 90°."""
JOINED_M: Final = 3.0
"""Largest gap (m) over which the end of a track is joined to another one: some exports other than OSM's round."""
UNITS_PER_M: Final = 400
"""Largest number of units of 10⁻⁷ degrees in a metre, up to a latitude of 76°."""
AT_VERTEX_M: Final = 0.5
"""Largest distance (m) of a place next to a track from a vertex; a place farther away gets a new vertex."""
PLANE_RATIO: Final = 0.99
"""Factor on straight-line distances in the search, so that they are never too long."""
AGAINST_PREFERRED: Final = 3.0
"""Cost of a metre against the preferred direction of a track (a metre along it costs 1)."""
AGAINST_ONE_WAY: Final = 30.0
SERVICE_PRICES: Final = {"yard": 4.0, "spur": 4.0, "siding": 2.0, "crossover": 1.5}
"""Cost of a metre of track that trains only use in stations and works."""
USAGE_PRICES: Final = {"industrial": 4.0, "military": 4.0, "test": 4.0, "tourism": 1.5}
OTHER_RAIL: Final = 2.0
"""Cost of a metre of tram, light railway, metro or narrow gauge in a map that also has full railway."""


class Step(NamedTuple):
    """A piece of track as driven: its track, and whether it is driven in the order of the track's vertices."""

    track: TrackLine
    forward: bool


@dataclass(frozen=True, kw_only=True)
class FoundWay:
    """The path of a train: n vertices (degrees), the n − 1 steps between them, and the vertices of its stations."""

    latitude_deg: Floats
    longitude_deg: Floats
    steps: tuple[Step, ...]
    stations: tuple[tuple[MapPlace, int], ...]


class _Piece(NamedTuple):
    """A piece of track between two neighbouring vertices; `forward`: it is drawn from u to v."""

    u: int
    v: int
    track: TrackLine
    forward: bool


@dataclass(frozen=True, kw_only=True)
class _Offer:
    """The vertices at which a station may be (number → its distance, m), and its place on the map."""

    places: dict[int, MapPlace]
    distance_m: dict[int, float]
    latitude_deg: float
    longitude_deg: float
    reach_m: float


@dataclass(eq=False)
class TrackGraph:
    """The pieces of track of a map between neighbouring vertices, joined at the vertices that they share."""

    the_map: TrackMap
    keys: list[Key] = field(init=False)
    pieces: list[_Piece] = field(init=False)

    def __post_init__(self) -> None:
        joined = {} if self.the_map.is_osm else _joined_ends(self.the_map.tracks)
        self.keys = sorted({joined.get(key, key) for track in self.the_map.tracks for key in track.vertices})
        number = {key: i for i, key in enumerate(self.keys)}
        best: dict[tuple[int, int], _Piece] = {}
        for track in self.the_map.tracks:
            ends = [number[joined.get(key, key)] for key in track.vertices]
            for a, b in pairwise(ends):
                if a != b:
                    piece = _Piece(min(a, b), max(a, b), track, a < b)
                    known = best.get((piece.u, piece.v))
                    if known is None or _rank(piece) < _rank(known):
                        best[piece.u, piece.v] = piece
        self.pieces = [best[ends] for ends in sorted(best)]

    def way(self, stations: Sequence[Sequence[MapPlace]]) -> FoundWay:
        """The cheapest path over all stations in order, each given by its possible places.

        Raises DasError if no track is near a station, or if no path leads from one to the next.
        """
        return _Search(self, [self._offer(places) for places in stations]).found()

    def degrees(self) -> tuple[Floats, Floats]:
        """Latitude and longitude (deg) of each vertex."""
        latitude, longitude = (np.array(self.keys, dtype=float) / UNITS_PER_DEGREE).T
        return latitude, longitude

    def _offer(self, places: Sequence[MapPlace]) -> _Offer:
        """The points of tracks nearest to any of the places; the pieces there get a new vertex.

        Places of a worse rank count only if no track is near those of a better rank.
        """
        found: dict[int, MapPlace] = {}
        distance_m: dict[int, float] = {}
        nearest_m = math.inf
        for place in places:
            if found and place.rank > next(iter(found.values())).rank:
                break
            near, least_m = self._feet(place)
            nearest_m = min(nearest_m, least_m)
            for vertex, away_m in near.items():
                if away_m < distance_m.get(vertex, math.inf):
                    found[vertex], distance_m[vertex] = place, away_m
        if not found:
            raise DasError(
                f"{self.the_map.source}: no track within {NEAR_M:g} m of {places[0].name}: the nearest is "
                f"{nearest_m / KM:.1f} km away"
            )
        latitude, longitude = (degrees[list(found)] for degrees in self.degrees())
        middle = float(latitude.mean()), float(longitude.mean())
        reach_m = float(distances_m(latitude, longitude, *middle).max())
        return _Offer(
            places=found, distance_m=distance_m, latitude_deg=middle[0], longitude_deg=middle[1], reach_m=reach_m
        )

    def _feet(self, place: MapPlace) -> tuple[dict[int, float], float]:
        """The vertices of tracks nearest to a place, each with its distance (m), and the least of all distances.

        A place next to a track is projected on the track, where a new vertex is put. A vertex itself is nearest if no
        train that passes it comes nearer to the place: at a bend, and where a track ends.
        """
        latitude, longitude = self.degrees()
        u, v = (np.array([piece[i] for piece in self.pieces]) for i in (0, 1))
        x, y = plane_m(latitude, longitude, (place.latitude_deg, place.longitude_deg))
        dx, dy = x[v] - x[u], y[v] - y[u]
        share, away_m = nearest_on_segments(x[u], y[u], dx, dy)
        length_m = np.maximum(np.hypot(dx, dy), 1e-6)
        edge = AT_VERTEX_M / length_m
        feet: dict[int, float] = {}
        leaving: dict[int, list[tuple[complex, bool]]] = defaultdict(list)
        for i in np.flatnonzero(away_m <= NEAR_M).tolist():
            at_u, at_v = bool(share[i] <= edge[i]), bool(share[i] >= 1 - edge[i])
            course = complex(dx[i], dy[i]) / length_m[i]
            leaving[int(u[i])].append((course, at_u))
            leaving[int(v[i])].append((-course, at_v))
            if not at_u and not at_v:
                feet[self._split(i, float(share[i]))] = float(away_m[i])
        feet |= {vertex: math.hypot(x[vertex], y[vertex]) for vertex, ways in leaving.items() if _is_nearest(ways)}
        return feet, float(away_m.min())

    def _split(self, index: int, share: float) -> int:
        """Put a vertex into a piece at a share of its length; returns the number of the vertex."""
        piece = self.pieces[index]
        (south, west), (north, east) = self.keys[piece.u], self.keys[piece.v]
        self.keys.append((south + round(share * (north - south)), west + round(share * (east - west))))
        new = len(self.keys) - 1
        self.pieces[index] = piece._replace(v=new)
        self.pieces.append(piece._replace(u=new))
        return new


def _is_nearest(ways: Sequence[tuple[complex, bool]]) -> bool:
    """Whether some train passes a vertex without coming nearer to a place.

    Each piece that leaves the vertex is given by its direction, and by whether it leads away from the place.
    """
    for came_by, away in ways:
        onward = [other for course, other in ways if (-came_by * course.conjugate()).real >= SHARPEST_TURN_COS]
        if away and all(onward):
            return True
    return False


class _Search:
    """A search with a lower bound (A*) over directed pieces, one layer for each station that was passed.

    Directed piece 2i leads from u to v of piece i, 2i + 1 back. A state is layer · 2n + directed piece.
    """

    def __init__(self, graph: TrackGraph, offers: Sequence[_Offer]) -> None:
        self.graph, self.offers = graph, offers
        self.latitude_deg, self.longitude_deg = graph.degrees()
        u, v = (np.array([piece[i] for piece in graph.pieces]) for i in (0, 1))
        north = self.latitude_deg[v] - self.latitude_deg[u]
        east = (self.longitude_deg[v] - self.longitude_deg[u]) * np.cos(np.radians(self.latitude_deg[u]))
        course = north + 1j * east
        self.course: list[complex] = (course / np.maximum(np.abs(course), 1e-15)).tolist()
        ends = self.latitude_deg[u], self.longitude_deg[u], self.latitude_deg[v], self.longitude_deg[v]
        self.length_m: list[float] = distances_m(*ends).tolist()
        self.heads = np.stack((v, u), axis=1).ravel().tolist()
        self.leaving: dict[int, list[int]] = defaultdict(list)
        for directed in range(len(self.heads)):
            self.leaving[self.heads[directed ^ 1]].append(directed)
        has_rail = any(track.tags.get("railway") == "rail" for track in graph.the_map.tracks)
        prices = {
            id(track): tuple(_price(track, forward, has_rail) for forward in (False, True))
            for track in graph.the_map.tracks
        }
        self.cost = [
            length_m * prices[id(piece.track)][forward]
            for length_m, piece in zip(self.length_m, graph.pieces, strict=True)
            for forward in (piece.forward, not piece.forward)
        ]
        self.crossings = {i for i, key in enumerate(graph.keys) if key in graph.the_map.crossings}
        self.left = self._bounds()

    def _bounds(self) -> list[list[float]]:
        """The lower bound of the cost from each vertex to the last station, for each layer."""
        bounds, rest = [], 0.0
        for layer in range(len(self.offers) - 2, -1, -1):
            here, goal = self.offers[layer], self.offers[layer + 1]
            to_goal = distances_m(self.latitude_deg, self.longitude_deg, goal.latitude_deg, goal.longitude_deg)
            bounds.append((np.maximum(PLANE_RATIO * to_goal - goal.reach_m, 0.0) + rest).tolist())
            apart = distances_m(here.latitude_deg, here.longitude_deg, goal.latitude_deg, goal.longitude_deg)
            rest += max(PLANE_RATIO * float(apart) - goal.reach_m - here.reach_m, 0.0)
        return bounds[::-1]

    def found(self) -> FoundWay:
        """The cheapest path; DasError if there is none."""
        count, last = len(self.heads), len(self.offers) - 1
        best: dict[int, float] = {}
        before: dict[int, int] = {}
        heap: list[tuple[float, Key, int, int, float]] = []

        def push(state: int, cost: float, parent: int) -> None:
            if cost < best.get(state, math.inf):
                best[state], before[state] = cost, parent
                layer, directed = divmod(state, count)
                head = self.heads[directed]
                bound = self.left[layer][head] if layer < last else 0.0
                heapq.heappush(heap, (cost + bound, self.graph.keys[head], state, parent, cost))

        for vertex, away_m in self.offers[0].distance_m.items():
            for directed in self.leaving[vertex]:
                push(directed, away_m + self.cost[directed], -1)
        nearest = (math.inf, -1)
        while heap:
            _, _, state, _, cost = heapq.heappop(heap)
            if cost > best[state]:
                continue
            layer, directed = divmod(state, count)
            if layer == last:
                return self._way(state, before)
            head = self.heads[directed]
            nearest = min(nearest, (self.left[layer][head], state))
            if head in self.offers[layer + 1].distance_m:
                push(state + count, cost + self.offers[layer + 1].distance_m[head], state)
            for onward in self._onward(directed):
                push(layer * count + onward, cost + self.cost[onward], state)
        raise DasError(self._no_way(nearest[1]))

    def _onward(self, directed: int) -> Iterator[int]:
        vertex = self.heads[directed]
        ways = self.leaving[vertex]
        turns = [self._turn_cos(directed, onward) for onward in ways]
        straightest = max(turns) - 1e-9 if vertex in self.crossings else -1.0
        for onward, turn_cos in zip(ways, turns, strict=True):
            short = len(ways) == 2 and min(self.length_m[directed >> 1], self.length_m[onward >> 1]) < SHORT_M
            if turn_cos >= max(0.0 if short else SHARPEST_TURN_COS, straightest):
                yield onward

    def _turn_cos(self, one: int, other: int) -> float:
        cosine = (self.course[one >> 1] * self.course[other >> 1].conjugate()).real
        return -cosine if (one ^ other) & 1 else cosine

    def _way(self, state: int, before: dict[int, int]) -> FoundWay:
        count, states = len(self.heads), [state]
        while before[states[-1]] >= 0:
            states.append(before[states[-1]])
        vertices: list[int] = []
        steps: list[Step] = []
        stations: list[tuple[MapPlace, int]] = []
        for one in reversed(states):
            layer, directed = divmod(one, count)
            if not vertices:
                vertices.append(self.heads[directed ^ 1])
                stations.append((self.offers[0].places[vertices[0]], 0))
            if layer == len(stations):  # a station was reached; the train's place is unchanged
                stations.append((self.offers[layer].places[vertices[-1]], len(vertices) - 1))
                continue
            piece = self.graph.pieces[directed >> 1]
            steps.append(Step(piece.track, piece.forward == (directed % 2 == 0)))
            vertices.append(self.heads[directed])
        return FoundWay(
            latitude_deg=self.latitude_deg[vertices],
            longitude_deg=self.longitude_deg[vertices],
            steps=tuple(steps),
            stations=tuple(stations),
        )

    def _no_way(self, state: int) -> str:
        """The message that no path leads to the next station, with the place where the search came nearest to it."""
        layer, directed = divmod(state, len(self.heads))
        goal, head = self.offers[layer + 1], self.heads[directed]
        latitude, longitude = self.latitude_deg[head], self.longitude_deg[head]
        away_m = float(distances_m(latitude, longitude, goal.latitude_deg, goal.longitude_deg))
        names = [next(iter(offer.places.values())).name for offer in self.offers[layer : layer + 2]]
        return (
            f"{self.graph.the_map.source}: no way from {names[0]} to {names[1]} without reversing or turning by more "
            f"than 40°: the tracks end {away_m / KM:.2f} km from it, at {latitude:.5f},{longitude:.5f} "
            f"({self.graph.pieces[directed >> 1].track.name})"
        )


def _price(track: TrackLine, forward: bool, has_rail: bool) -> float:
    """The cost of a metre of track in the search: 1 on a main track in its preferred direction, else more."""
    tags = track.tags
    price = SERVICE_PRICES.get(tags.get("service", ""), 1.0) * USAGE_PRICES.get(tags.get("usage", ""), 1.0)
    if has_rail and tags.get("railway") != "rail":
        price *= OTHER_RAIL
    if tags.get("railway:preferred_direction") == ("backward" if forward else "forward"):
        price *= AGAINST_PREFERRED
    if tags.get("oneway") == ("-1" if forward else "yes"):
        price *= AGAINST_ONE_WAY
    return price


def _rank(piece: _Piece) -> tuple[float, ...]:
    """The order of two overlapping tracks, which must not depend on the order of the file."""
    ways = (piece.forward, not piece.forward)
    limits = [piece.track.limit_mps(forward=way) or math.inf for way in ways]
    inside = [float(piece.track.lies_in(what)) for what in ("tunnel", "bridge")]
    return (*(_price(piece.track, way, False) for way in ways), *limits, *inside)


def _joined_ends(tracks: Sequence[TrackLine]) -> dict[Key, Key]:
    """The other vertex within `JOINED_M` of each loose end that has one."""
    side = round(JOINED_M * UNITS_PER_M)
    neighbours: dict[Key, set[Key]] = defaultdict(set)
    for track in tracks:
        for a, b in pairwise(track.vertices):
            neighbours[a].add(b)
            neighbours[b].add(a)
    loose = sorted(key for key, others in neighbours.items() if len(others) == 1)
    wanted = {cell for key in loose for cell in _cells_around(key, side)}
    cells: dict[tuple[int, int], list[Key]] = defaultdict(list)
    for key in sorted(neighbours):
        if (cell := (key[0] // side, key[1] // side)) in wanted:
            cells[cell].append(key)
    joined: dict[Key, Key] = {}
    for end in loose:
        near = [other for cell in _cells_around(end, side) for other in cells.get(cell, ()) if other != end]
        near = [other for other in near if other not in neighbours[end]]
        if near:
            latitude, longitude = np.array([end, *near]).T / UNITS_PER_DEGREE
            apart_m = distances_m(latitude[0], longitude[0], latitude[1:], longitude[1:])
            nearest_m, nearest = min(zip(apart_m.tolist(), near, strict=True))
            other = _last(joined, nearest)
            if nearest_m <= JOINED_M and other != end:
                joined[end] = other
    return {end: _last(joined, end) for end in joined}


def _last(joined: dict[Key, Key], end: Key) -> Key:
    """The vertex to which an end is finally joined; the end itself if it is not joined."""
    while end in joined:
        end = joined[end]
    return end


def _cells_around(key: Key, side: int) -> list[tuple[int, int]]:
    return [(key[0] // side + i, key[1] // side + j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
