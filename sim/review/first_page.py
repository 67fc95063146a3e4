"""The first page of a report: four figures, three findings, and their certainty.

A driver's instructor reads it in two minutes. All figures come from `Drive`, and the rest of the report explains them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import pairwise
from typing import Any, Final, NamedTuple

from das.advice.regimes import InstructionKind
from das.domain.errors import DasError
from das.domain.units import KM, NS, kmh, kwh, kwh_figure, kwh_words
from sim.drive.above_optimum import NOT_COMPARABLE, energy_words, known_kwh, percent_of_optimum
from sim.drive.attribution import ActionSpan, Attribution, CauseStretch, slowest_stretch, worst_stretches
from sim.drive.calls import KeptCall
from sim.drive.causes import BY_SPEED, NOT_THE_DRIVERS, EnergyCause
from sim.drive.drive import Drive
from sim.drive.events import DriveEvent, EventKind, lateness_text, place_text
from sim.drive.limits import PassedSignal, signals_passed
from sim.drivers.kinds import DriverKind, External, FrictionPolicy, Presentation
from sim.drivers.presentations.presenter import presenter_of
from sim.recording.course import DriveClock, spell
from sim.recording.opening import CHANGED, NOTHING, OF, WHAT_IF
from sim.trips.estimate import BRAKING, ESTIMATE_FOREIGN_RATIO, MASS, RESISTANCE

RIGHT_TRAIN: Final = "Is it the right train?"
LIMIT_UNKNOWN: Final = "Whether it kept the line's limits is not known: the recording does not contain its line."
DRIVERS: Final[Mapping[str, str]] = {
    DriverKind.PERFECT: "a driver who follows advice exactly",
    DriverKind.LITERAL: "a driver who follows the guide's card and nothing else",
    DriverKind.FAST: "a driver who runs as fast as permitted",
    DriverKind.TOP_SPEED: "a driver who keeps a reduced maximum speed",
    DriverKind.TIMETABLE: "a driver who keeps to the timetable",
    DriverKind.HUMAN: "a simulated human",
    External.EXTERNAL: "a driver in a separate process",
    External.DESK: "a person at the cab desk",
}
HELD_UP: Final = (EventKind.SIGNAL, EventKind.STAND, EventKind.RESTRICTION)
"""Events that delay the train."""
LEAST_STAND_S: Final = 10.0
"""Shortest stand on the way (s) that counts as a reason for lateness."""
NOT_KNOWN: Final = "not known"
NUMBERS: Final = "The numbers mark the findings: the place of each, or the place where its cause lost most."
LOST: Final = "Below: the places where more was lost than by the optimum; the cause may lie before."
SIGNALS_UNKNOWN: Final = "The advice knew of no signal at danger: the driver had to follow the signal alone."
LESS_THAN_BEST: Final = "Less than the best possible energy is due to errors of positions and assumptions: no saving."
OPTIMUM: Final = "The optimum has the same times, without signals and temporary restrictions."
MOST_CHANGES: Final = 2
"""Largest number of changes of the lateness on the page."""


class PageFigure(NamedTuple):
    """One of the four figures: its name, its value in words, a note on it, and its values for programs.

    `told` has names with units (s, m/s, kWh); None stands for unknown values.
    """

    name: str
    value: str
    beside: str
    told: Mapping[str, Any]


def what_happened(drive: Drive) -> str:
    """Sentences on the run, its driver and display, its disturbances, and the places where most time was lost."""
    return " ".join([*ran(drive), *came_about(drive), *where_time_went(drive, MOST_CHANGES)])


def page_figures(drive: Drive) -> tuple[PageFigure, ...]:
    """The four figures: arrival against the timetable, energy used and above the optimum, time above the limit."""
    return _arrival(drive), _driven(drive), _above(drive), _over_limit(drive)


def _arrival(drive: Drive) -> PageFigure:
    name, clock = "Arrival against the timetable", drive.table.clock
    call = next((one for one in reversed(drive.calls[1:]) if not math.isnan(one.arrived_late_s)), None)
    told = {
        "arrived_at": None if call is None else call.name,
        "arrived_late_s": None if call is None else call.arrived_late_s,
    }
    if drive.table.own_timetable:
        arrived = [
            f"at {one.name}: there {clock.of_day(one.arrived_ns)}; " for one in drive.served[1:] if one.arrived_ns
        ]
        return PageFigure(name, NOT_KNOWN, f"{''.join(arrived[-1:])}no timetable was given", told)
    if call is None:
        return PageFigure(name, NOT_KNOWN, "no arrival with a time in the timetable was recorded", told)
    there = f"there {clock.of_day(call.arrived_ns)}"
    early_end = "" if call is drive.calls[-1] else ", the last stop with a known arrival"
    beside = f"at {call.name}{early_end}: due {clock.of_day(call.due_arrival_ns)}, {there}{_price(drive, call)}"
    return PageFigure(name, lateness_text(call.arrived_late_s), beside, told)


def _price(drive: Drive, call: KeptCall) -> str:
    """The least cost or greatest saving of an arrival off the timetable, in words; empty if small or not known."""
    legs = () if drive.energy.attribution is None or drive.energy.not_comparable else drive.energy.attribution.legs
    early_j = next((leg.early_j for leg in legs if leg.leg.end.name == call.name), None)
    if early_j is None or abs(kwh(early_j)) < NAMED_KWH:
        return ""
    word = "took" if early_j > 0.0 else "saved"
    being = f"being {lateness_text(call.arrived_late_s)} {word} {kwh_words(abs(early_j))}"
    return f"; {being}, not counted above the optimum"


def _driven(drive: Drive) -> PageFigure:
    name, driven_j = "Energy driven", drive.energy.driven_j
    told = {
        "energy_kwh": known_kwh(driven_j),
        "measured": drive.energy.measured,
        "train_known": train_known(drive),
    }
    if driven_j is None:
        beside = "for the reason next to it" if drive.energy.not_comparable else drive.energy.why_no_attribution
        return PageFigure(name, NOT_KNOWN, beside, told)
    how = "as simulated" if drive.energy.measured else "computed from positions"
    doubt = ", if it was this train" if _right_train(drive) else ""
    return PageFigure(name, kwh_words(driven_j), f"at the current collector, {how}{doubt}", told)


def _above(drive: Drive) -> PageFigure:
    name, above = "Energy above the optimum", drive.energy.above
    if above is None or drive.energy.not_comparable:
        nothing = dict.fromkeys(("above_optimum_kwh", "above_optimum_ratio"))
        return PageFigure(name, NOT_COMPARABLE, drive.energy.not_comparable, nothing)
    share = [] if above.ratio is None else [percent_of_optimum(above.ratio)]
    doubt = ["if it was this train"] if _right_train(drive) else []
    beside = "; ".join([*share, *doubt, *_likely(drive)])
    told = {
        "above_optimum_kwh": known_kwh(above.above_j),
        "above_optimum_ratio": above.ratio,
    }
    return PageFigure(name, energy_words(above.above_j or 0.0, None), beside, told)


def _likely(drive: Drive) -> list[str]:
    """The likely range of an estimate, and its value if the friction brake did all braking."""
    if drive.energy.likely is None:
        return []
    band = f"likely {kwh_figure(drive.energy.likely.low_j)} to {kwh_words(drive.energy.likely.high_j)}"
    if math.isnan(drive.energy.likely.by_friction_j):
        return [band]
    by_friction = kwh_words(drive.energy.likely.by_friction_j, finer=-1)
    return [f"{band} if the motors braked first, {by_friction} if friction alone did"]


def _right_train(drive: Drive) -> str:
    """A doubt about the assumed train, if the trip was faster or needed more force than this train allows."""
    over_kmh = [one.facts["over_kmh"] for one in drive.events if one.kind is EventKind.BEYOND_TRAIN]
    told = f"was up to {max(over_kmh):.0f} km/h faster than the assumed train can go" if over_kmh else ""
    short = beyond_ratio(drive)
    if not told and short > ESTIMATE_FOREIGN_RATIO:
        told = f"needs more force than the assumed train has for {100.0 * short:.0f} % of the time"
    if not told:
        return ""
    doubt = f"The trip {told}. {RIGHT_TRAIN}"
    if drive.energy.not_comparable:
        return doubt
    doubt += " If not, energies and findings are not valid."
    if drive.energy.likely is None or short <= ESTIMATE_FOREIGN_RATIO:
        return doubt
    off = [f"a {one.name} {one.assumed}" for one in drive.energy.likely.unknowns if one.name in (MASS, RESISTANCE)]
    return f"{doubt} The likely range is for {' and '.join(off)}, because the train's force is not sufficient."


def beyond_ratio(drive: Drive) -> float:
    """The share of the time in which an estimated drive needed more force than the assumed train has; 0: not known."""
    try:
        return 0.0 if drive.energy.measured else drive.energy.any_attribution.beyond_train_ratio
    except DasError:
        return 0.0


def _over_limit(drive: Drive) -> PageFigure:
    name, found = "Time above the limit", drive.violations
    told = {"over_limit_s": found.over_limit_s, "over_limit_mps": found.over_limit_mps}
    if found.over_limit_s:
        return PageFigure(name, f"{found.over_limit_s:.0f} s", f"by up to {kmh(found.over_limit_mps):.0f} km/h", told)
    if not drive.limit_known:
        return PageFigure(name, NOT_KNOWN, "the recording does not contain its line", dict.fromkeys(told))
    return PageFigure(name, "0 s", "no limit was exceeded by more than 1 km/h", told)


def how_sure(drive: Drive) -> list[str]:
    """Sentences on the basis of the figures: energy measured or computed, train known or assumed, unknowns."""
    told = [] if drive.recording.complete else ["The recording was cut off: its end is missing."]
    told += [*_energy_sure(drive), *_range_sure(drive)]
    if drive.violations.over_limit_s:
        told.append("The time above the limit is read from the samples of position and speed, mostly one a second.")
    if not drive.limit_known:
        told.append(LIMIT_UNKNOWN)
    if drive.signals and drive.energy.shown.any_shown:
        told.append(SIGNALS_UNKNOWN)
    return told


def train_known(drive: Drive) -> bool:
    """Whether the optimum is the true train's, as recorded by a simulator; otherwise its train is assumed."""
    return drive.table.said.saving is not None and drive.table.said.saving.measured


