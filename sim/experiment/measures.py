"""The measures of an experiment: the name, unit, formula and source of each, and the function that computes it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Final

import numpy as np

from das.domain.trajectory import PART_WORDS
from das.domain.units import KMH, kwh
from sim.doors import MEASURES as DOOR
from sim.doors import Door, installed
from sim.drive.drive import Drive
from sim.drive.figures import NAMES as FIGURES
from sim.drive.figures import REVERSAL_S
from sim.drive.table import DriveTable
from sim.drivers.cab import AT_STOP_M, AdviceView, DriverEvent
from sim.drivers.presentations.presenter import SpeedIs, presenter_of
from sim.experiment.driving import Driven
from sim.world.loop import TICK_S
from sim.world.outcome import SHARES

BAND_MPS: Final = 3.0 * KMH
"""Half-width (m/s) of the band around the shown speed."""
LEAST_FORCE_N: Final = 1000.0
"""Wheel force (N) below which there is neither traction nor braking."""
LEAST_MOVE_RATIO: Final = 1e-9
"""Movement between two looks below which a controller counts as at rest."""
NOLD: Final = "as in Nold & Corman (2024)"
BALANCE: Final = "energy balance of the simulated train (docs/reference/train-model.md)"
OWN: Final = "own definition"
GRAMMAR: Final = "grammar of the guide (docs/explanation/guide.md)"
Measuring = Callable[[Driven], float | int | None]


@dataclass(frozen=True, kw_only=True)
class Measure:
    """A measure of a trial: column (which ends in the unit), title, unit, formula, source, and function.

    `of` returns a number, or None if a trial has no value (no advice shown, or a driver without a diary). `of_table`
    does the same from the table of the drive; it is None if a recording alone is not sufficient for the measure.
    """

    name: str
    title: str
    unit: str
    formula: str
    source: str
    of: Measuring
    of_table: Callable[[DriveTable], float | int | bool | None] | None = None


def stop_error_m(driven: Driven) -> float | None:
    """Mean absolute stopping error (m) over the stops after the first."""
    errors = [abs(call.stopping_error_m) for call in driven.run.calls[1:]]
    return float(np.mean(errors)) if errors else None


def speed_rmse_mps(driven: Driven) -> float | None:
    """Root mean square of the speed error (m/s) against the display; None if no speed was shown."""
    return _root_mean_square(_speed_errors(driven))


def speed_in_band_ratio(driven: Driven) -> float | None:
    """Share of the seconds with a shown speed and the train within 3 km/h of that speed; None without such seconds."""
    errors = np.abs(_speed_errors(driven))
    return float(np.mean(errors <= BAND_MPS)) if len(errors) else None


def effort_rmse_ratio(driven: Driven) -> float | None:
    """Root mean square of the controller error against the effort shown (1: full scale); None if none was shown."""
    errors = [look.lever_ratio - look.shown.lever_ratio for _, look in driven.moving if look.shown is not None]
    return _root_mean_square([error for error in errors if not math.isnan(error)])


def reaction_s(driven: Driven) -> float | None:
    """Median time (s) from noticing advice to acting on it; None if the driver never acted on advice."""
    return _median([acted - noticed for noticed, acted in _acted_on(driven.run.decisions)])


def response_s(driven: Driven) -> float | None:
    """Median time (s) from the first display of advice to acting on it; None if the driver never acted on advice."""
    since = _shown_since(driven)
    times = np.array([time_s for time_s, _ in since])
    found = []
    for noticed_s, acted_s in _acted_on(driven.run.decisions):
        i = int(np.searchsorted(times, noticed_s, side="right")) - 1
        if i >= 0:
            found.append(acted_s - since[i][1])
    return _median(found)


def compliance_ratio(driven: Driven) -> float | None:
    """Share of the noticed advice that was followed; None if no advice was noticed."""
    followed, refused = (_count(driven, what) for what in ("followed", "refused"))
    return followed / (followed + refused) if followed + refused else None


def control_movements_per_min(driven: Driven) -> float | None:
    """Movements of the controller per minute in which the train moved; None if the driver sets no controller."""
    settings = [look.lever_ratio for look in driven.looks if look.speed_mps > 0]
    if not settings or any(math.isnan(one) for one in settings):
        return None
    moves = np.abs(np.diff(settings)) > LEAST_MOVE_RATIO
    begun = int(np.count_nonzero(moves[1:] & ~moves[:-1])) + int(moves[:1].any())
    return begun / driven.moving_min


def power_brake_reversals(driven: Driven) -> int:
    """Changes between traction and braking with less than 10 s in between."""
    found, side, ended_s = 0, 0, -math.inf
    for state, _ in driven.moving:
        force_n = state.force_el_n + state.force_friction_n
        now = (force_n > LEAST_FORCE_N) - (force_n < -LEAST_FORCE_N)
        if now and now == -side and state.time_s - ended_s < REVERSAL_S:
            found += 1
        if now:
            side, ended_s = now, state.time_s
    return found


def jerk_rms_mps3(driven: Driven) -> float | None:
    """Root mean square of the acceleration's change from second to second (m/s³), while the train moved."""
    pairs = pairwise(driven.run.states)
    return _root_mean_square(
        [(b.acceleration_mps2 - a.acceleration_mps2) / TICK_S for a, b in pairs if a.speed_mps > 0 and b.speed_mps > 0]
    )


