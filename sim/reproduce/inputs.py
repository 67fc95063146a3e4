"""The cab of a recording: the files that it brings along, and what its node was started with."""

from __future__ import annotations

import hashlib
import json
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Final

from typer.exceptions import TyperException

from das.bus import topics
from das.bus.contents import Contents
from das.command_line.application import single_command
from das.domain.errors import DasError
from das.domain.files.reading import read_toml
from das.node.options import AdviceGiven, BusPlace, ClockKind, LineServed, NodeOptions, TrainServed
from sim.processes.crew import NODE_ARGUMENTS

FILES: Final = {"--route": "route", "--vehicle": "vehicle", "--loss-map": "loss_map"}
"""Options of the node that name an input file, and what the recording's metadata call it."""
DEEP: Final = PurePosixPath("a/b/c/d")
"""A vehicle may name its loss map in a folder above its own: the files are put this deep, so that it stays inside."""


@dataclass
class NodeGiven:
    """What a recording's node was started with, as words of its command line, and how well that is known."""

    words: list[str]
    notes: list[str] = field(default_factory=list)

    def options(self) -> NodeOptions:
        """The same as options; raises DasError where they are none of this version's node."""
        kept: list[NodeOptions] = []

        def keep(line: LineServed, driven: TrainServed, place: BusPlace, advice: AdviceGiven) -> None:
            kept.append(NodeOptions(line=line, driven=driven, place=place, advice=advice))

        try:
            single_command("das-node", keep, ())(list(self.words), standalone_mode=False)
        except TyperException as error:
            raise DasError(f"options of the node: {error.format_message()} (say them with --node)") from None
        if not kept:  # --help or --version were among them
            raise DasError("options of the node: expected those with which it advises")
        return kept[0]


def node_given(contents: Contents, train: str, folder: Path, said: str | None) -> NodeGiven:
    """What the node of a train was started with; its files are put into `folder`.

    `said` is what the user says about it, in place of what the recording says; the files that it names are used. Where
    neither says it, it is guessed from the journey and the topics, and a note says so. Raises DasError where nothing
    can be made of it.
    """
    run = contents.metadata.get("run", {})
    given = _words(contents, train, run, said)
    if said is None:
        given.words = _with_files(contents, given, run, folder)
    if topics.CONTROL in {one.topic for one in contents.messages if one.train == train}:
        given.words += ["--clock", "bus"]
    given.words += ["--train", train]
    return given


def _words(contents: Contents, train: str, run: Mapping[str, str], said: str | None) -> NodeGiven:
    if said is not None:
        try:
            return NodeGiven(shlex.split(said))
        except ValueError as error:
            raise DasError(f"--node {said!r}: expected options of das-node ({error})") from None
    if NODE_ARGUMENTS in run:
        try:
            words = json.loads(run[NODE_ARGUMENTS])
        except ValueError as error:
            raise DasError(f"{contents.path}: metadata run.{NODE_ARGUMENTS}: not JSON ({error})") from None
        if isinstance(words, list) and all(isinstance(word, str) for word in words):
            return NodeGiven(words)
        raise DasError(f"{contents.path}: metadata run.{NODE_ARGUMENTS}: expected a list of texts")
    return _guessed(contents, train, run)


def _guessed(contents: Contents, train: str, run: Mapping[str, str]) -> NodeGiven:
    """What can be told from the journey and from what the node said."""
    heard = [one for one in contents.messages if one.train == train]
    journey = next((one.message for one in heard if one.topic is topics.JOURNEY), None)
    if journey is None:
        raise DasError(f"{contents.path}: there is no journey: say with what the node was started (--node)")
    vehicle, _, load = journey.vehicle_id.partition("/")
    words = ["--route", journey.route_id, "--vehicle", vehicle]
    words += ["--load", load] if load else []
    words += ["--reverse"] if journey.reversed else []
    words += ["--level", run["level"]] if "level" in run else []
    words += ["--calibrate"] if any(one.topic is topics.ESTIMATE for one in heard) else []
    coached = any(one.topic is topics.ADVICE and one.message.HasField("coach") for one in heard)
    words += ["--coach" if coached else "--no-coach"]
    note = "the recording does not say with what its node was started; guessed: " + " ".join(words)
    return NodeGiven(words, [f"{note} (say it with --node)"])


def _with_files(contents: Contents, given: NodeGiven, run: Mapping[str, str], folder: Path) -> list[str]:
    """The words, with the recording's own files in the place of names and of paths on another machine."""
    words = list(given.words)
    attached = {hashlib.sha256(one.data).hexdigest(): one for one in contents.attachments}
    placed: dict[str, Path] = {}
    for kind in FILES.values():
        one = attached.get(run.get(f"{kind}_sha256", ""))
        if one is not None:
            placed[kind] = _put(folder / kind / DEEP / Path(one.name).name, one.data)
    if "vehicle" in placed and "loss_map" in placed and "--loss-map" not in words:
        _put_beside(placed["vehicle"], placed["loss_map"], folder / "vehicle")
    for option, kind in FILES.items():
        if option in words[:-1]:
            place = words.index(option) + 1
            if kind in placed:
                words[place] = str(placed[kind])
            else:
                what = kind.replace("_", " ")
                given.notes.append(f"the recording does not bring its {what} along: {words[place]} of today is used")
    return words


def _put(path: Path, content: bytes) -> Path:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    except (OSError, ValueError) as error:  # ValueError: a name that no file can have
        raise DasError(f"attached file {path.name!r}: cannot be written ({error})") from None
    return path


def _put_beside(vehicle: Path, loss_map: Path, root: Path) -> None:
    """Put a loss map where the vehicle's file says that it is, as long as that stays within the folder."""
    for name in _maps_of(vehicle):
        target = (vehicle.parent / name).resolve()
        if target.is_relative_to(root.resolve()):
            _put(target, loss_map.read_bytes())


def _maps_of(vehicle: Path) -> Sequence[str]:
    """The loss maps that a vehicle's file names."""
    if vehicle.suffix.lower() != ".toml":
        return ()
    losses = read_toml(vehicle).data.get("losses")
    levels = losses.values() if isinstance(losses, Mapping) else ()
    paths = (level.get("path") for level in levels if isinstance(level, Mapping))
    return [path for path in paths if isinstance(path, str)]


def by_bus_clock(options: NodeOptions) -> bool:
    """Whether a node was asked for each advice by a simulation."""
    return options.advice.clock is ClockKind.BUS
