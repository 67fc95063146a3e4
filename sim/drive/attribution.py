"""The energy attribution of a recorded drive: how much energy each leg took above the optimum, where and why.

By cause: W(t) = energy driven so far + least energy from here to the end of the leg for the arrival as driven. W, the
committed energy, begins with the optimum for the same times and ends with the energy as driven. Its rise between two
moments is the energy that even the best driving from then on can no longer save.

By place: each place is charged with the energy at the current collector minus the rise of the kinetic energy,
E(s) − m·ρ·v(s)²/2: the value of the drive minus that of the optimum. The potential energy is the same in both. Energy
that a train keeps as speed is therefore counted where it is lost, not where it was drawn. Drive and optimum both begin
and end at a stand, so the differences sum to that of the whole leg.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.advice.regimes import InstructionKind
from das.domain.errors import DasError, InfeasibleError
from das.domain.restriction import LATEST_NS, Restriction
from das.domain.trajectory import Trajectory
from das.domain.units import NS, kwh
from das.domain.vehicle import Vehicle
from das.solver.front import Front
from das.solver.solution import Fit, Solution
from das.solver.solve import solve_front
from sim.drive.above_optimum import AboveOptimum, known_kwh
from sim.drive.causes import EnergyCause, Judge, Moment, ShownAdvice, coasts_to_brake, effort_ratio
from sim.drive.legs import ComparedLeg, DrivenLeg, LegEnergies, section_of_leg
from sim.drive.limits import Signal, signals
from sim.drive.table import DriveTable
from sim.recording.course import Floats
from sim.recording.opening import DriveInputs

LATE_S = 0.1
"""Largest lateness (s) against the wanted time of a trajectory that is accepted."""

Told = frozenset[Restriction]


class Epoch(NamedTuple):
    """The restrictions, without their time windows, that were known and in force from a moment (ns) on."""

    since_ns: int
    told: Told


def epochs_of(table: DriveTable) -> tuple[Epoch, ...]:
    """The epochs, one from each change of the known restrictions in force; the first epoch has no restrictions.

    They change when the node receives a list, and when a restriction of the list begins or ceases to be in force.
    """
    found = [Epoch(-(2**63), frozenset())]
    lists = [(one.time_ns, one.valid) for one in table.said.restrictions]
    for (since_ns, told), (until_ns, _) in pairwise([*lists, (LATEST_NS, ())]):
        edges = {edge_ns for one in told if one.has_window for edge_ns in one.counting_ns}
        for at_ns in sorted({since_ns, *(edge_ns for edge_ns in edges if since_ns < edge_ns < until_ns)}):
            counting = frozenset(one.unlimited for one in told if one.counts_at(at_ns))
            if counting != found[-1].told:
                found.append(Epoch(at_ns, counting))
    return tuple(found)


class Knowledge:
    """The optimal trajectories of a leg with the restrictions known at a time.

    Each set of restrictions is solved once, on demand.
    """

    def __init__(self, inputs: DriveInputs, compared: ComparedLeg, epochs: tuple[Epoch, ...]) -> None:
        self.inputs, self.leg, self._untold = inputs, compared.leg, compared.front
        self._changes_ns = np.array([epoch.since_ns for epoch in epochs])
        self._told = tuple(self._here(epoch.told) for epoch in epochs)
        self.front = cache(self._solved)
        """The front with restrictions: the optimal trajectories for all trip times."""

    def told_at(self, time_ns: int) -> Told:
        """The restrictions on this leg that were known and in force at a time (ns)."""
        return self._told[int(np.searchsorted(self._changes_ns, time_ns, side="right")) - 1]

    def remaining(self, told: Told, time_s: float, s_m: float, speed_mps: float) -> Solution | None:
        """The optimal trajectory from a state to the end of the leg in a time (s); None if none arrives in time."""
        try:
            run = self.front(told).trajectory(time_s, s_m, speed_mps)
        except (DasError, InfeasibleError):  # from here the section cannot be finished, or there is no time left
            return None
        return None if run.fit is Fit.LATE and run.time_s > time_s + LATE_S else run

    def _solved(self, told: Told) -> Front:
        return solve_front(section_of_leg(self.inputs, self.leg, told)) if told else self._untold

    def _here(self, told: Told) -> Told:
        first_m, last_m = float(self.leg.motion.s_m[0]), float(self.leg.motion.s_m[-1])
        length_m = self.inputs.vehicle.train_length_m
        return frozenset(one for one in told if one.is_under(first_m, last_m, length_m))


MOST_CUTS = 4000
"""Largest number of moments of a drive whose remaining optimum is computed: one a second for about an hour."""


MISSED_S = 10.0
"""Largest lateness (s) of a train that counts as on time; a later train has hurried without success."""
HURRYING = (EnergyCause.AS_ADVISED, EnergyCause.TOO_MUCH_EFFORT)
"""Causes that become lateness if the driver hurried for an arrival that the train then missed."""


class Rise(NamedTuple):
    """A rise of the committed energy (J): the cuts at which it begins and ends, and its cause."""

    first: int
    last: int
    cause: EnergyCause
    energy_j: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Committed:
    """The committed energy at the cuts of a leg, the moments for which it is computed, and the cause of each rise.

    Arrays of shape (cuts,): `sample` (index into the leg's samples) and `energy_j` (NaN where no trajectory arrives in
    time from there). Shape (cuts − 1,): `causes`, of the time from each cut to the next, and `news_j`, the part of the
    rise (J) that news of restrictions caused.
    """

    sample: NDArray[np.intp]
    energy_j: Floats
    causes: tuple[EnergyCause, ...]
    news_j: Floats

    def by_cause(self) -> dict[EnergyCause, float]:
        """The energy (J) of each cause; the parts sum to the whole rise."""
        parts: dict[EnergyCause, float] = {}
        for rise in self.rises():
            parts[rise.cause] = parts.get(rise.cause, 0.0) + rise.energy_j
        return parts

    def rises(self) -> Iterator[Rise]:
        """Every rise between two cuts at which the committed energy is known, with its cause, in order of time.

        If it is not known at some cuts, the rise over them belongs to the cause that prevailed there, or to the rest if
        none did. The cost of news of restrictions is a separate rise.
        """
        known = np.flatnonzero(np.isfinite(self.energy_j))
        for first, last in pairwise(known.tolist()):
            news_j = float(self.news_j[first:last].sum())
            rise_j = float(self.energy_j[last] - self.energy_j[first]) - news_j
            yield Rise(first, last, together(self.causes[first:last]), rise_j)
            if news_j:
                yield Rise(first, last, EnergyCause.RESTRICTION, news_j)


MAIN_SHARE = 0.8
"""Least share of a span of time that a cause must have to count as the cause of the whole span."""


def together(causes: Sequence[EnergyCause]) -> EnergyCause:
    """The cause of several moments together: the cause that nearly all of them have, else the rest."""
    counts = {cause: causes.count(cause) for cause in set(causes)}
    most = max(counts, key=lambda cause: counts[cause])
    return most if counts[most] >= MAIN_SHARE * len(causes) else EnergyCause.REST


def committed(
    knowledge: Knowledge,
    energies: LegEnergies,
    shown: ShownAdvice,
    signals: Sequence[Signal],
    every: int,
) -> Committed:
    """The committed energy of a driven leg at each `every`-th sample, with the cause of each rise."""
    leg = knowledge.leg
    motion, vehicle, last = leg.motion, knowledge.inputs.vehicle, len(leg.motion.s_m) - 1
    samples = np.unique(np.append(np.arange(0, last + 1, every), last)).astype(np.intp)  # the last one, too
    energy_j, news_j = np.full(len(samples), math.nan), np.zeros(len(samples) - 1)
    causes: list[EnergyCause] = []
    judge, told = Judge(), Told()
    in_vain = leg.left_s is not None and leg.trip_s > leg.left_s + MISSED_S
    for k, i in enumerate(samples[:-1].tolist()):
        at_ns = int(motion.time_ns[i])
        state = (leg.trip_s - float(leg.time_s[i]), float(motion.s_m[i]), float(motion.speed_mps[i]))
        best = knowledge.remaining(told, *state)
        energy_j[k] = energies.motors_j[i] + _energy_j(best)
        news = told != knowledge.told_at(at_ns)
        if news:
            told, before = knowledge.told_at(at_ns), best
            best = knowledge.remaining(told, *state)
            news_j[k] = np.nan_to_num(_energy_j(best) - _energy_j(before))
        signal = any(one.start_ns <= at_ns <= one.end_ns for one in signals)
        moment = _moment(energies, float(leg.time_s[i]), best, vehicle)
        cause = judge.cause(replace(moment, seen=shown.at(at_ns), signal=signal))
        if in_vain and cause in HURRYING:
            cause = EnergyCause.LATENESS
        causes.append(EnergyCause.RESTRICTION if news and not news_j[k] else cause)
    if math.isnan(energy_j[0]):  # the planned train cannot be as fast: its fastest trajectory is used as the optimum
        energy_j[0] = knowledge.front(Told()).fastest().balance.input
    energy_j[-1] = energies.motors_j[-1]
    return Committed(sample=samples, energy_j=energy_j, causes=tuple(causes), news_j=news_j)


def spacing(legs: Sequence[DrivenLeg]) -> int:
    """The number of samples from one cut to the next, so that a long drive has no more than `MOST_CUTS` cuts."""
    return max(math.ceil(sum(len(leg.motion.s_m) for leg in legs) / MOST_CUTS), 1)


def _energy_j(run: Solution | None) -> float:
    return math.nan if run is None else run.balance.input


def _moment(energies: LegEnergies, since_s: float, best: Solution | None, vehicle: Vehicle) -> Moment:
    driven = energies.trajectory
    run = None if best is None else best.trajectory
    node = max(int(np.searchsorted(driven.t_s, since_s, side="right")) - 1, 0)
    return Moment(
        speed_mps=float(driven.v_mps[node]),
        driven_ratio=effort_ratio(driven, vehicle, since_s),
        best_ratio=math.nan if run is None else effort_ratio(run, vehicle, 0.0),
        coasts_to_brake=run is not None and coasts_to_brake(run, vehicle),
    )


PLACE_M = 100.0
"""Length of a place (m)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Places:
    """Stretches of a leg, arrays of shape (stretches,): ends (m), times (s) and energies (J), driven and optimum.

    `driven_j` and `optimum_j` are drawn at the current collector there (fed back: negative). `lost_more_j` is the
    energy that the drive lost there, less the energy that the optimum lost.
    """

    start_m: Floats
    end_m: Floats
    driven_s: Floats
    optimum_s: Floats
    driven_j: Floats
    optimum_j: Floats
    lost_more_j: Floats


