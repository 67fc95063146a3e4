"""Vehicles, routes, journeys, plans, scenarios, manifests and recordings with mutations: refused in one line, or used.

A few hundred; `DAS_MUTATED_FILES=100000 pytest tests/property/test_mutated_files.py` reads more (`DAS_MUTATED_FIRST`:
the number of the first). No mutation may lead to another error than one for the user, take longer than 10 s, or more
than 1 GB of memory.
"""

from __future__ import annotations

import io
import json
import os
import random
import re
import resource
import signal
import tomllib
import warnings
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager, nullcontext, suppress
from multiprocessing import get_context
from pathlib import Path
from types import FrameType
from typing import NamedTuple

import pytest

from das.advice.guide.planning import Wanted, departing
from das.bus.recording import read_contents, recording_of
from das.cab.situation import Situation
from das.domain.errors import DasError
from das.domain.files.load import load_journey, load_route, load_vehicle
from das.domain.files.reading import Fields
from das.domain.route import Route
from das.offline.asked_journey import journey_of
from das.solver.guide.policies import DEFAULT, GuideFront
from das.solver.section import Section, build_section
from das.table import Table
from precompute.cli.journey_report import as_dict, table
from precompute.cli.journey_report import warnings as warnings_of
from precompute.gtfs import FeedTrip, TripChoice, read_trip
from precompute.journey_import import TimesRead, journey_text, placed
from precompute.route_import import imported
from precompute.route_import.line import ImportOrder, Words, route_toml
from precompute.tables.plan import read_plan
from precompute.tables.writing import make_table
from sim.recording.check import check_contents
from sim.world.scenario import read_scenario
from tests.precompute.route_import.test_tables import PATH
from tests.support.crossing import numbered
from tests.support.feeds import feed_route, write_feed
from tests.support.made_maps import FILES, as_overpass, made_map
from tests.support.making import REPOSITORY
from tests.support.recordings import write_recording
from tests.support.small_tables import SETTINGS, line, quick_references, seal_anew, train

FIRST = int(os.environ.get("DAS_MUTATED_FIRST", "0"))
LONGEST_S = 10
MOST_BYTES = 1_000_000_000
CATALOGUE = REPOSITORY / "das" / "domain" / "catalogue"
ROUTE, VEHICLE = load_route("zurich-luzern"), load_vehicle("re460-ic")
VALUES = (
    *("0", "-1", "1e300", "-1e300", "nan", "inf", "-inf", "1e-300", "9" * 400, "0x7fffffffffffffff", "-0.0", "1e12"),
    *("true", '""', '"x"', '"\\u001b[31m"', '"[/red]"', "[]", "[[]]", "{}", "[nan, 1]", "1979-05-27", "07:32:00"),
    *('"' + "y" * 5000 + '"', "[" * 200 + "]" * 200, "[0.0, 1e9]", "[[0.0, 1.0], [0.0, 1.0]]", "1_000_000", "'\\'"),
)
NUMBER = re.compile(r"(?<![\w.\"])-?\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w.])")
LINE = re.compile(r"^(\s*\"?[\w.-]+\"?\s*[=:]\s*)(.+?)(,?)$", re.MULTILINE)


class Kind(NamedTuple):
    """A kind of file: an example, what is done with a mutated one, and how it is mutated."""

    name: str
    example: Path
    use: Callable[[Path], object]
    mutated: Callable[[bytes, random.Random], bytes]


class Wrong(NamedTuple):
    """A mutation that is not refused in one line."""

    number: int
    kind: str
    error: str


def _vehicle(path: Path) -> None:
    vehicle = load_vehicle(path)
    if vehicle.mass_kg < 1e7:
        Situation(route=ROUTE, vehicle=vehicle).section(0.0, 12e3)


def _route(path: Path) -> None:
    route = load_route(path)
    stops = route.stops
    if stops[1].position_m - stops[0].position_m < 50e3:
        build_section(route, VEHICLE, start_m=stops[0].position_m, end_m=stops[1].position_m)