def _energy_sure(drive: Drive) -> list[str]:
    if drive.energy.driven_j is None:
        return []
    told = [
        "The energy is that of the simulated train."
        if drive.energy.measured
        else "The energy was not measured; it is computed from positions."
    ]
    if train_known(drive):
        return [*told, "The train is known: the optimum is that of the true train, as the simulator recorded it."]
    return [*told, f"The train is assumed: {_train_words(drive)}."]


def _train_words(drive: Drive) -> str:
    if drive.energy.attribution is None:
        return "it is that of the vehicle file"
    vehicle = drive.table.inputs.vehicle
    length = f", {vehicle.train_length_m:.0f} m" if vehicle.train_length_m else ""
    return f"{vehicle.name}, {vehicle.mass_kg / 1000:.0f} t{length}"


def _range_sure(drive: Drive) -> list[str]:
    """The possible error of the energy above the optimum, and the unknown with the largest effect."""
    if drive.energy.above is None or drive.energy.not_comparable:
        return []
    if drive.energy.above.measured and train_known(drive):
        return [
            "The energy above the optimum has no range; its division into causes is computed with the train as planned."
        ]
    if drive.energy.measured:
        return ["The dependence of the energy above the optimum on that train is not known."]
    if drive.energy.likely is None:
        return ["The likely range of the energy above the optimum is not known."]
    told = [LESS_THAN_BEST] if (drive.energy.above.above_j or 0.0) < 0.0 else []
    told.append("The energy of a single finding is less certain than the likely range of the total.")
    unknowns = [one for one in drive.energy.likely.unknowns if one.name != BRAKING]
    largest = max(unknowns, key=lambda one: one.high_j - one.low_j, default=None)
    if largest is not None:
        told.append(f"That range depends mostly on the {largest.name}.")
    if not math.isnan(drive.energy.likely.by_friction_j):
        told.append("It depends even more on the brakes used, which were not recorded: the findings assume the motors.")
    return told