def drawn_by_optimum(optimum: Solution, optimum_j: float) -> Floats:
    """Energy drawn by the optimum up to each of its nodes (J), shape (nodes,).

    `optimum` is that of the planned train. Of the true train's optimum only the total energy may be known, `optimum_j`;
    the planned train's energies are scaled to it, so that the energies of places sum to those of the drive.
    """
    run = optimum.trajectory
    drawn_j = np.concatenate(([0.0], np.cumsum(run.input_j(run.loss_j(optimum.section.loss)))))
    return drawn_j * (optimum_j / drawn_j[-1]) if drawn_j[-1] > 0.0 else drawn_j


def places_between(edges_m: Floats, leg: DrivenLeg, energies: LegEnergies, optimum: Solution, best_j: Floats) -> Places:
    """The energies between the rising positions `edges_m`; the first and the last are the ends of the leg.

    `best_j` is the energy drawn by the optimum up to each of its nodes (J).
    """
    run, motion = optimum.trajectory, leg.motion
    inertial_kg = optimum.section.vehicle.inertial_mass_kg
    moving = np.append(np.flatnonzero(np.diff(motion.s_m) > 0), -1)  # of several samples at one position, the last
    # A train may have stood a little beyond the end of the route; its energy counts up to where it stood.
    driven_edges_m = np.concatenate((motion.s_m[:1], edges_m[1:-1], motion.s_m[-1:]))

    def driven(values: Floats) -> Floats:
        return np.diff(np.interp(driven_edges_m, motion.s_m[moving], values[moving]))

    def best(values: Floats) -> Floats:
        return np.diff(np.interp(edges_m, run.s_m, values))

    driven_kinetic_j, best_kinetic_j = 0.5 * inertial_kg * motion.speed_mps**2, 0.5 * inertial_kg * run.v_mps**2
    return Places(
        start_m=edges_m[:-1],
        end_m=edges_m[1:],
        driven_s=driven(leg.time_s),
        optimum_s=best(run.t_s),
        driven_j=driven(energies.balance_j),
        optimum_j=best(best_j),
        lost_more_j=driven(energies.balance_j - driven_kinetic_j) - best(best_j - best_kinetic_j),
    )


