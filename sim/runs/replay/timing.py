"""The timetable of a replayed trip: from two figures, from a journey file, from the recording, or from the trip."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from das.domain.errors import DasError
from das.domain.files.load import load_journey
from das.domain.journey import Call, Journey
from das.domain.units import NS
from sim.drive.attribution.driven_legs import DrivenLeg
from sim.options import ReplayOptions
from sim.recording.course import OWN_TIMETABLE
from sim.trips.trip import Trip

LONGEST_S = 86400.0
"""Upper bound (s) of running times and delays: a day."""
DAY_NS = round(LONGEST_S / NS)


@dataclass(frozen=True, kw_only=True)
class ReplayTiming:
    """The timetable of the replayed section and the first and last tick of the replay (all in ns since 1970).

    `own`: no timetable was given, and the trip itself stands for it. `retimed`: the user gave another one than the
    recording has, so that its delays do not count.
    """

    departure_ns: int
    arrival_ns: int
    first_tick_ns: int
    last_tick_ns: int
    own: bool
    retimed: bool

    @property
    def metadata(self) -> dict[str, str]:
        """What the recording says of the timetable."""
        return {OWN_TIMETABLE: "yes"} if self.own else {}


def check_timing(options: ReplayOptions) -> None:
    """Raises DasError for a running time, a delay or a combination of them with a journey that is of no use."""
    given = {"--running-time": options.running_time_s, "--delay": options.delay_s}
    for name, value in given.items():
        if value is not None and not 0 <= value < LONGEST_S:
            raise DasError(f"{name} {value:g}: expected seconds >= 0, less than a day")
        if value is not None and options.journey is not None:
            raise DasError(f"{name} {value:g}: expected none with --journey, which has the times")
    if options.running_time_s is not None and options.running_time_s <= 0:
        raise DasError(f"--running-time {options.running_time_s:g}: expected a running time > 0 s")


def plan_timing(trip: Trip, legs: Sequence[DrivenLeg], options: ReplayOptions) -> ReplayTiming:
    """The timetable of a trip: that of a journey, or the two figures of the options, or the recording's.

    Where none of them says when the train is due to arrive, the trip itself is the timetable: it is on time. Raises
    DasError for a delay without such a time, for a journey that is not of this trip, and for a train that is due to
    arrive before it departs.
    """
    departed_ns, arrived_ns = int(legs[0].motion.time_ns[0]), int(legs[-1].motion.time_ns[-1])
    departure_ns, arrival_ns = departed_ns, 0
    if options.journey is not None:
        departure_ns, arrival_ns = _due_ns(trip, load_journey(options.journey, trip.route), departed_ns)
    elif trip.journey is not None and trip.journey.stops:  # on the bus, a time of 0 stands for none
        departure_ns = trip.journey.stops[0].departure_ns or departed_ns
        arrival_ns = trip.journey.stops[-1].arrival_ns
    if options.delay_s is not None:
        departure_ns = departed_ns - round(options.delay_s / NS)
    if options.running_time_s is not None:
        arrival_ns = departure_ns + round(options.running_time_s / NS)
    own = arrival_ns == 0
    if own and options.delay_s is not None:
        raise DasError(f"--delay {options.delay_s:g}: needs --running-time: no arrival is due in the recording")
    if own:
        departure_ns, arrival_ns = departed_ns, arrived_ns
    if arrival_ns <= departure_ns:
        raise DasError(f"the arrival is {(departure_ns - arrival_ns) * NS:.0f} s before the departure")
    first_ns, last_ns = int(trip.matched.time_ns[0]), int(trip.matched.time_ns[-1])
    return ReplayTiming(
        departure_ns=departure_ns,
        arrival_ns=arrival_ns,
        first_tick_ns=min(first_ns, departed_ns),
        last_tick_ns=max(last_ns, arrived_ns),
        own=own,
        retimed=any(one is not None for one in (options.journey, options.running_time_s, options.delay_s)),
    )


def _due_ns(trip: Trip, journey: Journey, departed_ns: int) -> tuple[int, int]:
    """When a trip is due to depart and to arrive (ns since 1970), on the day on which it departed nearest to that."""
    departure_s = _call(journey, trip.start.name).departure.earliest_s
    arrival_s = _call(journey, trip.end.name).arrival.latest_s
    for name, time_s, what in ((trip.start.name, departure_s, "departure"), (trip.end.name, arrival_s, "arrival")):
        if not math.isfinite(time_s):
            raise DasError(f"{journey.source}: {name}: expected a time of {what}, which the replayed trip needs")
    midnights_ns = [trip.route.midnight_ns(departed_ns + day * DAY_NS) for day in (-1, 0, 1)]
    due_ns = [zero_ns + round(departure_s / NS) for zero_ns in midnights_ns]
    departure_ns = min(due_ns, key=lambda one_ns: abs(one_ns - departed_ns))
    return departure_ns, departure_ns + round((arrival_s - departure_s) / NS)


def _call(journey: Journey, stop: str) -> Call:
    """The call of a journey at a stop of the trip; DasError if it has none."""
    for call in journey.calls:
        if call.name == stop:
            return call
    names = ", ".join(call.name for call in journey.calls)
    raise DasError(f"{journey.source}: {stop}: expected a stop there, where the trip begins or ends (it has: {names})")