def first_page_dict(drive: Drive) -> dict[str, Any]:
    """The first page for programs: s, m/s, m and kWh; None stands for unknown values."""
    figures = {name: value for one in page_figures(drive) for name, value in one.told.items()}
    return {**figures, "findings": [one.as_dict(drive.table.clock) for one in findings(drive)]}


def page_dict(drive: Drive) -> dict[str, Any]:
    """The first page for its template: texts, without the picture."""
    found = findings(drive)
    return {
        "happened": what_happened(drive),
        "figures": page_figures(drive),
        "findings": [_row(one, drive) for one in found],
        "right_train": _right_train(drive),
        "why_none": _why_none(drive, found),
        "rest": _rest(drive, found),
        "caption": _caption(drive, found),
        "how_sure": how_sure(drive),
    }


def in_lines(drive: Drive) -> list[str]:
    """The first page for the terminal and for programs: the run, each figure and finding, and their certainty."""
    told = page_dict(drive)
    figures = [f"{one.name}: {one.value} ({one.beside})." for one in told["figures"]]
    found = [
        f"{number}. {one['cause']}, {one['energy']}: {one['text']} {one['next_time']} {'; '.join(one['where'])}."
        for number, one in enumerate(told["findings"], start=1)
    ]
    parts = (told["happened"], told["right_train"], *figures, *found, told["rest"], told["why_none"])
    return [one for one in (*parts, " ".join(told["how_sure"])) if one]