def glances_per_min(driven: Driven) -> float | None:
    """Glances at the display per minute in which the train moved; None for a driver without a diary."""
    moving = {math.floor(state.time_s) for state, _ in driven.moving}
    glances = [one for one in driven.run.decisions if one.what == "glance"]
    if not glances or not moving:
        return None
    return sum(math.floor(one.time_s) in moving for one in glances) / driven.moving_min


def lapses(driven: Driven) -> int | None:
    """Lapses of attention; None for a driver without a diary."""
    return _count(driven, "lapse") if driven.run.decisions else None


def _speed_errors(driven: Driven) -> list[float]:
    """Speed − shown speed (m/s) in each second in which the train moved and a speed to keep was shown."""
    errors = []
    for _, look in driven.moving:
        if look.shown is None or (speed_is := _speed_is(look.shown)) is SpeedIs.TO_REACH:
            continue
        error = look.speed_mps - look.shown.shown_speed_mps
        if not math.isnan(error):
            errors.append(max(error, 0.0) if speed_is is SpeedIs.HIGHEST else error)
    return errors


def _speed_is(view: AdviceView) -> SpeedIs:
    return presenter_of(view.presentation).speed_is(view.mode)


def _acted_on(decisions: Sequence[DriverEvent]) -> Iterator[tuple[float, float]]:
    """The times (s) of noticing advice and acting on it, for all advice followed, except advice to depart."""
    noticed_s = math.nan
    for event in decisions:
        if event.what == "noticed":
            noticed_s = event.time_s
        elif event.what == "acted" and event.value > 0 and event.time_s > noticed_s:
            yield noticed_s, event.time_s


def _shown_since(driven: Driven) -> list[tuple[float, float]]:
    """The time (s) of every second, and the time (s) since which its advice (mode or highest speed) was shown."""
    found: list[tuple[float, float]] = []
    before, since_s = None, math.nan
    for state, look in driven.seconds:
        view = look.shown
        now = None if view is None else round(view.speed_mps) if _speed_is(view) is SpeedIs.HIGHEST else view.mode
        if now != before:
            before, since_s = now, state.time_s
        found.append((state.time_s, since_s))
    return found


def _count(driven: Driven, what: str) -> int:
    return sum(one.what == what for one in driven.run.decisions)


def _root_mean_square(values: Sequence[float]) -> float | None:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else None


def _median(values: Sequence[float]) -> float | None:
    known = [value for value in values if not math.isnan(value)]
    return float(np.median(known)) if known else None


def _figure(name: str) -> Measuring:
    """A figure of the run that `das-sim run --json` prints under this name; yes and no as 1 and 0."""

    def of(driven: Driven) -> float | int | None:
        value = driven.figures[name]
        return int(value) if isinstance(value, bool) else value

    return of