def _imported_line(path: Path, folder: Path) -> None:
    """Import a map, a table or altitudes; what was imported can be written and read back."""
    maps = path.suffix in (".json", ".geojson")
    heights = path.read_bytes()[:9].startswith(b"latitude")
    order = ImportOrder(start="Adorf", end="Cedorf", flat=maps and not heights, altitudes=path if heights else None)
    written = folder / "line.toml"
    line = imported([folder / "tracks.geojson" if heights else path], order, Words())
    written.write_text(route_toml(line.route, line.remarks), encoding="utf-8")
    load_route(written)


def _kinds(folder: Path, section: Section) -> list[Kind]:
    plan = folder / "plan.toml"
    plan.write_text(
        'schema_version = 1\n[[routes]]\nroute = "zurich-luzern"\nreverse = "both"\n[[trains]]\nvehicle = "re460-ic"\n'
    )
    sealed = folder / "table.json"
    with quick_references():
        sealed.write_bytes(make_table(section, SETTINGS))

    maps = {"tracks.geojson": FILES["tracks.geojson"], "heights.csv": FILES["heights.csv"], "path.yaml": PATH.encode()}
    maps["overpass.json"] = json.dumps(as_overpass(made_map()), indent=1).encode()
    maps["limits.csv"] = b"position_km,limit_kmh,gradient_permille\n0,80,0\n2.5,120,4.5\n9,100,-3\n"
    for name, content in maps.items():
        (folder / name).write_bytes(content)
    feed, imported = write_feed(folder / "feed.zip"), folder / "imported.toml"
    imported.write_text(_journey_text(read_trip(feed, TripChoice(trip="101")), None), encoding="utf-8")
    recording = folder / "recording.mcap"
    write_recording(recording, seconds=20)
    texts: list[tuple[str, Path, Callable[[Path], object]]] = [
        ("vehicle", CATALOGUE / "vehicles" / "re460-ic.toml", _vehicle),
        ("route", CATALOGUE / "routes" / "flat-6km.toml", _route),
        ("long route", CATALOGUE / "routes" / "zurich-luzern.toml", _route),
        ("journey", CATALOGUE / "journeys" / "zurich-luzern.toml", lambda path: load_journey(path, ROUTE)),
        ("imported journey", imported, _imported),
        ("plan", plan, read_plan),
        ("scenario", REPOSITORY / "sim" / "world" / "scenarios" / "train-ahead.toml", read_scenario),
        *((f"import of {name}", folder / name, lambda path: _imported_line(path, folder)) for name in maps),
        ("table", sealed, lambda path: _departing(path, section)),
        ("resealed table", sealed, lambda path: _resealed(path, sealed, section)),
    ]
    return [
        *(Kind(*one, mutated_text) for one in texts),
        Kind("feed", feed, _feed, mutated_feed),
        Kind("recording", recording, _recording, mutated_bytes),
    ]


def _journey_text(trip: FeedTrip, route: Route | None) -> str:
    """The journey file of a trip, which can be read again."""
    text = journey_text(trip, placed(trip, route), TimesRead(), route, "test")
    journey_of(Fields.of(trip.feed, tomllib.loads(text)), route)
    return text


def _feed(feed: Path) -> None:
    """Import a trip of a feed, by its id or by its stops, on a route or without one."""
    chance = random.Random(feed.stat().st_size)
    by_stops = TripChoice(from_stop="Altdorf", to_stop="Zell", at_s=18_300.0)
    trip = read_trip(feed, chance.choice((TripChoice(trip="101"), TripChoice(trip="103"), by_stops)))
    _journey_text(trip, chance.choice((None, feed_route(), feed_route(geometry=True))))


def _imported(path: Path) -> None:
    """Read a journey without a route, and look at it."""
    journey = load_journey(path, None)
    table(journey)
    as_dict(journey)
    list(warnings_of(journey, None))