def _caption(drive: Drive, found: Sequence[DriveFinding]) -> str:
    compared = [] if drive.energy.attribution is None else [LOST, OPTIMUM]
    return " ".join(["Speed over distance.", *([NUMBERS] if found else []), *compared])


def _row(one: DriveFinding, drive: Drive) -> dict[str, Any]:
    return {
        "cause": f"{one.label[0].upper()}{one.label[1:]}",
        "text": one.text,
        "next_time": one.next_time,
        "where": one.where(drive.table.clock),
        "energy": "safety" if one.energy_j is None else kwh_words(one.energy_j),
    }


def _rest(drive: Drive, found: Sequence[DriveFinding]) -> str:
    """A sentence on the energy above the optimum outside the findings; empty if there is hardly any."""
    told_j = [one.energy_j for one in found if one.energy_j is not None]
    if not told_j or drive.energy.above is None or drive.energy.not_comparable:
        return ""
    rest_j = (drive.energy.above.above_j or 0.0) - sum(told_j)
    few = abs(kwh(rest_j)) < NAMED_KWH
    return "" if few else f"All other causes, and energy not attributed: {kwh_words(rest_j, signed=True)}."


def _why_none(drive: Drive, found: Sequence[DriveFinding]) -> str:
    """The reason why the page has no finding about energy; empty if none is needed."""
    if drive.energy.attribution is None:
        return f"The energy cannot be attributed: {drive.energy.why_no_attribution}."
    return "" if found else f"No cause took {NAMED_KWH} kWh or more above the optimum."


def title(drive: Drive) -> str:
    """Train, first and last stop, day and file, for the head of the page."""
    calls = [call for call in drive.calls if call.reached]
    way = f"{calls[0].name} – {calls[-1].name}, " if len(calls) > 1 else ""
    return f"{drive.recording.train}, {way}{_day(drive)} ({drive.name})"


def _day(drive: Drive) -> str:
    return f"{datetime.fromtimestamp(drive.table.clock.zero_ns * NS, drive.table.zone):%d %B %Y}".lstrip("0")


def ran(drive: Drive) -> list[str]:
    """Sentences on the date, route, times and lateness of the run."""
    clock, served, day, went = drive.table.clock, drive.served, _day(drive), drive.travelled
    km, lasted = f"{went.way_m / KM:.1f} km", spell(went.time_s)
    ahead = [call.name for call in drive.calls if not call.reached]
    ends = [f"The recording ends before {ahead[0]}."] if ahead else []
    if not went.between_stops:
        return [f"The recording of {drive.recording.train} on {day} covers {km} in {lasted}.", *ends]
    first, last = served[0], served[-1]
    left, arrived = _late(first.departed_late_s), _late(last.arrived_late_s)
    told = [
        f"On {day}, {drive.recording.train} ran the {km} from {first.name} to {last.name} in {lasted}.",
        f"It left at {clock.of_day(first.departed_ns)}{left} and arrived at {clock.of_day(last.arrived_ns)}{arrived}.",
    ]
    missed = [call.name for call in drive.calls if not call.served and call.reached]
    return [*told, *([f"It did not stop at {', '.join(missed)}."] if missed else []), *ends]