def _measure(name: str, title: str, unit: str, source: str, formula: str, of: Measuring | None = None) -> Measure:
    """A measure; without a function, the measure is the figure of the run with the same name."""
    return Measure(name=name, title=title, unit=unit, formula=formula, source=source, of=of or _figure(name))


def _figures(source: str, *rows: tuple[str, str, str, str]) -> tuple[Measure, ...]:
    """Measures that are figures of the run, given by rows of name, title, unit and formula."""
    return tuple(_measure(name, title, unit, source, formula) for name, title, unit, formula in rows)


_LISTED: Final = (
    _measure("gap_to_optimum_ratio", "Gap to the optimum", "1", NOLD,
             "E / E_opt − 1: the energy E from departure to arrival, and the least energy E_opt with which the "
             "simulated train could have kept the limits and the actual running times of the sections; less is better",
             lambda driven: driven.outcome.energies.above.ratio),
    _measure("energy_at_equal_arrival_kwh", "Energy at equal arrival", "kWh", OWN,
             "E − E_opt + E_opt(timetable): the energy of the trial with the same distance to the optimum if every "
             "section had taken its scheduled time",
             lambda driven: kwh(driven.equal_arrival_j)),
    _measure("energy_kwh", "Energy", "kWh", BALANCE,
             "E: energy at the current collector from departure to arrival, summed over the sections"),
    _measure("energy_optimum_kwh", "Optimum for the times as driven", "kWh", NOLD,
             "E_opt: least energy of the true train for the actual running times of the sections"),
    _measure("energy_blending_kwh", "Lost to friction brakes where the motors could brake", "kWh", BALANCE,
             "part of E − E_opt: the energy that would be saved if the motors braked as much as they can"),
    _measure("energy_profile_kwh", "Lost to the speed profile", "kWh", OWN, "the rest of E − E_opt"),
    _measure("component_loss_kwh", "Losses of the train", "kWh", BALANCE,
             "∫ of the losses of the traction chain from the first departure to the last arrival"),
    _measure("resistance_kwh", "Running resistance", "kWh", BALANCE,
             "∫ resistance · v dt, tunnels and curves included"),
    _measure("friction_brake_kwh", "Friction brakes", "kWh", BALANCE, "∫ force of the friction brakes · v dt"),
    _measure("running_time_s", "Running time", "s", OWN, "time from departures to arrivals, summed over the sections"),
    _measure("late_s", "Delay at the last stop", "s", OWN,
             "arrival at the last stop − arrival by the timetable (early < 0)"),
    _measure("stop_error_m", "Stopping error", "m", "Askey & Sheridan (1995) judge stop accuracy",
             "mean of |position − stopping point| over all stops after the first", stop_error_m),
    _measure("speed_rmse_mps", "Speed error against the display", "m/s", "tracking error of manual control",
             "√ mean (v − shown)² over the seconds in motion with a shown speed; with a top speed, only the "
             "excess counts, and with the guide only the seconds in which a speed is to be held",
             speed_rmse_mps),
    _measure("speed_in_band_ratio", "Time in band", "1", "band of 3 km/h: assumption",
             "share of the seconds of `speed_rmse_mps` with |v − shown| ≤ 3 km/h", speed_in_band_ratio),
    _measure("effort_rmse_ratio", "Effort error against the display", "1", "tracking error of manual control",
             "√ mean (controller − shown effort)² over the seconds in motion with a shown effort; 1 is full "
             "scale", effort_rmse_ratio),
    _measure("reaction_s", "Reaction time", "s", "decisions of the driver",
             "median time from the glance at which advice was noticed to acting on it, without departures",
             reaction_s),
    _measure("response_s", "Response time", "s", "decisions of the driver",
             "median time from when advice was first shown to acting on it, without departures", response_s),
    _measure("compliance_ratio", "Compliance", "1", "decisions of the driver",
             "followed / (followed + refused) of the advice that was noticed", compliance_ratio),
    _measure("control_movements_per_min", "Control movements", "1/min",
             "Balfe et al. (2017) count controller movements",
             "number of times that a controller at rest begins to move, per minute in which the train moved",
             control_movements_per_min),
    _measure("power_brake_reversals", "Power–brake reversals", "1",
             "Large, Golightly & Taylor (2017) compare how often drivers switch",
             "times that traction is followed by brakes, or brakes by traction, with less than 10 s between (wheel "
             "force beyond ±1 kN, train moving)", power_brake_reversals),
    _measure("jerk_rms_mps3", "Jerk", "m/s³", "acceleration noise",
             "√ mean (Δa / 1 s)² over the seconds in which the train moved", jerk_rms_mps3),
    _measure("over_limit_s", "Time above limits", "s", OWN, "time more than 1 km/h above the permitted speed"),
    _measure("over_limit_mps", "Greatest speed above limits", "m/s", OWN,
             "max (v − limit) while more than 1 km/h above the permitted speed; 0 if never",
             lambda driven: driven.outcome.figures.violations.over_limit_mps),
    _measure("signals_passed", "Signals passed at danger", "1", OWN,
             "number of signals that the train's head passed at danger by more than 0.5 m"),
    _measure("advice_changes_per_min", "Advice changes", "1/min", OWN,
             "seconds that begin with a changed mode, speed (km/h) or effort (step of 0.2) on the display, per minute "
             "in which the train moved and advice was shown"),
    _measure("glances_per_min", "Glances at the display", "1/min", "decisions of the driver",
             "glances while the train moves, per minute in which it moved", glances_per_min),
    _measure("lapses", "Lapses of attention", "1", "decisions of the driver",
             "number of lapses of the driver's attention", lapses),
    *_figures(
        OWN,
        ("above_optimum_kwh", "Energy above the optimum", "kWh", "E − E_opt; empty if the two cannot be compared"),
        ("energy_planned_kwh", "Optimum of the plan", "kWh", "least energy for the times of the timetable"),
        ("energy_own_braking_kwh", "Optimum with the driver's braking", "kWh",
         "least energy for the times as driven, with the braking and the margin to limits that the human driver "
         "intends; for other drivers, with the braking that the advice plans"),
        ("simulated_s", "Length of the run", "s", "time from 10 s before the first departure to 10 s after the "
         "last arrival"),
        ("beyond_signal_m", "Greatest overrun of a signal", "m", "distance of the head beyond a signal at danger"),
        ("stops_missed", "Stops missed", "1", f"stops passed, or missed by more than {AT_STOP_M:g} m"),
    ),
    *_figures(
        BALANCE,
        ("energy_at_stops_kwh", "Energy at stops", "kWh", "energy at the current collector at stops on the way"),
        ("unreturned_kwh", "Brake resistors", "kWh", "braking energy that the line did not take"),
        ("comfort_kwh", "Comfort systems", "kWh", "energy of heating, air conditioning and light"),
        ("potential_kwh", "Energy gained in height", "kWh", "mass · g · (height at the end − height at the beginning)"),
        ("ledger_residual_ratio", "Unexplained energy", "1", "residual of the energy balance / energy"),
        ("kinetic_kwh", "Energy gained in speed", "kWh", "½ · inertial mass · (v² at the end − v² at the beginning)"),
        *((f"{name}_ratio", f"Share of {PART_WORDS.get(name, 'comfort systems')}", "1",
           f"`{name}_kwh` / sum of all irreversible losses") for name in SHARES),
    ),
    *_figures(
        OWN,
        ("advices_given", "Seconds with advice", "1", "seconds in which the train received advice"),
        ("advices_withdrawn", "Seconds without advice", "1", "seconds in which advice was withdrawn"),
        ("advices_unheard", "Seconds without a message", "1", "seconds in which no message arrived"),
        ("advices_above_limit", "Advice above the limit", "1", "seconds with an advised speed above the limit"),
        ("reversals", "Reversals of the advice", "1",
         "changes of the mode shown from traction to brake, or back, with less than 10 s of other modes between"),
        ("shortest_mode_s", "Shortest mode", "s",
         "shortest time for which a mode was shown before a different one; brakes and modes ended by a brake left out"),
        ("advice_restless", "Restless advice", "1",
         "1 if there are more than 2 changes a minute or a mode is shown for less than 8 s, else 0"),
        ("instructions", "Instructions", "1", "number of instructions of the guide"),
    ),
    *_figures(
        GRAMMAR,
        ("shortest_instruction_s", "Shortest instruction", "s",
         "shortest time for which an instruction was shown before a different one; brakes left out"),
        ("announced_ratio", "Changes announced", "1", "share of the changes of kind announced at least 8 s before"),
        ("brakes_led_ratio", "Brakes with a lead", "1", "share of the brakes shown at least 2 s before they were due"),
        ("effort_changes_per_brake", "Effort changes in a brake", "1", "changes of the braking effort / brakes"),
        ("missed_coasts", "Missed coasts", "1", "times that coasting ended more than 5.5 km/h from the speed shown"),
        ("vain_accelerations", "Accelerations in vain", "1",
         "accelerations that ended in a brake within 30 s and gained less than 1 s"),
        ("odd_speeds", "Odd speeds", "1", "instructions to a speed that is neither a multiple of 5 km/h nor a limit"),
        ("standing_acceleration_s", "Advice to accelerate at standstill", "s",
         "time with advice to accelerate for a standing train"),
        ("promises_kept_ratio", "Announced changes kept", "1",
         "share of the changes announced for the next 8 s that came within 10 s of the announced time"),
        ("above_limit_obeying_s", "Above the limit while obeying", "s",
         "time more than 0.5 m/s above the limit while the driver had followed the display for over 5 s"),
        ("hidden_limits", "Hidden limits", "1",
         "limits that began during an instruction to stop by eye, and that a steady brake to the stop would exceed"),
        ("last_word_acts", "Replacements by the last word", "1", "number of replacements by the last word"),
        ("availability_ratio", "Availability", "1", "seconds with advice / seconds from the first advice to the last"),
    ),
)  # fmt: skip
BUNDLED: Final = tuple(one.name for one in _LISTED)
"""The program's own measures, used for a design that names no measures."""


