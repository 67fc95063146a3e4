"""The cab of a recording: the files that it brings along, and what its node was started with."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from typer.exceptions import TyperException

from das.bus import topics
from das.bus.contents import Contents
from das.command_line.application import single_command
from das.domain.errors import DasError
from das.domain.files.load import catalogue
from das.node.options import AdviceGiven, BusPlace, ClockKind, LineServed, NodeOptions, TrainServed
from sim.recording.inputs import AttachedFiles
from sim.recording.metadata import NODE_ARGUMENTS

FILES: Final = {"--route": "route", "--vehicle": "vehicle", "--loss-map": "loss_map"}
"""Options of the node that name an input file, and what the recording's metadata call it."""


@dataclass
class NodeGiven:
    """What a recording's node was started with, as words of its command line, and how well that is known.

    `typed` are the words as they were said, `words` those with the recording's own files and with clock and train.
    """

    words: list[str]
    notes: list[str] = field(default_factory=list)
    typed: list[str] = field(default_factory=list)

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
    can be made of it, and for a file that the recording names and does not bring along, unless it is a bundled one.
    """
    given = _words(contents, train, contents.metadata.get("run", {}), said)
    given.typed = list(given.words)
    if said is None:
        given.words = _with_files(contents, given, folder)
        _refuse_what_is_only_named(contents.path, given.options(), folder)
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


def _with_files(contents: Contents, given: NodeGiven, folder: Path) -> list[str]:
    """The words, with the recording's own files in the place of names and of paths on another machine."""
    words, files = list(given.words), AttachedFiles(contents, folder)
    for option, kind in FILES.items():
        if option not in words[:-1]:
            continue
        place = words.index(option) + 1
        if files.has(kind):
            words[place] = str(files.place_vehicle() if kind == "vehicle" else files.place(kind))
        else:
            what = kind.replace("_", " ")
            given.notes.append(f"the recording does not bring its {what} along: {words[place]} of today is used")
    return words


def _refuse_what_is_only_named(recording: Path, options: NodeOptions, folder: Path) -> None:
    """Raise DasError where the words of a recording would open a file that is neither attached to it nor bundled.

    Files of `folder` are attached ones. The options are looked at as they will be used, however they were spelled.
    """
    line, driven, bundled = options.line, options.driven, {*catalogue("routes"), *catalogue("vehicles")}
    named: list[tuple[str, str | Path | None]] = [
        ("--route", line.route),
        ("--vehicle", driven.vehicle),
        *(("--other-vehicle", name) for name in driven.other_vehicle or ()),
        ("--loss-map", driven.loss_map),
        ("--tables", options.advice.tables),
        ("--bus", options.place.bus),
    ]
    for option, name in named:
        if name is not None and name not in bundled and not Path(name).resolve().is_relative_to(folder.resolve()):
            raise DasError(
                f"{recording}: names {option} {name}, which is not attached and not opened unasked: "
                f"expected --node with all options of das-node, {option} among them"
            )


def by_bus_clock(options: NodeOptions) -> bool:
    """Whether a node was asked for each advice by a simulation."""
    return options.advice.clock is ClockKind.BUS