def _late(late_s: float) -> str:
    return "" if math.isnan(late_s) else f" ({lateness_text(late_s)})"


def came_about(drive: Drive) -> list[str]:
    """Sentences on the origin of the drive; none if the recording does not state it."""
    run = drive.table.run
    told = []
    if run.get("kind") == "run":
        driver, shown = DRIVERS.get(run.get("driver", ""), run.get("driver", "")), run.get("advice", "")
        day = (
            f"The run was simulated (scenario {run.get('scenario', '?')}, seed {run.get('seed', '?')}): {driver} drove"
        )
        told.append(f"{day} and was shown {_presentation(shown)}.")
        happens = run.get("happens", NOTHING)
        told.append("The run had no disturbances." if happens == NOTHING else f"Disturbances: {happens}.")
    elif run.get("kind") == "replay":
        told.append(f"It is a replay of {run.get('trip', 'a trip')}: the driver did not see the advice.")
    if WHAT_IF in run:
        of, changed = run.get(OF, "?"), run.get(CHANGED, "?")
        told.append(f"It is a what-if of {of}, {run[WHAT_IF]}; otherwise: {changed}.")
    return told


def _presentation(name: str) -> str:
    try:
        return presenter_of(Presentation(name)).phrase
    except ValueError:
        return name


def where_time_went(drive: Drive, most: int | None = None) -> list[str]:
    """A sentence for each leg and each stop at which the lateness changed, or for the `most` largest changes; nothing
    without a timetable."""
    calls = drive.served
    told: list[tuple[float, str]] = []
    for before, after in pairwise(calls):
        told += _at_stop(before)
        change_s = after.arrived_late_s - before.departed_late_s
        if not math.isnan(change_s) and abs(change_s) >= TOLD_S:
            word = "lost" if change_s > 0 else "made up"
            what = f"From {before.name} to {after.name} it {word} {abs(change_s):.0f} s against the timetable"
            told.append((abs(change_s), f"{what}{_because(drive, before, after)}."))
    if calls and not told and not math.isnan(calls[-1].arrived_late_s):
        told.append((0.0, f"It never lost or made up more than {TOLD_S:.0f} s against the timetable."))
    kept = sorted((change_s for change_s, _ in told), reverse=True)[:most]
    return [text for change_s, text in told if change_s in kept]


def _at_stop(call: KeptCall) -> list[tuple[float, str]]:
    change_s = call.departed_late_s - (0.0 if math.isnan(call.arrived_late_s) else max(call.arrived_late_s, 0.0))
    if math.isnan(change_s) or abs(change_s) < TOLD_S:
        return []
    if change_s < 0:
        return [(-change_s, f"At {call.name} it made up {abs(change_s):.0f} s.")]
    return [(change_s, f"At {call.name} it stayed {change_s:.0f} s longer than necessary.")]


def _because(drive: Drive, before: KeptCall, after: KeptCall) -> str:
    on_way = [one for one in drive.events if _holds_up(one) and before.departed_ns <= one.time_ns <= after.arrived_ns]
    words = dict.fromkeys(_held_up(one) for one in on_way)
    return f"; on the way: {'; '.join(words)}" if words else ""


def _holds_up(one: DriveEvent) -> bool:
    """Whether an event delayed the train: a short stand before a stop and the end of a restriction do not."""
    short = one.kind is EventKind.STAND and (one.last_ns - one.time_ns) * NS < LEAST_STAND_S
    ends = one.kind is EventKind.RESTRICTION and not one.text.startswith("restriction received")
    return one.kind in HELD_UP and not short and not ends


def _held_up(one: DriveEvent) -> str:
    lasted_s = (one.last_ns - one.time_ns) * NS
    match one.kind:
        case EventKind.SIGNAL:
            return f"a signal at danger, in sight from {place_text(one.s_m)} for {lasted_s:.0f} s"
        case EventKind.STAND:
            return f"a stand of {lasted_s:.0f} s at {place_text(one.s_m)}"
        case _:
            return one.text