def even_edges(first_m: float, last_m: float) -> Floats:
    """The ends of the leg and every full 100 m between them (m), none closer to an end than half of that."""
    inside_m = np.arange(np.ceil(first_m / PLACE_M), np.floor(last_m / PLACE_M) + 1) * PLACE_M
    kept = inside_m[(inside_m > first_m + PLACE_M / 2.0) & (inside_m < last_m - PLACE_M / 2.0)]
    return np.concatenate(([first_m], kept, [last_m]))


OTHER_TRAIN: Final = "the true train, wind and rail"
"""Reason, in words, why the optima of the true and the planned train differ."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LegAttribution(ComparedLeg):
    """The energy attribution of one leg.

    `optimum_j` is the least energy for the same trip time (J): of the true train if a simulator recorded it, else of
    the planned train.
    `timetable_j` and `left_j` are the least energies for the timetable's trip time and for the time that was left from
    the departure to the timetable's arrival; the fastest trajectory's if that time is too short, None without a
    timetable. `best_drawn_j` is the energy drawn by the optimum up to each of its nodes (J), see `drawn_by_optimum`.
    """

    optimum_j: float
    committed: Committed
    timetable_j: float | None
    left_j: float | None
    best_drawn_j: Floats
    even: Places

    @property
    def other_train_j(self) -> float:
        """Energy of the true train's optimum minus the energy of the planned train's (J)."""
        return self.optimum_j - self.optimum.balance.input

    @property
    def by_cause(self) -> dict[EnergyCause, float]:
        """The energy above the optimum for the same trip time, by cause (J); the parts sum to the whole difference."""
        energies, parts = self.energies, self.committed.by_cause()
        friction_j = float(energies.blended_j[-1] - energies.motors_j[-1])
        train_j = float(energies.balance_j[-1] - energies.blended_j[-1]) - self.other_train_j
        rest_j = float(self.committed.energy_j[0]) - self.optimum.balance.input
        for cause, energy_j in (
            (EnergyCause.FRICTION, friction_j),
            (EnergyCause.TRAIN, train_j),
            (EnergyCause.REST, rest_j),
        ):
            parts[cause] = parts.get(cause, 0.0) + energy_j
        return parts

    def by_place(self, cause: EnergyCause) -> Floats:
        """The energy above the optimum (J) at each place of `even` that is due to a cause."""
        edges_m, motion, energies = np.append(self.even.start_m, self.even.end_m[-1:]), self.leg.motion, self.energies
        if cause is EnergyCause.FRICTION:
            at_m, energy_j = motion.s_m[1:], np.diff(energies.blended_j - energies.motors_j)
        elif cause is EnergyCause.TRAIN:
            at_m, energy_j = motion.s_m[1:], np.diff(energies.balance_j - energies.blended_j)
        else:
            rises = [one for one in self.committed.rises() if one.cause is cause]
            ends = self.committed.sample[[[one.first, one.last] for one in rises]] if rises else np.empty((0, 2), int)
            at_m, energy_j = motion.s_m[ends].mean(axis=1), np.array([one.energy_j for one in rises])
        inside_m = np.clip(at_m, edges_m[0], edges_m[-1])
        return np.histogram(inside_m, edges_m, weights=energy_j)[0].astype(np.float64)

    @property
    def recovered_j(self) -> float | None:
        """Cost of a late departure (J): least energy for the time left, minus that for the timetable's trip time."""
        return None if self.timetable_j is None or self.left_j is None else self.left_j - self.timetable_j

    @property
    def early_j(self) -> float | None:
        """Cost of arriving early (J), with optimal driving for either arrival; < 0 if arriving late saved energy."""
        return None if self.left_j is None else self.optimum.balance.input - self.left_j

    @property
    def against_timetable(self) -> dict[EnergyCause, float] | None:
        """The whole energy above the optimum for the timetable, by cause (J); None without a timetable."""
        if self.recovered_j is None or self.early_j is None:
            return None
        parts = self.by_cause
        parts[EnergyCause.TRAIN] += self.other_train_j
        return {**parts, EnergyCause.RECOVERED: self.recovered_j, EnergyCause.ARRIVAL: self.early_j}


