"""The figures of a drive other than times at stops and energies. A simulated run counts them while it is driven; for a
recording they are counted from its table. JSON contains names and values, tables contain labels and words. Stability
counts how often the advice on the display changed, second by second.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from das.advice.regimes import BRAKES, TRACTION, Regime
from das.domain.units import kmh
from sim.drive.calls import KeptCall
from sim.drive.instructions import InstructionFigures, instructions
from sim.drive.limits import Violations
from sim.drive.table import HOLDS_S, DriveTable
from sim.drivers.cab import AT_STOP_M
from sim.drivers.presentations.presenter import Shown
from sim.recording.course import known, times_text

MOST_CHANGES_PER_MIN: Final = 2.0
"""Mean changes per minute above which advice is restless."""
SHORTEST_MODE_S: Final = 8.0
"""Duration of a mode (s) below which advice is restless."""
REVERSAL_S: Final = 10.0
"""Time (s) between traction and braking, in either order, below which they are a reversal."""
A_SECOND_NS: Final = 1_000_000_000


@dataclass(frozen=True, kw_only=True)
class AdviceStability:
    """The stability of the displayed advice while the train moved.

    `shown_s` is the time in which the train moved and advice was shown, and `changes` the number of seconds of it that
    began with another mode, speed or effort than the second before. `reversals` counts the times that the mode went
    from traction to brake, or from brake to traction, with less than 10 s of other modes in between.
    `shortest_mode_s` is the shortest time for which a mode lasted before another replaced it; NaN if none was replaced.
    Braking cannot wait, so braking modes and the modes that they end do not count.
    """

    shown_s: float = 0.0
    changes: int = 0
    reversals: int = 0
    shortest_mode_s: float = math.nan

    @property
    def changes_per_min(self) -> float:
        """Changes per minute in which the train moved and advice was shown; NaN if there was no such time."""
        return 60.0 * self.changes / self.shown_s if self.shown_s > 0 else math.nan

    @property
    def warning(self) -> str | None:
        """The warning about restless advice; None if the advice was stable."""
        found = []
        if self.changes_per_min > MOST_CHANGES_PER_MIN:
            found.append(f"{self.changes_per_min:.2f} changes a minute (more than {MOST_CHANGES_PER_MIN:g})")
        if self.shortest_mode_s < SHORTEST_MODE_S:
            found.append(f"a mode that lasted {self.shortest_mode_s:.0f} s (less than {SHORTEST_MODE_S:g} s)")
        return f"the advice shown was restless: {' and '.join(found)}" if found else None


class ShownWatch:
    """Looks at the display every second of a run; call `look` in the order of time.

    A spell is a time in which the train moves and advice is shown. Its beginning is no change, because what was shown
    before is not known. Its last mode does not count as short, because how long it would have lasted is not known.
    The advice to depart is not part of a spell, so the advice to accelerate that follows it is no change.
    """

    def __init__(self) -> None:
        self._shown_s, self._changes, self._reversals, self._shortest_s = 0.0, 0, 0, math.inf
        self._before: Shown | None = None
        self._before_s = self._mode_since_s = -math.inf
        self._effort_side, self._neither_since_s = 0, math.inf

    @property
    def found(self) -> AdviceStability:
        """The measures so far."""
        return AdviceStability(
            shown_s=self._shown_s,
            changes=self._changes,
            reversals=self._reversals,
            shortest_mode_s=self._shortest_s if self._shortest_s < math.inf else math.nan,
        )

    def look(self, time_s: float, speed_mps: float, shown: Shown | None) -> None:
        """Record the advice shown at a time (None: nothing), and the speed of the train then."""
        under_way = speed_mps > 0 and shown is not None and shown.mode is not Regime.DEPART
        shown = shown if under_way else None
        before, span_s = self._before, time_s - self._before_s
        self._before, self._before_s = shown, time_s
        if before is not None and span_s <= HOLDS_S:
            self._shown_s += span_s
        else:
            self._mode_since_s, self._effort_side, self._neither_since_s = time_s, 0, math.inf
        if shown is None:
            return
        if before is not None and span_s <= HOLDS_S and shown != before:
            self._changes += 1
            if shown.mode is not before.mode:
                self._mode_ended(time_s, before.mode, shown.mode)
        self._note_effort(time_s, shown.mode)

    def _mode_ended(self, time_s: float, ended: Regime | None, now: Regime | None) -> None:
        """Record the duration of the replaced mode, unless the old or the new mode is a stop or a brake."""
        if Regime.STOP not in (ended, now) and not {ended, now} & BRAKES:
            self._shortest_s = min(self._shortest_s, time_s - self._mode_since_s)
        self._mode_since_s = time_s

    def _note_effort(self, time_s: float, mode: Regime | None) -> None:
        """Count a reversal; remember which of traction and brake was shown last, and until when."""
        side = (mode in TRACTION) - (mode in BRAKES)
        if side == 0:
            self._neither_since_s = min(self._neither_since_s, time_s)
            return
        if side == -self._effort_side and time_s - self._neither_since_s < REVERSAL_S:
            self._reversals += 1
        self._effort_side, self._neither_since_s = side, math.inf


def stability(table: DriveTable) -> AdviceStability:
    """The measures of a recorded drive, from the content of the cab's display and the speed of the true train.

    Without these nothing counts as shown. If the shown speed was not recorded, it is the advised speed, rounded. An
    external driver may look more often than once a second; one look a second counts, as for every driver.
    """
    true_ns, true_mps = table.of_topic("truth", "speed_mps")
    speeds_mps = dict(zip(true_ns.tolist(), true_mps.tolist(), strict=True))
    watch = ShownWatch()
    times_ns, looks, views = table.of_topic("cab", "look", "view")
    for time_ns, look, view in zip(times_ns.tolist(), looks.tolist(), views, strict=True):
        if not look or time_ns in speeds_mps:
            since_s = (time_ns - int(times_ns[0])) / A_SECOND_NS
            watch.look(since_s, speeds_mps.get(time_ns, 0.0), None if view is None else Shown.of(view))
    return watch.found


@dataclass(frozen=True, kw_only=True)
class DriveFigures:
    """Compliance with signals, limits and stops, stability of the advice, and adherence of the guide to its grammar."""

    violations: Violations
    stability: AdviceStability
    instructions: InstructionFigures
    calls: tuple[KeptCall, ...] = ()

    @property
    def stops_missed(self) -> int:
        """The number of stops that the train reached, but at which it did not stand within `AT_STOP_M`."""
        return sum(one.reached and not abs(one.stopping_error_m) <= AT_STOP_M for one in self.calls[1:])

    def as_dict(self) -> dict[str, float | bool | None]:
        """All figures for programs, by their names, which carry the units; None stands for unknown values."""
        shown, guide, limits = self.stability, self.instructions, self.violations
        relied = guide.reliance
        return {
            "advice_changes_per_min": known(shown.changes_per_min),
            "reversals": shown.reversals,
            "shortest_mode_s": known(shown.shortest_mode_s),
            "advice_restless": shown.warning is not None,
            "instructions": guide.instructions,
            "shortest_instruction_s": guide.shortest_s if math.isfinite(guide.shortest_s) else None,
            "announced_ratio": _ratio(guide.announced, guide.changes),
            "brakes_led_ratio": _ratio(guide.led, guide.brakes),
            "effort_changes_per_brake": _ratio(guide.efforts_in_brakes, guide.brakes),
            "missed_coasts": guide.missed_coasts,
            "vain_accelerations": guide.vain_accelerations,
            "odd_speeds": guide.odd_speeds,
            "standing_acceleration_s": guide.standing_s,
            "promises_kept_ratio": _ratio(relied.kept, relied.promised),
            "above_limit_obeying_s": relied.above_limit_s,
            "hidden_limits": relied.hidden_limits,
            "last_word_acts": relied.replaced,
            "availability_ratio": _ratio(relied.advised_s, relied.advised_s + relied.silent_s),
            "signals_passed": limits.signals_passed,
            "beyond_signal_m": limits.beyond_signal_m,
            "over_limit_s": limits.over_limit_s,
            "over_limit_kmh": kmh(limits.over_limit_mps),
            "stops_missed": self.stops_missed,
        }

    def rows(self) -> list[tuple[str, str]]:
        """Labels and words for tables, without the figures of a blank display or an absent guide."""
        shown, guide, rows = self.stability, self.instructions, list[tuple[str, str]]()
        if shown.shown_s:
            shortest = "–" if math.isnan(shown.shortest_mode_s) else f"{shown.shortest_mode_s:.0f} s"
            rows += [
                ("advice changed, while moving", f"{shown.changes_per_min:.1f} times a minute"),
                ("  from traction to brake or back", times_text(shown.reversals)),
                ("  shortest mode", shortest),
            ]
        if guide.changes:
            shares = (
                ("guide's changes announced in time", guide.announced, guide.changes),
                ("  brakes shown 2 s before they were due", guide.led, guide.brakes),
                ("  instructions against the grammar", guide.against_grammar, guide.instructions),
                ("  announced changes kept", guide.reliance.kept, guide.reliance.promised),
            )
            rows += [(label, f"{share} of {whole}") for label, share, whole in shares]
        return rows + ([("stops missed or overrun", str(self.stops_missed))] if self.stops_missed else [])


def figures(table: DriveTable, violations: Violations, made: tuple[KeptCall, ...]) -> DriveFigures:
    """The figures of a recorded drive with these violations and these stops as served."""
    return DriveFigures(violations=violations, stability=stability(table), instructions=instructions(table), calls=made)


def _ratio(part: int, whole: int) -> float | None:
    return part / whole if whole else None


NAMES: Final = frozenset(
    DriveFigures(violations=Violations(), stability=AdviceStability(), instructions=InstructionFigures()).as_dict()
)
"""The names of all figures: every drive has them, be it a run or a recording."""
