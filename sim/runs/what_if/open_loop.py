"""Open-loop what-if: a cab with changed settings receives the recorded messages and advises again."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from das import __version__
from das.advice.regimes import Regime
from das.bus import codec
from das.bus.recorder import RecordingFile
from das.bus.recording import RecordedMessage, recording_of
from das.bus.scanning import UNCHECKED
from das.bus.topics import JOURNEY, RESTRICTION, encode_restriction, message_time_ns
from das.cab.cab import warm_up
from das.cab.heard import RestrictionsHeard
from das.command_line.printing import Progressed
from das.domain.clocks import Clocks
from das.domain.errors import DasError
from das.domain.files.writing import refuse_link
from das.node.process import CabPlan
from sim.drive.comparison import SAME_ADVICE_MPS
from sim.drive.events import place_text
from sim.drive.table import DriveTable
from sim.options import NodeSaid, WhatIfKind
from sim.recording.opening import NODE_ARGUMENTS, open_contents, sha256, vehicle_files
from sim.runs.reproduce import EXTRACT, NodeGiven, Rehearing, is_of_cab, node_given
from sim.runs.what_if.origin import Origin
from sim.runs.what_if.otherwise import CabOtherwise, Otherwise

OWN_FILES = ("vehicle", "loss_map")
"""The kinds of attached files that are replaced when the what-if has another vehicle."""


def advise_otherwise(origin: Origin, new: Otherwise, said: NodeSaid, out: Path, progress: Progressed) -> list[str]:
    """Write the recorded drive with the advice of a cab whose settings are changed; returns notes for the user.

    All messages that do not come from the cab are written as recorded, except the restrictions and the train of the
    journey if the what-if changes them. Raises DasError if the recording holds no advice or the cab cannot be made.
    """
    if not origin.has_advice:
        raise DasError(f"{origin.path}: the recording holds no advice: use --driven-anew to simulate its run again")
    given = node_given(origin.contents, origin.train, origin.folder, said.node)
    given.typed, given.words = (_words(words, new) for words in (given.typed, given.words))
    given.words += ["--tables", str(said.tables)] if said.tables is not None else []
    hearing = Rehearing(given.options())
    plan = hearing.plan
    plan.situation.vehicle.loss_model(plan.situation.level or plan.situation.vehicle.default_level)
    warm_up()
    messages = list(_heard_otherwise(origin.messages, new, plan))
    with whole_recording(out, messages[0].log_time_ns) as file:
        file.add_metadata("run", _run(origin, given, new, plan))
        _describe(file, origin, new.cab)
        for number, (one, words) in enumerate(hearing.steps(messages), start=1):
            if not is_of_cab(one):
                file.add(one.topic, one.topic.key(one.train), one.message, one.log_time_ns)
            for word in words:
                # The recorder leaves out messages that a node sends before a simulation has set its clock.
                if not hearing.by_bus_clock or message_time_ns(word.message):
                    file.add(word.topic, word.topic.key(one.train), word.message, one.log_time_ns)
            progress(number, len(messages))
    return [*given.notes, *hearing.notes]


def _words(words: Sequence[str], new: Otherwise) -> list[str]:
    cab, found = new.cab, list(words)
    if cab.vehicle is not None:
        for option in ("--load", "--loss-map"):
            found = _without(found, option)
    for option, value in (("--vehicle", cab.vehicle), ("--load", cab.load), ("--level", cab.level)):
        if value is not None:
            found = [*_without(found, option), option, str(value)]
    if new.driven.advice is not None:
        found = [word for word in found if word not in ("--guide", "--no-guide")]
        found.append("--guide" if new.driven.advice == "guide" else "--no-guide")
    return found


def _without(words: Sequence[str], option: str) -> list[str]:
    kept, words = [], list(words)
    while words:
        word = words.pop(0)
        if word == option:
            del words[:1]
        elif not word.startswith(f"{option}="):
            kept.append(word)
    return kept


def _heard_otherwise(messages: Sequence[RecordedMessage], new: Otherwise, plan: CabPlan) -> Iterator[RecordedMessage]:
    """The recorded messages, with the restrictions and the journey's train as the what-if changes them."""
    changes = bool(new.restrictions) or new.without_restrictions
    listed = any(one.topic is RESTRICTION for one in messages)
    for one in messages:
        if one.topic is RESTRICTION and changes:
            yield one._replace(message=_restrictions(one.message, new))
            continue
        if one.topic is JOURNEY and (new.cab.vehicle or new.cab.load or new.cab.level):
            yield one._replace(message=_journey(one.message, new.cab, plan))
        else:
            yield one
        if one.topic is JOURNEY and changes and not listed:
            listed = True
            told = RestrictionsHeard(time_ns=one.message.time_ns, restrictions=new.restrictions)
            yield one._replace(topic=RESTRICTION, message=codec.encode_input(told).message)