@dataclass(frozen=True, kw_only=True, eq=False)
class Attribution:
    """The energy attributions of all legs of a drive; `above` is the energy that they attribute."""

    above: AboveOptimum
    legs: tuple[LegAttribution, ...]
    advice_shown: bool

    @property
    def other_train_j(self) -> float:
        """Energy of the true train's optimum minus that of the planned train's (J); 0 if the former is not known."""
        return sum(leg.other_train_j for leg in self.legs)

    @property
    def by_cause(self) -> Mapping[EnergyCause, float]:
        """The difference by cause (J), in the order of the causes; every cause that occurs in a leg is included."""
        return _summed([leg.by_cause for leg in self.legs])

    @property
    def beyond_train_ratio(self) -> float:
        """The share of the driving time in which the drive needs more force than the planned train has."""
        return sum(one.energies.beyond_s for one in self.legs) / sum(one.leg.trip_s for one in self.legs)

    @property
    def timetable_j(self) -> float | None:
        """Energy of the optimum for the timetable (J); None if a leg has no timetable."""
        known = [leg.timetable_j for leg in self.legs if leg.timetable_j is not None]
        return sum(known) if len(known) == len(self.legs) else None

    @property
    def against_timetable(self) -> Mapping[EnergyCause, float] | None:
        """The whole energy above the optimum for the timetable, by cause (J); None if a leg has no timetable."""
        parts = [leg.against_timetable for leg in self.legs]
        known = [one for one in parts if one is not None]
        return _summed(known) if len(known) == len(parts) else None


