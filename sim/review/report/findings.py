"""The findings of a report's first page: events with place, time and cause, and advice for the next time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from das.advice.regimes import InstructionKind
from das.domain.units import KM, kmh, kwh, kwh_words
from sim.drive.attribution.attribution import ActionSpan, Attribution, CauseStretch, slowest_stretch, worst_stretches
from sim.drive.attribution.causes import BY_SPEED, NOT_THE_DRIVERS, EnergyCause
from sim.drive.drive import Drive
from sim.drive.events import DriveEvent, EventKind, lateness_text
from sim.drive.limits import PassedSignal, signals_passed
from sim.drivers.kinds import DriverKind, FrictionPolicy
from sim.recording.course import DriveClock

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
            "above_optimum_kwh": None if self.energy_j is None else kwh(self.energy_j),
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
            "above_optimum_kwh": None if self.energy_j is None else kwh(self.energy_j),
            "places": [one.as_dict(clock) for one in self.places],
        }


def findings(drive: Drive) -> tuple[DriveFinding, ...]:
    """The findings of the page, at most three: those about safety first, then the causes that took most energy."""
    return (*_safety_findings(drive), *_energy_findings(drive))[:MOST_FINDINGS]


def _safety_findings(drive: Drive) -> Iterator[DriveFinding]:
    """Signals passed at danger, speeds above the limit and missed stops: one finding for each, about the worst."""
    passed = sorted(signals_passed(drive.table.course, drive.signals), key=lambda one: -one.beyond_m)
    if passed:
        yield _at_signal(drive, passed[0], len(passed))
    for kind in SAFETY_LABELS:
        events = [one for one in drive.events if one.kind is kind]
        if events:
            worst = max(events, key=lambda one: float(one.facts.get("over_kmh", 0.0)))
            yield _of_event(drive, worst, len(events))


def _at_signal(drive: Drive, passed: PassedSignal, count: int) -> DriveFinding:
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
            text += f" {_friction_words(drive)}"
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


def _friction_words(drive: Drive) -> str:
    chosen = friction_chosen_by(drive)
    if not chosen:
        return "It was not recorded whether the driver or the brake control chose the friction brake."
    return f"It is due to {chosen}."


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
