"""The recorded run that a what-if changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from das.advice.advice import Timetable
from das.bus import topics
from das.bus.recording import Contents, RecordedMessage, Recording, recording_of
from das.domain.errors import DasError
from sim.drivers.kinds import as_now_called
from sim.options import WhatIfKind
from sim.recording.opening import CHANGED, NOTHING, OF, OF_SHA256, WHAT_IF, AttachedFiles, open_contents, sha256
from sim.runs.what_if.otherwise import KEPT, Otherwise


@dataclass(frozen=True, kw_only=True, eq=False)
class Origin:
    """A recorded run of one train. `folder` is the place for the input files attached to the recording."""

    path: Path
    contents: Contents
    recording: Recording
    folder: Path

    @classmethod
    def read(cls, path: Path, train: str | None, folder: Path) -> Origin:
        """Read a recording; DasError if it has no journey, which gives stops and times."""
        contents = open_contents(path)
        recording = recording_of(contents, train)
        if not recording.of(topics.JOURNEY):
            raise DasError(f"{path}: holds no journey: line and timetable are not known")
        return cls(path=path, contents=contents, recording=recording, folder=folder)

    @property
    def train(self) -> str:
        """The train's name on the bus."""
        return self.recording.train

    @property
    def run(self) -> Mapping[str, str]:
        """The recording's metadata about how it was made."""
        return as_now_called(self.recording.metadata.get("run", {}))

    @property
    def messages(self) -> list[RecordedMessage]:
        """The train's messages in the order of the file."""
        return [one for one in self.contents.messages if one.train == self.train]

    @property
    def files(self) -> AttachedFiles:
        """The attached files."""
        return AttachedFiles(self.contents, self.folder)

    @property
    def journey(self) -> Any:
        """The last journey message of the train in the recording."""
        return self.recording.of(topics.JOURNEY)[-1].message

    @property
    def is_simulated(self) -> bool:
        """Whether the train was simulated, so that its run can be simulated again."""
        return self.run.get("kind") == "run"

    @property
    def has_advice(self) -> bool:
        """Whether the recording contains advice."""
        return bool(self.recording.of(topics.ADVICE))

    @property
    def has_guide(self) -> bool:
        """Whether the recording contains advice from the guide."""
        return any(one.message.HasField("guide") for one in self.recording.of(topics.ADVICE))

    def timetables(self) -> list[Timetable]:
        """The timetable of each section; DasError if the journey lacks a time."""
        tables = []
        for start, end in pairwise(self.journey.stops):
            if not 0 < start.departure_ns < end.arrival_ns:
                where = f"from {start.name} to {end.name}"
                raise DasError(f"{self.path}: journey: expected a departure and a later arrival {where}")
            tables.append(Timetable(departure_ns=start.departure_ns, arrival_ns=end.arrival_ns))
        return tables

    def check_on_the_way(self, otherwise: Otherwise) -> None:
        """Raise DasError for a restriction outside the journey of the train."""
        first_m, last_m = self.journey.stops[0].s_m, self.journey.stops[-1].s_m
        for one in otherwise.restrictions:
            if not one.is_under(first_m, last_m):
                way = f"expected on the way, km {first_m / 1000:g} to {last_m / 1000:g}"
                raise DasError(f"--restriction from km {one.start_m / 1000:g} to {one.end_m / 1000:g}: {way}")

    def metadata(self, kind: WhatIfKind, new: Otherwise) -> dict[str, str]:
        """The metadata of a what-if of this run."""
        return {
            WHAT_IF: str(kind),
            OF: self.path.name,
            OF_SHA256: sha256(self.path),
            CHANGED: "; ".join(new.described()) or NOTHING,
            KEPT: new.kept(),
        }