def _summed(parts: Sequence[Mapping[EnergyCause, float]]) -> dict[EnergyCause, float]:
    return {
        cause: sum(one.get(cause, 0.0) for one in parts) for cause in EnergyCause if any(cause in one for one in parts)
    }


def attribution_of(
    table: DriveTable, compared: Sequence[ComparedLeg], above: AboveOptimum, shown: ShownAdvice
) -> Attribution:
    """The energy attribution of a recorded drive, from its line and train, its legs with the planned train's optimum,
    its energy above the optimum, and what the driver was shown.

    It is made even if drive and optimum are not comparable.
    """
    inputs, epochs, seen = table.inputs, epochs_of(table), signals(table)
    every = spacing([one.leg for one in compared])
    optima_j = {(one.start, one.end): one.optimum_j for one in above.sections}
    legs = tuple(
        _leg_attribution(
            one, Knowledge(inputs, one, epochs),
            optima_j.get((one.leg.start.name, one.leg.end.name), one.optimum.balance.input), shown, seen, every,
        )
        for one in compared
    )  # fmt: skip
    return Attribution(above=above, legs=legs, advice_shown=shown.any_shown)


def _leg_attribution(
    found: ComparedLeg,
    knowledge: Knowledge,
    optimum_j: float,
    shown: ShownAdvice,
    seen: tuple[Signal, ...],
    every: int,
) -> LegAttribution:
    leg, front, optimum, energies = found.leg, found.front, found.optimum, found.energies
    section, least_s = front.section, optimum.least_time_s
    best_j = drawn_by_optimum(optimum, optimum_j)

    def least_j(time_s: float | None) -> float | None:
        return None if time_s is None else front.trajectory(max(time_s, least_s)).balance.input

    return LegAttribution(
        **vars(found),
        optimum_j=optimum_j,
        committed=committed(knowledge, energies, shown, seen, every),
        timetable_j=least_j(leg.timetable_s),
        left_j=least_j(leg.left_s),
        best_drawn_j=best_j,
        even=places_between(even_edges(section.start_m, section.end_m), leg, energies, optimum, best_j),
    )


