"""The figures of a drive other than times at stops and energies, each defined once with name, value, unit and words. A
simulated run counts them while it is driven; for a recording they are counted from its table. JSON contains names and
values, tables contain labels and words. Stability counts how often the advice on the display changed, second by second.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

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


class DriveFigure(NamedTuple):
    """A figure: its name for programs, its value (None: there is none) and unit, and its label and words for people.

    A figure without a label is only for programs, one without a name only for people.
    """

    name: str
    value: float | bool | None
    unit: str = ""
    label: str = ""
    words: str = ""


@dataclass(frozen=True, kw_only=True)
class DriveFigures:
    """Compliance with signals, limits and stops, stability of the advice, and adherence of the guide to its grammar."""

    violations: Violations
    stability: AdviceStability
    instructions: InstructionFigures
    calls: tuple[KeptCall, ...] = ()

    @property
    def listed(self) -> tuple[DriveFigure, ...]:
        """All figures, in the order of tables and JSON."""
        return (
            *_of_display(self.stability),
            *_of_guide(self.instructions),
            *_of_limits(self.violations),
            *_of_stops(self.calls),
        )

    def as_dict(self) -> dict[str, float | bool | None]:
        """The figures for programs, by their names."""
        return {one.name: one.value for one in self.listed if one.name}

    def rows(self) -> list[tuple[str, str]]:
        """Labels and words for tables, without the figures of a blank display or an absent guide."""
        return [(one.label, one.words) for one in self.listed if one.label]


def figures(table: DriveTable, violations: Violations, made: tuple[KeptCall, ...]) -> DriveFigures:
    """The figures of a recorded drive with these violations and these stops as served."""
    return DriveFigures(violations=violations, stability=stability(table), instructions=instructions(table), calls=made)


def _of_display(found: AdviceStability) -> Iterator[DriveFigure]:
    shown = bool(found.shown_s)
    shortest = "–" if math.isnan(found.shortest_mode_s) else f"{found.shortest_mode_s:.0f} s"
    for name, value, unit, label, words in (
        ("advice_changes_per_min", known(found.changes_per_min), "1/min", "advice changed, while moving",
         f"{found.changes_per_min:.1f} times a minute"),
        ("reversals", found.reversals, "", "  from traction to brake or back", times_text(found.reversals)),
        ("shortest_mode_s", known(found.shortest_mode_s), "s", "  shortest mode", shortest),
    ):  # fmt: skip
        yield DriveFigure(name, value, unit, label if shown else "", words)
    yield DriveFigure("advice_restless", found.warning is not None)


def _of_guide(found: InstructionFigures) -> Iterator[DriveFigure]:
    relied, said = found.reliance, found.changes > 0

    def part(name: str, label: str, share: int, whole: int) -> DriveFigure:
        return DriveFigure(name, _ratio(share, whole), "", label if said else "", f"{share} of {whole}")

    yield DriveFigure("instructions", found.instructions)
    yield DriveFigure("shortest_instruction_s", found.shortest_s if math.isfinite(found.shortest_s) else None, "s")
    yield part("announced_ratio", "guide's changes announced in time", found.announced, found.changes)
    yield part("brakes_led_ratio", "  brakes shown 2 s before they were due", found.led, found.brakes)
    yield DriveFigure("effort_changes_per_brake", _ratio(found.efforts_in_brakes, found.brakes))
    yield DriveFigure("missed_coasts", found.missed_coasts)
    yield DriveFigure("vain_accelerations", found.vain_accelerations)
    yield DriveFigure("odd_speeds", found.odd_speeds)
    yield DriveFigure("standing_acceleration_s", found.standing_s, "s")
    yield part("", "  instructions against the grammar", found.against_grammar, found.instructions)
    yield part("promises_kept_ratio", "  announced changes kept", relied.kept, relied.promised)
    yield DriveFigure("above_limit_obeying_s", relied.above_limit_s, "s")
    yield DriveFigure("hidden_limits", relied.hidden_limits)
    yield DriveFigure("last_word_acts", relied.replaced)
    yield DriveFigure("availability_ratio", _ratio(relied.advised_s, relied.advised_s + relied.silent_s))


def _of_limits(found: Violations) -> Iterator[DriveFigure]:
    yield DriveFigure("signals_passed", found.signals_passed)
    yield DriveFigure("beyond_signal_m", found.beyond_signal_m, "m")
    yield DriveFigure("over_limit_s", found.over_limit_s, "s")
    yield DriveFigure("over_limit_kmh", kmh(found.over_limit_mps), "km/h")


def _of_stops(made: tuple[KeptCall, ...]) -> Iterator[DriveFigure]:
    missed = sum(one.reached and not abs(one.stopping_error_m) <= AT_STOP_M for one in made[1:])
    yield DriveFigure("stops_missed", missed, "", "stops missed or overrun" if missed else "", str(missed))


def _ratio(part: int, whole: int) -> float | None:
    return part / whole if whole else None


NAMES: Final = frozenset(
    DriveFigures(violations=Violations(), stability=AdviceStability(), instructions=InstructionFigures()).as_dict()
)
"""The names of all figures: every drive has them, be it a run or a recording."""
