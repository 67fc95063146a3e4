"""The figures of a drive other than times at stops and energies, each defined once with name, value, unit and words. A
simulated run counts them while it is driven; for a recording they are counted from its table. JSON contains names and
values, tables contain labels and words.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

from das.domain.units import kmh
from sim.drive.calls import KeptCall
from sim.drive.events import times_text
from sim.drive.instructions import InstructionFigures, instructions
from sim.drive.limits import Violations
from sim.drive.stability import AdviceStability, stability
from sim.drive.table import DriveTable
from sim.drivers.cab import AT_STOP_M
from sim.recording.course import known


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
        """Labels and words for tables; without those of a blank display or an absent guide."""
        return [(one.label, one.words) for one in self.listed if one.label]


def figures(table: DriveTable, violations: Violations, made: tuple[KeptCall, ...]) -> DriveFigures:
    """The figures of a recorded drive with these violations, which kept its stops so."""
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