def as_dict(attribution: Attribution) -> dict[str, Any]:
    """The energy attribution for programs: energies in kWh at the current collector, times in s, positions in m."""
    against = attribution.against_timetable
    return {
        **attribution.above.as_dict(),
        "measured": attribution.above.measured,
        "by_cause_kwh": {str(cause): kwh(energy_j) for cause, energy_j in attribution.by_cause.items()},
        "optimum_timetable_kwh": known_kwh(attribution.timetable_j),
        "by_cause_against_timetable_kwh": None
        if against is None
        else {str(cause): kwh(energy_j) for cause, energy_j in against.items()},
        "legs": [leg_dict(leg) for leg in attribution.legs],
    }


def leg_dict(leg: LegAttribution) -> dict[str, Any]:
    """One leg for programs."""
    driven = leg.leg
    return {
        "from": driven.start.name,
        "to": driven.end.name,
        "trip_s": driven.trip_s,
        "timetable_s": driven.timetable_s,
        "departed_ns": int(driven.motion.time_ns[0]),
        "arrived_ns": int(driven.motion.time_ns[-1]),
        "energy_kwh": kwh(leg.driven_j),
        "energy_optimum_kwh": kwh(leg.optimum_j),
        "optimum_timetable_kwh": known_kwh(leg.timetable_j),
        "late_departure_kwh": known_kwh(leg.recovered_j),
        "early_arrival_kwh": known_kwh(leg.early_j),
        "by_cause_kwh": {str(cause): kwh(energy_j) for cause, energy_j in leg.by_cause.items()},
        "per_100_m": place_rows(leg.even),
    }


def place_rows(places: Places) -> list[dict[str, float]]:
    """One row per stretch, for programs."""
    columns = {
        "start_m": places.start_m,
        "end_m": places.end_m,
        "driven_s": places.driven_s,
        "optimum_s": places.optimum_s,
        "energy_kwh": kwh(places.driven_j),
        "energy_optimum_kwh": kwh(places.optimum_j),
        "lost_more_kwh": kwh(places.lost_more_j),
    }
    rows = np.column_stack(list(columns.values())).tolist()
    return [dict(zip(columns, row, strict=True)) for row in rows]


def seconds_by_cause(attribution: Attribution) -> dict[EnergyCause, float]:
    """Duration (s) of each cause."""
    total: dict[EnergyCause, float] = {}
    for leg in attribution.legs:
        lasted_s = np.diff(leg.leg.motion.time_ns[leg.committed.sample]) * NS
        for cause, over_s in zip(leg.committed.causes, lasted_s.tolist(), strict=True):
            total[cause] = total.get(cause, 0.0) + over_s
    return total


DENSE_CAUSE = 3.0
"""Multiple of a cause's average energy per place from which a place belongs to a stretch of that cause."""
LEAST_PART = 0.2
"""Share of the loss on a cause's worst stretch below which its other stretches are left out."""
IDLE_RATIO, HELD_MPS2 = 0.02, 0.05
"""Share of the largest force below which a run coasts, and acceleration (m/s²) below which a run that does not coast
holds its speed."""
BRIEF_S = 5.0
"""Time (s) below which an act of a run counts as part of the act around it."""
ACTIONS = (InstructionKind.HOLD, InstructionKind.COAST, InstructionKind.TRACTION, InstructionKind.BRAKE)
"""Acts of a run, by the numbers that `_actions` gives."""


class ActionSpan(NamedTuple):
    """The act of a run on a stretch, and the positions (m) between which it lasts without a break."""

    action: InstructionKind
    start_m: float
    end_m: float


class CauseStretch(NamedTuple):
    """A stretch on which a cause took energy: its leg, where (m) and when (ns since 1970) it begins and ends, and the
    energy that the cause took there (J). It lasted `driven_s`, and in the optimum `optimum_s`; `best` is the optimum's
    act there."""

    leg: DrivenLeg
    start_m: float
    end_m: float
    start_ns: int
    end_ns: int
    energy_j: float
    driven_s: float
    optimum_s: float
    best: ActionSpan | None


