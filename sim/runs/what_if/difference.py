"""What a what-if changed: compares the recorded day with the new one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from das.advice.regimes import Regime
from das.bus.recording import recording_of
from das.domain.errors import DasError
from das.domain.units import in_kwh, kmh, kwh
from sim.drive.comparison import (
    SAME_ADVICE_MPS,
    Advised,
    AlignedDrives,
    as_dict,
    energy_sentences,
    on_track,
    told_apart,
)
from sim.drive.drive import Drive
from sim.drive.events import place_text
from sim.drive.table import DriveTable
from sim.options import WhatIfKind
from sim.recording.course import minutes
from sim.recording.opening import open_contents

LEAST_TOLD_KMH: Final = 0.05
"""Mean difference of the advised speed (km/h) below which it is not stated: it would read 0.0."""
NAMES: Final = ("recorded", "what if")


class AdviceThen(NamedTuple):
    """Advice at a moment: place (m), mode and speed (m/s), and the guide's mode and speed (0 and 0: it is silent)."""

    s_m: float
    mode: int
    speed_mps: float
    guide_mode: int
    guide_mps: float

    def differs(self, other: AdviceThen) -> bool:
        """Whether another mode or speed is advised, by the advice of this moment or by the guide."""
        apart_mps = max(abs(self.speed_mps - other.speed_mps), abs(self.guide_mps - other.guide_mps))
        modes = (self.mode, self.guide_mode) != (other.mode, other.guide_mode)
        return modes or apart_mps > SAME_ADVICE_MPS


@dataclass(frozen=True, kw_only=True)
class SaidAdvice:
    """The advice of two recordings at their common moments: how many there are, how many differ, and by how much.

    `first` is the first moment at which the advice differs. `apart_mps` is the mean difference of the advised speeds
    where both advise. `withdrawn`, `guided` and `plans` count for each recording the moments without advice, the
    moments with advice from the guide, and the plans.
    """

    moments: int
    differing: int
    first: tuple[AdviceThen, AdviceThen] | None
    apart_mps: float
    withdrawn: tuple[int, int]
    guided: tuple[int, int]
    plans: tuple[int, int]


@dataclass(frozen=True, kw_only=True, eq=False)
class Changed:
    """The two drives aligned on track position (None if they cannot be, for the reason `why_not`), and their advice."""

    kind: WhatIfKind
    aligned: AlignedDrives | None
    why_not: str
    advice: SaidAdvice

    @property
    def first(self) -> Advised | None:
        """Where the advice differs first: compared by time in an open loop, by place for a day driven anew."""
        if self.kind is WhatIfKind.OPEN_LOOP:
            return None if self.advice.first is None else _advised(*self.advice.first)
        return None if self.aligned is None else self.aligned.first_different_advice(1)

    def as_dict(self) -> dict[str, Any]:
        """What changed, for JSON."""
        advice = self.advice
        return {
            "comparison": None if self.aligned is None else as_dict(self.aligned),
            "not_compared": self.why_not,
            "advice": {
                "moments": advice.moments,
                "differing": advice.differing,
                "apart_kmh": None if math.isnan(advice.apart_mps) else kmh(advice.apart_mps),
                "first": None if self.first is None else self.first._asdict(),
                "withdrawn": list(advice.withdrawn),
                "guided": list(advice.guided),
                "plans": list(advice.plans),
            },
        }

    def rows(self) -> list[tuple[str, str, str]]:
        """The compared figures of both recordings; in an open loop the drive is the same; only the advice is new."""
        advice, rows = self.advice, list[tuple[str, str, str]]()
        if self.aligned is not None and self.kind is WhatIfKind.DRIVEN_ANEW:
            rows += _drive_rows(self.aligned)
        counts = (
            ("moments without advice", advice.withdrawn),
            ("moments with the guide", advice.guided),
            ("plans", advice.plans),
        )
        return [*rows, *((name, str(old), str(new)) for name, (old, new) in counts if old or new)]

    def sentences(self) -> list[str]:
        """Where the advice differs, in words."""
        advice, first = self.advice, self.first
        if first is None and (self.aligned is not None or not advice.differing):
            return ["The advice is the same at every moment."]
        told = []
        if self.kind is WhatIfKind.OPEN_LOOP:
            known = kmh(advice.apart_mps) >= LEAST_TOLD_KMH  # False for NaN: there was nothing to compare
            by = f", its speed by {kmh(advice.apart_mps):.1f} km/h on average" if known else ""
            told.append(f"The advice differs at {advice.differing} of {advice.moments} moments{by}.")
        if first is not None:
            told.append(f"It differs first at {place_text(first.s_m)}: {first.first}, and now {first.other}.")
        if self.kind is WhatIfKind.DRIVEN_ANEW and self.aligned is not None:
            told += energy_sentences(self.aligned, 1)
        if self.aligned is None:
            told.append(f"The drives cannot be compared: {self.why_not}.")
        return told