def mutated_feed(raw: bytes, chance: random.Random) -> bytes:
    """A feed whose zip, or one of whose tables, is mutated."""
    if chance.random() < 0.3:
        return mutated_bytes(raw, chance)
    content = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(raw)) as before, zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as after:
        wrong = chance.choice(before.namelist())
        for name in before.namelist():
            text = before.read(name)
            after.writestr(name, mutated_text(text, chance) if name == wrong else text)
    return content.getvalue()


def _recording(path: Path) -> None:
    """Read what is sound, and check it; everything that is wrong is said in one line."""
    contents = read_contents(path)
    said = [*contents.health.warnings(), *check_contents(contents, recording_of(contents)).lines()]
    wrong = next((one for one in said if "\n" in one or "\x1b" in one), None)
    if wrong is not None:
        raise ValueError(f"not one line: {wrong!r}")


def _departing(path: Path, section: Section) -> None:
    """Depart with the references of a table."""
    front = GuideFront(section, references=Table.read(path).references_for(section, DEFAULT))
    left_s = 1.1 * float(section.fastest_run.time_to_go_s[0])
    departing(front, Wanted(s_m=section.start_m, v_mps=0.0, left_s=left_s))


def _resealed(path: Path, sealed: Path, section: Section) -> None:
    """Use a table whose values were changed by somebody who knows how it is sealed."""
    chance = random.Random(path.read_bytes())
    path.write_bytes(sealed.read_bytes())

    def change(facts: object) -> None:
        for _ in range(chance.randrange(1, 3)):
            _change_somewhere(facts, chance)

    seal_anew(path, change)
    _departing(path, section)


def _change_somewhere(facts: object, chance: random.Random) -> None:
    """Replace, remove or add something anywhere in nested facts."""
    nonsense = (None, -1, 0, 1e300, 10**30, "x", [], {}, True, "../../etc/passwd", [[1]], 2**31)
    at: object = facts
    while True:
        keys = list(at) if isinstance(at, dict) else list(range(len(at))) if isinstance(at, list) else []
        if not keys:
            return
        key = chance.choice(keys)
        inner = at[key]  # type: ignore[index]
        if isinstance(inner, dict | list) and inner and chance.random() < 0.7:
            at = inner
            continue
        if chance.random() < 0.2:
            del at[key]  # type: ignore[attr-defined]
        else:
            at[key] = chance.choice(nonsense)  # type: ignore[index]
        return


def mutated_bytes(raw: bytes, chance: random.Random) -> bytes:
    """A binary file with one to three mutations: flipped bits, huge lengths, pieces cut out, doubled or put in."""
    content = bytearray(raw)
    for _ in range(chance.choice((1, 1, 1, 2, 3))):
        at, size = chance.randrange(len(content)), chance.choice((1, 8, 100, 3000))
        kind = chance.randrange(6)
        if kind == 0:
            content[at] ^= 1 << chance.randrange(8)
        elif kind == 1:
            content[at : at + 8] = chance.choice((b"\xff" * 8, b"\0" * 8, (10**12).to_bytes(8, "little")))
        elif kind == 2:
            del content[at : at + size]
        elif kind == 3:
            content[at:at] = content[at : at + size]
        elif kind == 4:
            content[at:at] = chance.randbytes(size)
        else:
            del content[max(at, 1) :]
    return bytes(content)


def mutated_text(original: bytes, chance: random.Random) -> bytes:
    """A text with one to three mutations."""
    content = original.decode("utf-8")
    for _ in range(chance.choice((1, 1, 1, 2, 3))):
        content = chance.choice((_number, _value, _line_moved, _cut, _key))(content, chance)
    raw = content.encode("utf-8", errors="replace")
    if chance.random() < 0.15 and raw:
        changed = bytearray(raw)
        for _ in range(chance.randrange(1, 5)):
            changed[chance.randrange(len(changed))] = chance.choice((0, 0x1B, 0xFF, chance.randrange(256)))
        raw = bytes(changed)
    return raw


def _replaced(content: str, match: re.Match[str] | None, group: int, by: str) -> str:
    return content if match is None else content[: match.start(group)] + by + content[match.end(group) :]