def _of_figures(name: str) -> Callable[[DriveTable], float | int | bool | None]:
    def of(table: DriveTable) -> float | int | bool | None:
        found = Drive(recording=table.recording, given=table.given).figures.as_dict()[name]
        return int(found) if isinstance(found, bool) else found

    return of


def _brought(door: Door) -> Measure:
    """A measure provided by another package as a function of the table of a drive."""

    def of_table(table: DriveTable) -> float | int | bool | None:
        found: float | int | bool | None = door.load()(table)
        return found

    def of(driven: Driven) -> float | int | bool | None:
        assert driven.table is not None
        return of_table(driven.table)

    plain, _, suffix = door.name.rpartition("_")
    title = (plain or suffix).replace("_", " ").capitalize()
    return Measure(
        name=door.name, title=title, unit=UNIT_OF.get(suffix, suffix), formula=f"{door.module}:{door.attribute}",
        source=f"package {door.package}", of=of, of_table=of_table,
    )  # fmt: skip


UNIT_OF: Final = {"kwh": "kWh", "ratio": "1", "mps": "m/s", "mps3": "m/s³", "min": "1/min"}
"""Units by the suffix of a column's name, if they differ from the suffix."""
MEASURES: Final = {
    **{one.name: replace(one, of_table=_of_figures(one.name)) if one.name in FIGURES else one for one in _LISTED},
    **{name: _brought(door) for name, door in installed(DOOR).items() if name not in BUNDLED},
}
"""Every measure by its name, which is also its column."""


def needs_table(names: Iterable[str]) -> bool:
    """Whether any of the measures needs the table of a drive; if so, the table must be kept."""
    return any(name in MEASURES and name not in BUNDLED for name in names)


def measured(driven: Driven, names: list[str]) -> dict[str, Any]:
    """The values of some measures of a trial, by name; None for a score of a questionnaire, which is not of a drive."""
    return {name: MEASURES[name].of(driven) if name in MEASURES else None for name in names}