def worst_stretches(attribution: Attribution, cause: EnergyCause, most: int) -> list[CauseStretch]:
    """The stretches, `most` at most, on which a cause took most energy above the optimum, the worst first.

    A stretch consists of the neighbouring places beyond `DENSE_CAUSE` times the drive's average. A stretch with less
    than `LEAST_PART` of the energy of the worst is left out.
    """
    taken = [leg.by_place(cause) for leg in attribution.legs]
    usual_j = DENSE_CAUSE * max(float(np.concatenate(taken).mean()), 0.0) if taken else 0.0
    found = [
        _stretch(leg, first, last, float(energy_j[first : last + 1].sum()))
        for leg, energy_j in zip(attribution.legs, taken, strict=True)
        for first, last in _worst_runs(energy_j - usual_j, most)
    ]
    found.sort(key=lambda one: -one.energy_j)
    return [one for one in found[:most] if one.energy_j >= LEAST_PART * found[0].energy_j]


def slowest_stretch(attribution: Attribution) -> CauseStretch | None:
    """The neighbouring places where a drive lost most time against the optimum, without an energy; None if it lost
    none."""
    found = [
        _stretch(leg, first, last, 0.0)
        for leg in attribution.legs
        for first, last in _worst_runs(leg.even.driven_s - leg.even.optimum_s, 1)
    ]
    return max(found, key=lambda one: one.driven_s - one.optimum_s, default=None)


def _stretch(leg: LegAttribution, first: int, last: int, energy_j: float) -> CauseStretch:
    motion, start_m, end_m = leg.leg.motion, float(leg.even.start_m[first]), float(leg.even.end_m[last])
    ends = np.minimum(np.searchsorted(motion.s_m, (start_m, end_m)), len(motion.s_m) - 1)
    start_ns, end_ns = motion.time_ns[ends].tolist()
    driven_s, optimum_s = (float(one[first : last + 1].sum()) for one in (leg.even.driven_s, leg.even.optimum_s))
    best = doing(leg.optimum.trajectory, start_m, end_m)
    return CauseStretch(leg.leg, start_m, end_m, start_ns, end_ns, energy_j, driven_s, optimum_s, best)


def doing(run: Trajectory, start_m: float, end_m: float) -> ActionSpan | None:
    """The act of a run that takes at least half of the time between two places (m); None if there is none."""
    actions, found = _actions(run), []
    begins = [0]
    for k in np.flatnonzero(np.diff(actions)) + 1:
        lasts = int(np.argmax(np.append(actions[k:] != actions[k], True)))
        if run.t_s[k + lasts] - run.t_s[k] >= BRIEF_S and actions[k] != actions[begins[-1]]:
            begins.append(int(k))
    for begin, end in pairwise([*begins, len(actions)]):
        from_m, to_m = float(run.s_m[begin]), float(run.s_m[end])
        from_s, to_s = np.interp(np.clip((from_m, to_m), start_m, end_m), run.s_m, run.t_s)
        found.append((float(to_s - from_s), ActionSpan(ACTIONS[actions[begin]], from_m, to_m)))
    longest_s, best = max(found)
    return best if longest_s >= 0.5 * sum(lasts_s for lasts_s, _ in found) else None


def _actions(run: Trajectory) -> NDArray[np.intp]:
    """The act of a run in each of its intervals, as an index into `ACTIONS`."""
    force_n, gained_mps = run.force_el_n + run.force_friction_n, np.diff(run.v_mps)
    idle = np.abs(force_n) < IDLE_RATIO * np.abs(run.force_el_n).max()
    most_mps = HELD_MPS2 * run.interval_s()
    gains, loses = (force_n > 0) & (gained_mps > most_mps), (force_n < 0) & (gained_mps < -most_mps)
    return np.select([idle, gains, loses], [1, 2, 3], 0)


def _worst_runs(scores: NDArray[np.float64], most: int) -> list[tuple[int, int]]:
    """The runs of places (first, last) with the largest sums of scores, the largest first; none overlaps another."""
    left, found = scores.copy(), []
    for _ in range(most):
        upto = np.concatenate(([0.0], np.cumsum(left)))
        rise = upto - np.minimum.accumulate(upto)
        last = int(np.argmax(rise))
        if not rise[last] > 0:
            break
        first = int(np.argmin(upto[:last]))
        found.append((first, last - 1))
        left[first:last] = -float(np.abs(scores).sum())  # so that no other run includes it
    return found