def changed(kind: WhatIfKind, old: Path, new: Path, train: str) -> Changed:
    """What a what-if changed; `old` and `new` are the recordings."""
    drives = [Drive(recording=recording_of(open_contents(path), train)) for path in (old, new)]
    try:
        on_tracks = [on_track(one, label) for one, label in zip(drives, NAMES, strict=True)]
        aligned, why_not = AlignedDrives.of(on_tracks), ""
    except DasError as error:
        aligned, why_not = None, str(error)
    return Changed(kind=kind, aligned=aligned, why_not=why_not, advice=_advice(*(one.table for one in drives)))


def _advice(before: DriveTable, after: DriveTable) -> SaidAdvice:
    old, new = (_by_time(one) for one in (before, after))
    both = [(old[time_ns], new[time_ns]) for time_ns in sorted(old) if time_ns in new]
    apart = [abs(a.speed_mps - b.speed_mps) for a, b in both if Regime.NONE not in (a.mode, b.mode)]
    differing = [pair for pair in both if pair[0].differs(pair[1])]
    return SaidAdvice(
        moments=len(both),
        differing=len(differing),
        first=differing[0] if differing else None,
        apart_mps=float(np.mean(apart)) if apart else math.nan,
        withdrawn=(_withdrawn(old), _withdrawn(new)),
        guided=(_guided(old), _guided(new)),
        plans=(len(before.said.plans), len(after.said.plans)),
    )


def _by_time(table: DriveTable) -> dict[int, AdviceThen]:
    rows = zip(
        *(one.tolist() for one in table.of_topic("advice", "s_m", "mode", "advised_speed_mps", "guide")), strict=True
    )
    return {
        time_ns: AdviceThen(
            s_m=s_m,
            mode=mode,
            speed_mps=speed_mps if mode != Regime.NONE else 0.0,
            guide_mode=Regime.NONE if guide is None else guide.now.mode,
            guide_mps=0.0 if guide is None else guide.now.speed_mps,
        )
        for time_ns, s_m, mode, speed_mps, guide in rows
    }


def _advised(old: AdviceThen, new: AdviceThen) -> Advised:
    """A moment at which the advice differs, in words: the advice of the guide, if only that differs."""
    plain = [(one.mode, one.speed_mps) for one in (old, new)]
    if (old.mode, old.speed_mps) != (new.mode, new.speed_mps):
        return Advised(old.s_m, *told_apart(*plain))
    guided = told_apart((old.guide_mode, old.guide_mps), (new.guide_mode, new.guide_mps))
    return Advised(old.s_m, *(f"{text} from the guide" for text in guided))


def _withdrawn(said: dict[int, AdviceThen]) -> int:
    return sum(one.mode == Regime.NONE for one in said.values())


def _guided(said: dict[int, AdviceThen]) -> int:
    return sum(one.guide_mode != Regime.NONE for one in said.values())


def _drive_rows(aligned: AlignedDrives) -> list[tuple[str, str, str]]:
    time = [minutes(float(one[-1])) for one in aligned.time_s]
    energy, times_j = [kwh(float(one[-1])) for one in aligned.energy_j], aligned.equal_arrival(1).times_j
    equal = [] if times_j is None else [("energy at equal arrival", *_in_kwh(energy[0], energy[1] - kwh(times_j)))]
    late = [f"{one.drive.energy.legs[-1].end.arrived_late_s:+.0f} s" for one in aligned.drives]
    return [
        ("driven, min", time[0], time[1]),
        ("energy, motors brake first" if not aligned.own_energies else "energy", *_in_kwh(*energy)),
        *equal,
        ("late at the last stop", late[0], late[1]),
    ]


def _in_kwh(old: float, new: float) -> tuple[str, str]:
    return f"{in_kwh(old)} kWh", f"{in_kwh(new)} kWh"
