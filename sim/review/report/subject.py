"""A recorded drive with everything that is found out about it once, for the page and for programs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from das.bus.recording import Recording, recording_of
from das.domain.errors import DasError
from sim.drive.attribution.account import Account, account_of
from sim.drive.attribution.likely import LikelyRange, likely_range
from sim.drive.attribution.shown import ShownAdvice
from sim.drive.events.chronicle import Chronicle
from sim.drive.limits import limit_in_force
from sim.recording.check import Checked, check_contents
from sim.recording.opening import open_contents


@dataclass(frozen=True, kw_only=True, eq=False)
class ReviewedDrive:
    """What a report is about. `account` is None where the energy cannot be accounted for; `why_not` says why.

    `likely` is the range of the energy above the optimum where it is estimated; None where it was measured, or was not
    asked for a drive of many legs. `checked` is what `das-sim check` finds.
    """

    recording: Recording
    chronicle: Chronicle
    account: Account | None
    why_not: str
    likely: LikelyRange | None
    shown: ShownAdvice
    checked: Checked

    @property
    def limit_known(self) -> bool:
        """Whether the limit of the line is known on all of the way."""
        return bool(np.isfinite(limit_in_force(self.recording, self.chronicle.trip)[1]).all())

    @property
    def name(self) -> str:
        """What the drive is called on the page."""
        return self.recording.path.stem


def subject_of(path: Path) -> ReviewedDrive:
    """Read a recording and find out about its drive; DasError for one that has no positions."""
    contents = open_contents(path)
    recording = recording_of(contents)
    account, why_not = None, ""
    try:
        account = account_of(recording)
    except DasError as error:
        why_not = str(error).removeprefix(f"{path}: ")
    return ReviewedDrive(
        recording=recording,
        chronicle=Chronicle.of(recording),
        account=account,
        why_not=why_not,
        likely=None if account is None else likely_range(account),
        shown=ShownAdvice.of(recording),
        checked=check_contents(contents, recording),
    )