NAMED_KWH: Final = 0.1
"""Least energy (kWh) of a cause that the page names."""
TOLD_S: Final = 3.0
"""Smallest loss of time (s) that is mentioned."""
MOST_FINDINGS: Final = 3
FRICTION: Final[Mapping[str, str]] = {
    FrictionPolicy.AS_MEASURED: "the simulated driver, who brakes partly by friction whatever the display shows",
    FrictionPolicy.ELECTRIC_FIRST: "the simulated driver, who brakes by friction only if the motors cannot",
    FrictionPolicy.BY_ADVICE: "the simulated driver, who brakes partly by friction except under advice on effort",
}
TOLD_KMH: Final = 3.0
"""Least difference (km/h) of mean speeds that is stated."""
MOST_PLACES: Final = 3
"""Largest number of places that a finding names."""
BY_ADVICE: Final = "hurried by the advice"
"""The label of `EnergyCause.LATENESS` if advice was shown."""
SAFETY_LABELS: Final = {EventKind.OVERSPEED: "above the limit", EventKind.MISSED_STOP: "stop missed"}
"""The kinds of events that are findings about safety, each in words."""
SAFER: Final = "Next time: begin to brake sooner, and keep a margin."
GAINED: Final = "Next time: keep a margin; a limit applies until the whole train has left it."
"""Advice to the driver if the train did not merely brake too late, but gained speed above the limit."""
GAINED_MPS: Final = 0.5
"""Least rise (m/s) in speed, from the moment at which the limit is exceeded, for a train to count as gaining speed."""
DOES: Final = {
    InstructionKind.TRACTION: "accelerating",
    InstructionKind.HOLD: "holding",
    InstructionKind.COAST: "coasting",
    InstructionKind.BRAKE: "braking",
}
"""Driving regimes of the best run, in words."""
SIGNAL_PASSED: Final = "signal-passed"
"""The code of a finding about a signal that was passed at danger."""


class FoundPlace(NamedTuple):
    """Place and time of a finding: its ends (m) and their times (ns since 1970).

    `energy_j` is the energy above the optimum that the cause took there (J); None for a finding about safety, for which
    no energy is counted. For a cause about speed or brakes, `mean_mps` is the mean speed there, as driven and of the
    optimum (m/s), and `best` the optimum's act there.
    """

    start_m: float
    end_m: float
    start_ns: int
    end_ns: int
    energy_j: float | None = None
    mean_mps: tuple[float, float] | None = None
    best: ActionSpan | None = None

    def words(self, clock: DriveClock) -> str:
        """Place and time in words; the picture next to them has the stops."""
        start, end = f"{self.start_m / KM:.1f}", f"{self.end_m / KM:.1f}"
        at = f"Km\u00a0{start}" if start == end else f"Km\u00a0{start} to {end}"
        energy = "" if self.energy_j is None else f", {kwh_words(self.energy_j)}"
        return f"{at}, {clock.of_day(self.start_ns)}{energy}{best_words(self.best, self.mean_mps)}"

    def as_dict(self, clock: DriveClock) -> dict[str, Any]:
        """The place for programs: times in s on the drive's clock and in ns since 1970, the energy in kWh."""
        return {
            "start_m": self.start_m,
            "end_m": self.end_m,
            "time_ns": self.start_ns,
            "time_s": clock.since_s(self.start_ns),
            "end_s": clock.since_s(self.end_ns),
            "above_optimum_kwh": known_kwh(self.energy_j),
            "mean_speed_mps": None if self.mean_mps is None else self.mean_mps[0],
            "mean_speed_optimum_mps": None if self.mean_mps is None else self.mean_mps[1],
            "optimum_does": None if self.best is None else self.best.action,
            "optimum_does_from_m": None if self.best is None else self.best.start_m,
            "optimum_does_to_m": None if self.best is None else self.best.end_m,
        }


def best_words(best: ActionSpan | None, mean_mps: tuple[float, float] | None) -> str:
    """The act of the best run at a place, its ends, and the mean speeds if they differ by much."""
    span = "" if best is None else f"{DOES[best.action]} from km\u00a0{best.start_m / KM:.1f} to {best.end_m / KM:.1f}"
    driven, optimum = (0.0, 0.0) if mean_mps is None else map(kmh, mean_mps)
    if abs(driven - optimum) < TOLD_KMH:
        return f"; best: {span}" if span else ""
    return f", at {driven:.0f} km/h; best: at {optimum:.0f} km/h{', ' if span else ''}{span}"