def _number(content: str, chance: random.Random) -> str:
    found = list(NUMBER.finditer(content))
    scaled = chance.choice((None, 1e-6, 1e-3, 0.5, 2.0, 1e3, 1e6, -1.0))
    match = chance.choice(found) if found else None
    if match is not None and scaled is not None:
        return _replaced(content, match, 0, repr(float(match[0]) * scaled))
    return _replaced(content, match, 0, chance.choice(VALUES))


def _value(content: str, chance: random.Random) -> str:
    found = list(LINE.finditer(content))
    return _replaced(content, chance.choice(found) if found else None, 2, chance.choice(VALUES))


def _line_moved(content: str, chance: random.Random) -> str:
    lines = content.splitlines(keepends=True)
    if not lines:
        return content
    one = lines.pop(chance.randrange(len(lines)))
    for _ in range(chance.choice((0, 1, 1, 2, 30))):
        lines.insert(chance.randrange(len(lines) + 1), one)
    return "".join(lines)


def _cut(content: str, chance: random.Random) -> str:
    first, last = sorted(chance.randrange(len(content) + 1) for _ in range(2))
    return content[:first] + content[min(last, first + 300) :] if chance.random() < 0.8 else content[:last]


def _key(content: str, chance: random.Random) -> str:
    words = list(re.finditer(r"[a-z_]{3,}", content))
    by = chance.choice(("", "x", "_mps", "\N{NULL}", "[/red]", "\x1b[31m", "mass_kg", "é" * 300))
    return _replaced(content, chance.choice(words) if words else None, 0, by)


class TooLongError(Exception):
    """What is done with a file takes too long."""


@contextmanager
def bounded() -> Iterator[None]:
    """Bound time and memory."""

    def stop(_number: int, _frame: FrameType | None) -> None:
        raise TooLongError

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(LONGEST_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def _peak_bytes() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def read_mutated(numbers: range, folder: Path) -> tuple[Counter[str], list[Wrong]]:
    """Read mutated files with the memory bounded: how many were used and refused, and what must not happen."""
    counts: Counter[str] = Counter()
    wrong: list[Wrong] = []
    kinds = _kinds(folder, build_section(line(), train()))
    for kind in kinds:  # Each example can be used, except that a table sealed anew may be refused.
        with suppress(DasError) if kind.name == "resealed table" else nullcontext():
            kind.use(kind.example)
    resource.setrlimit(resource.RLIMIT_DATA, (_peak_bytes() + MOST_BYTES, resource.RLIM_INFINITY))
    for number in numbers:
        kind, chance = kinds[number % len(kinds)], random.Random(number)
        path = folder / f"mutated{kind.example.suffix}"
        path.write_bytes(kind.mutated(kind.example.read_bytes(), chance))
        try:
            with bounded(), warnings.catch_warnings():
                warnings.simplefilter("error", RuntimeWarning)  # a computation with what is no number
                kind.use(path)
            counts[f"{kind.name}: used"] += 1
        except DasError as error:
            counts[f"{kind.name}: refused"] += 1
            said = str(error)
            if not said or "\n" in said or "\x1b" in said or len(said) > 3000:
                wrong.append(Wrong(number, kind.name, repr(said[:200])))
        except Exception as error:  # Whatever is not for the user.
            wrong.append(Wrong(number, kind.name, f"{type(error).__name__}: {error}"[:300]))
    return counts, wrong


@pytest.mark.parametrize("numbers", numbered("DAS_MUTATED_FILES", 240, FIRST))
def test_mutated_files_are_refused_in_one_line_or_used(numbers: range, tmp_path: Path) -> None:
    """In a process of its own: the bounds of time and memory are not for what other tests have left in this one."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        counts, wrong = pool.submit(read_mutated, numbers, tmp_path).result()
    print(dict(counts))
    assert not wrong, "\n".join(map(str, wrong[:20]))
    names = {name.partition(":")[0] for name in counts}
    assert len(names) > 4
    # A recording is nearly always of use: what is damaged is left out.
    assert len(numbers) < 100 or all(counts[f"{name}: refused"] for name in names - {"recording"})
