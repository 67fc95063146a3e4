"""Finding a station by the name that a user types: case, accents, punctuation, words like "station" do not matter."""

from __future__ import annotations

import difflib
import re
import unicodedata
from collections.abc import Callable, Iterator, Sequence
from typing import Final

from das.domain.earth import distances_m
from das.domain.errors import DasError
from das.domain.units import KM
from precompute.route_import.track_map import UNITS_PER_DEGREE, MapPlace, TrackMap, names_of

MOST_SHOWN: Final = 25
"""Most names in a message."""
ONE_STATION_M: Final = 3000.0
"""Distance (m) beyond which places of one name are different stations; the largest yards are that long."""
GENERIC: Final = frozenset(
    {
        *("station", "railway", "central", "halt", "of"),
        *("bahnhof", "hauptbahnhof", "haltepunkt", "der", "sbb"),
        *("gare", "centrale", "sncf", "cff", "de", "des", "du", "la", "le"),
        *("stazione", "ferroviaria", "fermata", "fs", "ffs", "di"),
        *("centraal", "estacion", "estacao", "stacja", "stanice", "nadrazi"),
    }
)
"""Words of a station's name that a user may leave out."""
RANK_OF_A_TRACK: Final = 8
"""Rank of a track whose name is that of a station: it stands for a station if the map has none of that name."""
RANK_WITHOUT_NAME: Final = 9
"""Rank of a place that the user gives by its coordinates alone: the way leads over it, but no train stops there."""
_ABBREVIATED: Final = {"st": "sankt", "saint": "sankt", "sant": "sankt", "hbf": "hauptbahnhof", "bf": "bahnhof"}
_AT = re.compile(r"(?:(?P<name>[^=]*)=)?\s*(?P<latitude>-?\d+(?:\.\d+)?)\s*[,;]\s*(?P<longitude>-?\d+(?:\.\d+)?)\s*")


def stations_named(the_map: TrackMap, wanted: str) -> tuple[MapPlace, ...]:
    """The places that a user's words mean, best rank first: a station, its stops and its platforms.

    `wanted` may also be a place, "48.208,15.625", or a place with a name, "St. Pölten=48.208,15.625". Raises DasError,
    which lists the names of the map, if none or several different stations fit.
    """
    at = _AT.fullmatch(wanted)
    if at is not None:
        latitude, longitude = float(at["latitude"]), float(at["longitude"])
        if abs(latitude) > 90 or abs(longitude) > 180:
            raise DasError(f"{wanted}: expected a latitude from -90 to 90 and a longitude from -180 to 180 degrees")
        name = (at["name"] or "").strip()
        names, rank = (name or f"{latitude:g},{longitude:g}",), 0 if name else RANK_WITHOUT_NAME
        return (MapPlace(names=names, latitude_deg=latitude, longitude_deg=longitude, rank=rank),)
    fits: tuple[Callable[[str], bool], ...] = (
        lambda name: _words(name) == _words(wanted),
        lambda name: "".join(_words(name)) == "".join(_words(wanted)),
        lambda name: bool(_core(wanted)) and "".join(_core(name)) == "".join(_core(wanted)),
        lambda name: bool(_core(wanted)) and set(_core(wanted)) <= set(_words(name)),
    )
    for fit in fits:
        found = [place for place in the_map.places if any(fit(name) for name in place.names)]
        if found:
            return _one_station(the_map, wanted, found)
    found = [place for place in _named_tracks(the_map) if any(fits[0](name) for name in place.names)]
    if found:
        return _one_station(the_map, wanted, found)
    raise DasError(_unknown(the_map, wanted))


def _named_tracks(the_map: TrackMap) -> Iterator[MapPlace]:
    """The middle of each track with a name, as a place."""
    for track in the_map.tracks:
        if names := names_of(track.tags):
            latitude, longitude = (degrees / UNITS_PER_DEGREE for degrees in track.vertices[len(track.vertices) // 2])
            yield MapPlace(names=names, latitude_deg=latitude, longitude_deg=longitude, rank=RANK_OF_A_TRACK)


def _one_station(the_map: TrackMap, wanted: str, found: Sequence[MapPlace]) -> tuple[MapPlace, ...]:
    """The places that fit, best rank first; DasError if those of the best rank have several names or are far apart."""
    kept = tuple(sorted(found, key=lambda place: place.rank))
    names = list(dict.fromkeys(place.name for place in kept if place.rank == kept[0].rank))
    if len({" ".join(_core(name)) or name for name in names}) > 1:
        raise DasError(f"{the_map.source}: {wanted!r} may be {_listed(names)}: give one of these names")
    best = [place for place in kept if place.rank == kept[0].rank]
    first, *others = best
    for other in others:
        ends = first.latitude_deg, first.longitude_deg, other.latitude_deg, other.longitude_deg
        apart_m = float(distances_m(*ends))
        if apart_m > ONE_STATION_M:
            places = " and ".join(
                f"{wanted}={place.latitude_deg:.5f},{place.longitude_deg:.5f}" for place in (first, other)
            )
            raise DasError(f"{the_map.source}: {wanted!r} names places {apart_m / KM:.1f} km apart: give {places}")
    return kept


def _unknown(the_map: TrackMap, wanted: str) -> str:
    """The message for a name that no place has."""
    names = sorted({place.name for place in the_map.places if place.rank <= 1}) or sorted(
        {place.name for place in the_map.places}
    )
    if not names:
        return (
            f"{the_map.source}: no station {wanted!r}, for it names no stations at all: give "
            f"{wanted}=LATITUDE,LONGITUDE, or add a file with stations (GeoJSON or Overpass JSON with "
            "node[railway=station], or CSV with name, latitude_deg, longitude_deg)"
        )
    spelled = {" ".join(_words(name)): name for name in names}
    near = difflib.get_close_matches(" ".join(_words(wanted)), list(spelled), 3, 0.6)
    close = [spelled[one] for one in near]
    hint = f"; near: {_listed(close)}" if close else ""
    return f"{the_map.source}: no station {wanted!r}{hint}; it has {_listed(names)}"


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - MOST_SHOWN} more" if len(names) > MOST_SHOWN else ""
    return ", ".join(names[:MOST_SHOWN]) + more


def _words(name: str) -> list[str]:
    """The words of a name without case, accents and punctuation, with usual abbreviations written out."""
    plain = unicodedata.normalize("NFKD", name.casefold())
    plain = "".join(one for one in plain if not unicodedata.combining(one)).replace("ø", "o").replace("ł", "l")
    return [_ABBREVIATED.get(word, word) for word in re.findall(r"\w+", re.sub(r"['’`.]", " ", plain))]


def _core(name: str) -> list[str]:
    """The words of a name that are not generic."""
    return [word for word in _words(name) if word not in GENERIC]


def same_station(one: str, other: str) -> bool:
    """Whether two names are those of one station, as far as spelling goes."""
    return "".join(_words(one)) == "".join(_words(other))