@dataclass(frozen=True, kw_only=True)
class DriveFinding:
    """A finding for instructor and driver to discuss: its cause, event, place and time.

    `code` names the cause for programs: a cause of the energy attribution, or a kind of event. `label` is its name.
    `places` are those of the event or of the greatest loss, the worst first. `energy_j` is the cause's energy above the
    optimum, over the whole drive (J); None for a finding about safety. `next_time` is the advice to the driver.
    """

    code: str
    label: str
    text: str
    places: tuple[FoundPlace, ...]
    next_time: str = SAFER
    energy_j: float | None = None

    def where(self, clock: DriveClock) -> list[str]:
        """The places in words."""
        return [place.words(clock) for place in self.places]

    def as_dict(self, clock: DriveClock) -> dict[str, Any]:
        """The finding for programs, energies in kWh."""
        return {
            "cause": self.code,
            "label": self.label,
            "text": self.text,
            "next_time": self.next_time,
            "above_optimum_kwh": known_kwh(self.energy_j),
            "places": [one.as_dict(clock) for one in self.places],
        }


def findings(drive: Drive) -> tuple[DriveFinding, ...]:
    """The findings of the page, at most three: those about safety first, then the causes that took most energy."""
    return (*_safety_findings(drive), *_energy_findings(drive))[:MOST_FINDINGS]


def _safety_findings(drive: Drive) -> Iterator[DriveFinding]:
    """Signals passed at danger, speeds above the limit and missed stops: one finding for each, about the worst."""
    passed = sorted(signals_passed(drive.table.course, drive.signals), key=lambda one: -one.beyond_m)
    if passed:
        yield _at_signal(passed[0], len(passed))
    for kind in SAFETY_LABELS:
        events = [one for one in drive.events if one.kind is kind]
        if events:
            worst = max(events, key=lambda one: float(one.facts.get("over_kmh", 0.0)))
            yield _of_event(drive, worst, len(events))


def _at_signal(passed: PassedSignal, count: int) -> DriveFinding:
    text = f"The head of the train went {passed.beyond_m:.0f} m beyond it.{_worst_of(count)}"
    place = FoundPlace(passed.s_m, passed.s_m, passed.time_ns, passed.time_ns)
    return DriveFinding(code=SIGNAL_PASSED, label="signal passed at danger", text=text, places=(place,))


def _of_event(drive: Drive, event: DriveEvent, count: int) -> DriveFinding:
    ends = drive.table.course.time_ns.searchsorted((event.time_ns, event.last_ns))
    start_m, end_m = drive.table.course.s_m[ends].tolist()
    place = FoundPlace(start_m, end_m, event.time_ns, event.last_ns)
    text = f"{event.text[0].upper()}{event.text[1:]}.{_worst_of(count)}"
    speeds_mps = drive.table.course.speed_mps[ends[0] : ends[1] + 1]
    gained = event.kind is EventKind.OVERSPEED and speeds_mps.max() > speeds_mps[0] + GAINED_MPS
    return DriveFinding(
        code=str(event.kind), label=SAFETY_LABELS[event.kind], text=text, places=(place,),
        next_time=GAINED if gained else SAFER,
    )  # fmt: skip


def _worst_of(count: int) -> str:
    return "" if count == 1 else f" This is the worst of {count} times."


def _energy_findings(drive: Drive) -> Iterator[DriveFinding]:
    attribution = drive.energy.attribution
    for cause, energy_j in () if attribution is None else told_causes(attribution):
        assert attribution is not None
        worst = worst_stretches(attribution, cause, MOST_PLACES)
        if cause is EnergyCause.REST or kwh(energy_j) < NAMED_KWH or not worst:
            continue
        by_advice = cause is EnergyCause.LATENESS and attribution.advice_shown
        label, text = (BY_ADVICE, _hurried_for(drive, worst)) if by_advice else (cause.label, cause.meaning)
        if cause is EnergyCause.TOO_MUCH_EFFORT:
            text += _given_away(drive, attribution)
        if cause is EnergyCause.FRICTION:
            chosen = friction_chosen_by(drive)
            unknown = " It was not recorded whether the driver or the brake control chose the friction brake."
            text += f" It is due to {chosen}." if chosen else unknown
        yield DriveFinding(
            code=str(cause),
            label=label,
            text=text,
            places=tuple(_found_place(drive, cause, one) for one in worst),
            energy_j=energy_j,
            next_time=NOT_THE_DRIVERS if by_advice else cause.next_time,
        )


