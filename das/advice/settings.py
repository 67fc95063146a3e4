"""The tuning of the advice on one section, as frozen data: each figure with its meaning and why it is what it is."""

from __future__ import annotations

from dataclasses import dataclass, field

from das.advice.coach.settings import CoachSettings
from das.domain.units import KMH


@dataclass(frozen=True, kw_only=True)
class ModeSettings:
    """How the intervals of a run become modes that a driver can follow."""

    full_effort_ratio: float = 0.97
    """An effort above this share of the largest available one counts as full."""
    idle_effort_ratio: float = 0.02
    """A force below this share of the largest traction force counts as none."""
    cruise_acceleration_mps2: float = 0.02
    """A train whose speed changes more slowly than this holds its speed."""
    ripple_mps: float = 2.0 * KMH
    """Speeds within this range count as one speed to hold, because nobody holds a speed more closely."""
    weak_brake_ratio: float = 0.6
    """A display of four modes shows an electric brake below this share of the full one as coasting: a driver who knows
    only full brakes would brake too early."""
    hold_s: float = 3.0
    """A new mode is shown only after the one before has lasted this long. One that asks for less traction or for more
    brake is shown at once."""


@dataclass(frozen=True, kw_only=True)
class PlanSettings:
    """When a plan is kept, and what a new one aims at."""

    faster_band_mps: float = 0.8
    """A plan is kept while the train is faster than planned by no more than this."""
    slower_band_mps: float = 1.4
    """A plan is kept while the train is slower than planned by no more than this."""
    time_band_s: float = 2.0
    """A plan is kept while the train is earlier or later than planned by no more than this."""
    longest_age_s: float = 60.0
    """A plan older than this is made anew."""
    tolerance_s: float = 0.2
    """A plan arrives within this time of the wanted one."""
    braking_ahead_mps2: float = 0.25
    """A train that has to slow down at this rate from here on, for a limit or a stop, is braking for it."""
    slower_than_planned_mps: float = 1.0
    """A train slower than planned by more than this, before what it brakes for, has braked early."""
    braked_early_s: float = 5.0
    """A driver who braked early for a limit or stop is told to speed up again, by a plan or by a higher top speed, only
    if that saves at least this long."""
    overspeed_eased_mps: float = 1.0
    """A train above the brake curve by no more than this is planned from the curve, so that it need not brake hard."""
    longest_ratio: float = 2.5
    """No run is planned to take more than this times the least time from its state: with much more time left, the train
    arrives early and waits at the stop instead of crawling (without idle losses, the least energy is a crawl)."""
    passed_m: float = 5.0
    """A point nearer ahead than this counts as passed: no plan can change when it is passed."""
    same_point_m: float = 0.01
    """Two points of the line this near to each other are the same point."""


@dataclass(frozen=True, kw_only=True)
class FourModeSettings:
    """How much before full brakes are needed a display of four modes shows them."""

    before_s: float = 4.0
    """So long: an advice is valid for 3 s, and the brakes build up."""
    slow_mps: float = 4.0
    """A train slower than this is shown them"""
    before_m: float = 5.0
    """this way before, so that it does not stand further than that from its mark,"""
    least_s: float = 2.0
    """but no later than so long before: a driver acts so much later."""


@dataclass(frozen=True, kw_only=True)
class DisplaySettings:
    """What an advice holds and how steady it is."""

    horizon_s: int = 30
    """An advice looks this many seconds ahead, in steps of 1 s."""
    valid_for_s: float = 3.0
    """An advice is valid for this long."""
    missed_named_s: float = 1.0
    """A train that passes a point later after the end of its window than this is told so."""
    four: FourModeSettings = field(default_factory=FourModeSettings)
    speed_step_mps: float = 1.0 * KMH
    """The displayed speed is a whole number of these steps."""
    speed_band_ratio: float = 0.75
    """The displayed speed changes when the advised one is further from it than this share of a step."""
    least_for_buffer_s: float = 10.0
    """With less driving time left than this, the buffer is no meaningful ratio any more."""


@dataclass(frozen=True, kw_only=True)
class PassingSettings:
    """How a train that must pass a point late enough is slowed down more than any run of least energy is."""

    slowing_mps2: float = 0.4
    """The train brakes at this rate to the lower speed, where that is soon enough."""
    crawl_mps: float = 0.5
    """No train is made slower than this."""
    halvings: int = 24
    """The lower speed is found by halving an interval so many times."""
    prices_tried: int = 2
    """The price of time behind the point is guessed so many times, each time by the speed found at the point."""


@dataclass(frozen=True, kw_only=True)
class ReducedSpeedSettings:
    """How the one reduced maximum speed is judged."""

    easy_braking_mps2: float = 0.5
    """Comfortable service braking (assumption)."""
    judged_every_s: float = 30.0
    """The judged speed stands still for this long before it is judged anew."""
    slowest_mps: float = 20.0 * KMH
    """No lower speed is asked for, except under a lower limit; before a stop this is the speed shown, and in the last
    metres the half of it, and so on."""
    halvings: int = 12
    """The speed is found by halving an interval so many times."""
    below_ratio: float = 0.999
    """A train faster than easy braking allows is judged from this share of what it allows."""


@dataclass(frozen=True, kw_only=True)
class StopSettings:
    """What it means to be at a stop."""

    standstill_m: float = 1.0
    """Nearer to the end of the section than this there is nothing left to plan: the train stops."""
    at_stop_m: float = 50.0
    """A standing train this near to a stop is at it; a train further beyond it than this has run past it."""
    lost_beyond_m: float = 500.0
    """A train further beyond the section's end than this is somewhere else."""
    deviations: float = 2.0
    """The train may be ahead of its estimate by so many standard deviations of the position."""
    back_m: float = 200.0
    """A train that has begun a section is put back to the one before only where it is heard further back than this."""


@dataclass(frozen=True, kw_only=True)
class AdviceSettings:
    """All the tuning of the advice on a section."""

    modes: ModeSettings = field(default_factory=ModeSettings)
    plan: PlanSettings = field(default_factory=PlanSettings)
    display: DisplaySettings = field(default_factory=DisplaySettings)
    passing: PassingSettings = field(default_factory=PassingSettings)
    reduced: ReducedSpeedSettings = field(default_factory=ReducedSpeedSettings)
    stop: StopSettings = field(default_factory=StopSettings)
    coach: CoachSettings = field(default_factory=CoachSettings)


DEFAULT = AdviceSettings()