def _restrictions(message: Any, new: Otherwise) -> Any:
    recorded = () if new.without_restrictions else message.restrictions
    return type(message)(time_ns=message.time_ns, restrictions=[*recorded, *map(encode_restriction, new.restrictions)])


def _journey(message: Any, cab: CabOtherwise, plan: CabPlan) -> Any:
    changed = type(message)()
    changed.CopyFrom(message)
    if cab.vehicle or cab.load:
        changed.vehicle_id, changed.load = plan.situation.vehicle.id, ""
    if cab.level and changed.level:
        changed.level = str(cab.level)
    return changed


def _describe(file: RecordingFile, origin: Origin, cab: CabOtherwise) -> None:
    """Attach the input files, and copy all metadata except the run's."""
    replaced = {origin.files.sha256(kind) for kind in OWN_FILES} if cab.vehicle else set()
    for attached in origin.files.others(replaced):
        file.add_attachment(attached.name, attached.media_type, attached.data)
    for path in vehicle_files(cab.vehicle).values() if cab.vehicle else ():
        file.add_attachment(path.name, "application/octet-stream", path.read_bytes())
    for name, entries in origin.contents.metadata.items():
        if name not in ("run", EXTRACT) and not name.startswith(UNCHECKED):
            file.add_metadata(name, entries)


def _run(origin: Origin, given: NodeGiven, new: Otherwise, plan: CabPlan) -> dict[str, str]:
    """The metadata of the run, with the changes of the what-if and the arguments of a node that has these changes."""
    run = {**origin.run, **origin.metadata(WhatIfKind.OPEN_LOOP, new)}
    run |= {"version": __version__, NODE_ARGUMENTS: json.dumps(given.typed, ensure_ascii=False)}
    if new.cab.level is not None:
        run["level"] = str(new.cab.level)
    if new.cab.vehicle is not None:
        run = {key: value for key, value in run.items() if key not in {f"{kind}_sha256" for kind in OWN_FILES}}
        run |= {f"{kind}_sha256": sha256(path) for kind, path in vehicle_files(new.cab.vehicle).items()}
        run["vehicle"] = plan.situation.vehicle.name
        if new.cab.level is None:
            run.pop("level", None)
    return run


class AdviceApart(NamedTuple):
    """The differences in advice of two recordings: common moments, differing moments, the first differing place (m)."""

    moments: int
    differing: int
    first_m: float | None

    @property
    def sentence(self) -> str:
        """The difference in words."""
        if self.first_m is None:
            return "The advice is the same at every moment."
        where = f"first at {place_text(self.first_m)}"
        return f"The advice differs at {self.differing} of {self.moments} moments, {where}."


def advice_apart(old: Path, new: Path, train: str) -> AdviceApart:
    """Compare the advice of two recordings of one drive, moment by moment: modes and speeds of plan and guide."""
    before, after = (_advice(DriveTable.of(recording_of(open_contents(path), train))) for path in (old, new))
    both = [(one, after[time_ns]) for time_ns, one in sorted(before.items()) if time_ns in after]
    differing = [
        s_m
        for (s_m, modes, speeds), (_, other_modes, others) in both
        if modes != other_modes or max(abs(a - b) for a, b in zip(speeds, others, strict=True)) > SAME_ADVICE_MPS
    ]
    return AdviceApart(len(both), len(differing), differing[0] if differing else None)


def _advice(table: DriveTable) -> dict[int, tuple[float, tuple[int, int], tuple[float, float]]]:
    """All advice by its time (ns): place (m), and mode and speed (m/s) of the plan and of the guide (0: none)."""
    columns = table.of_topic("advice", "s_m", "mode", "advised_speed_mps", "guide")
    found = {}
    for time_ns, s_m, mode, speed_mps, guide in zip(*(one.tolist() for one in columns), strict=True):
        now = (int(Regime.NONE), 0.0) if guide is None else (guide.now.mode, guide.now.speed_mps)
        found[time_ns] = s_m, (mode, now[0]), (0.0 if mode == Regime.NONE else speed_mps, now[1])
    return found


@contextmanager
def whole_recording(out: Path, now_ns: int) -> Iterator[RecordingFile]:
    """A recording to write; it appears at `out` at the end of the block, and not at all if the block fails.

    `now_ns` is the time stamp of attached files (ns since 1970). Raises DasError if the recording cannot be written.
    """
    refuse_link(out)
    try:
        with tempfile.TemporaryDirectory(dir=out.parent, prefix=f".{out.name}.") as folder:
            beside = Path(folder) / out.name
            file = RecordingFile(beside, Clocks(now_ns=lambda: now_ns))
            try:
                yield file
            finally:
                file.close()
            os.replace(beside, out)
    except OSError as error:
        raise DasError(f"{out}: cannot be written ({error.strerror})") from error