def best_forbidden(drive: Drive, start_m: float, end_m: float, start_ns: int, end_ns: int) -> bool:
    """Whether the driver could not have followed the best run at a place.

    The best run ignores signals at danger and temporary restrictions.
    """
    red = any(one.start_ns <= end_ns and one.end_ns >= start_ns for one in drive.signals)
    length_m = drive.table.inputs.vehicle.train_length_m
    slow = (one for one in drive.temporary_limits if one.told_ns <= end_ns and one.lifted_ns >= start_ns)
    return red or any(one.restriction.start_m <= end_m and one.restriction.end_m + length_m >= start_m for one in slow)


def _given_away(drive: Drive, attribution: Attribution) -> str:
    slow = slowest_stretch(attribution)
    if slow is None or slow.driven_s - slow.optimum_s < TOLD_S:
        return ""
    place, way_m = f"km\u00a0{slow.start_m / KM:.1f} to {slow.end_m / KM:.1f}", slow.end_m - slow.start_m
    forbidden = best_forbidden(drive, slow.start_m, slow.end_m, slow.start_ns, slow.end_ns)
    best = "" if forbidden else best_words(slow.best, (way_m / slow.driven_s, way_m / slow.optimum_s))
    return f" Most time was lost from {place}: {slow.driven_s - slow.optimum_s:.0f} s{best}."


def _hurried_for(drive: Drive, stretches: Sequence[CauseStretch]) -> str:
    ends = {one.leg.end.name for one in stretches}
    missed = [f"{one.name} ({lateness_text(one.arrived_late_s)})" for one in drive.calls[1:] if one.name in ends]
    return f"The advice aimed at arrival times that were missed nevertheless: {', '.join(missed)}."


def _found_place(drive: Drive, cause: EnergyCause, stretch: CauseStretch) -> FoundPlace:
    """The place at which a cause took energy; for a temporary restriction the restricted stretch, although energy is
    already lost from the announcement on."""
    way_m, speeds = stretch.end_m - stretch.start_m, cause in BY_SPEED or cause is EnergyCause.FRICTION
    place = FoundPlace(
        stretch.start_m, stretch.end_m, stretch.start_ns, stretch.end_ns, stretch.energy_j,
        (way_m / stretch.driven_s, way_m / stretch.optimum_s) if speeds else None, stretch.best if speeds else None,
    )  # fmt: skip
    if best_forbidden(drive, place.start_m, place.end_m, place.start_ns, place.end_ns):
        place = place._replace(mean_mps=None, best=None)
    told = [one for one in drive.events if one.kind is EventKind.RESTRICTION]
    if cause is not EnergyCause.RESTRICTION or not told:
        return place
    facts = min(told, key=lambda one: abs(one.time_ns - place.start_ns)).facts
    start_m, end_m = float(facts["start_m"]), float(facts["end_m"])
    ends = drive.table.course.s_m.searchsorted((start_m, end_m)).clip(max=len(drive.table.course.s_m) - 1)
    start_ns, end_ns = drive.table.course.time_ns[ends].tolist()
    return place._replace(start_m=start_m, end_m=end_m, start_ns=start_ns, end_ns=end_ns)


def friction_chosen_by(drive: Drive) -> str:
    """The words for why a simulated driver used the friction brake; empty for any other drive."""
    run = drive.table.run
    return FRICTION.get(run.get("friction_policy", ""), "") if run.get("driver") == DriverKind.HUMAN else ""


def told_causes(attribution: Attribution) -> list[tuple[EnergyCause, float]]:
    """The causes with their energies (J), the largest first; for an estimated drive, only those that are not 0."""
    parts = [one for one in attribution.by_cause.items() if one[1] or attribution.above.measured]
    return sorted(parts, key=lambda one: -one[1])
