"""The settings of the advice on one section, as frozen data: each figure with its meaning and reason."""

from __future__ import annotations

from dataclasses import dataclass, field

from das.advice.guide.settings import GuideSettings
from das.domain.units import KMH


@dataclass(frozen=True, kw_only=True)
class ModeSettings:
    """How the intervals of a trajectory become modes that a driver can follow."""

    full_effort_ratio: float = 0.97
    """An effort above this share of the largest available one counts as full."""
    idle_effort_ratio: float = 0.02
    """A force below this share of the largest traction force counts as none."""
    cruise_acceleration_mps2: float = 0.02
    """A train whose speed changes more slowly than this counts as holding its speed."""
    ripple_mps: float = 2.0 * KMH
    """Speeds within this range count as one speed to hold, because no driver holds a speed more closely."""
    weak_brake_ratio: float = 0.6
    """A display of four modes shows electric braking below this share of the full effort as coasting: its only brake is
    the full one, with which the driver would brake too early."""
    hold_s: float = 3.0
    """A new mode is shown only after the one before has lasted this long; but a mode with less traction or more braking
    is shown at once."""


@dataclass(frozen=True, kw_only=True)
class PlanSettings:
    """When a plan is kept, and how a new one is made."""

    faster_band_mps: float = 0.8
    """A plan is kept while the train is faster than planned by no more than this."""
    slower_band_mps: float = 1.4
    """A plan is kept while the train is slower than planned by no more than this."""
    time_band_s: float = 2.0
    """A plan is kept while the train is earlier or later than planned by no more than this."""
    longest_age_s: float = 60.0
    """A plan older than this is replaced by a new one."""
    tolerance_s: float = 0.2
    """A plan arrives within this time of the wanted arrival."""
    braking_ahead_mps2: float = 0.25
    """A limit or stop ahead counts as being braked for if it needs more than this deceleration from here on."""
    slower_than_planned_mps: float = 1.0
    """A driver has braked early for a limit or stop if the train is slower than planned by more than this before it."""
    braked_early_s: float = 5.0
    """A driver who braked early for a limit or stop is told to speed up again, by a plan or by a higher top speed, only
    if that saves at least this much time."""
    overspeed_eased_mps: float = 1.0
    """A train above the planned braking curve by at most this gets a plan that starts on it, without hard braking."""
    longest_ratio: float = 2.5
    """No plan takes longer than this multiple of the least time from its state. With more time left, the train arrives
    early and waits at the stop instead of crawling (without idle losses, a crawl would need the least energy)."""
    passed_m: float = 5.0
    """A point less than this ahead counts as passed: it is too near for a plan to change when it is passed."""
    same_point_m: float = 0.01
    """Two points of the line this near to each other count as the same point."""


@dataclass(frozen=True, kw_only=True)
class FourModeSettings:
    """How long before it is needed a display of four modes shows full braking."""

    before_s: float = 4.0
    """Full braking is shown this long before it is needed: advice is valid for 3 s, and the brakes need time to act."""
    slow_mps: float = 4.0
    """For a train slower than this, `before_m` and `least_s` count instead of `before_s`."""
    before_m: float = 5.0
    """A slow train is shown full braking this far before it is needed, so that it stops at most this far short."""
    least_s: float = 2.0
    """A slow train is shown full braking at least this long before it is needed: a driver takes this long to act."""


@dataclass(frozen=True, kw_only=True)
class DisplaySettings:
    """What advice contains, and how steady it is."""

    horizon_s: int = 30
    """Advice looks this many seconds ahead, in steps of 1 s."""
    valid_for_s: float = 3.0
    """Advice is valid for this long."""
    missed_named_s: float = 1.0
    """The reason says that a point is passed too late if it is passed at least this long after its window."""
    four: FourModeSettings = field(default_factory=FourModeSettings)
    speed_band_ratio: float = 0.75
    """A displayed speed changes when the true one is further than this share of a step from the middle of its step."""
    least_for_buffer_s: float = 10.0
    """With less driving time left than this, no buffer ratio is given: it would no longer mean anything."""


@dataclass(frozen=True, kw_only=True)
class PassingSettings:
    """How a train is slowed if even the slowest optimal trajectory passes a point too early."""

    slowing_mps2: float = 0.4
    """The train brakes to the lower speed at this rate, or harder if this is not slow enough."""
    crawl_mps: float = 0.5
    """No train is told to go slower than this."""
    halvings: int = 24
    """The lower speed is found by halving an interval this many times."""
    prices_tried: int = 2
    """The price of time after the point is estimated this many times, each time from the latest speed at the point."""


@dataclass(frozen=True, kw_only=True)
class ReducedSpeedSettings:
    """How the reduced maximum speed, the one top speed that keeps the timetable, is found."""

    easy_braking_mps2: float = 0.5
    """The deceleration of comfortable service braking (assumption)."""
    judged_every_s: float = 30.0
    """The reduced maximum speed is computed anew this often."""
    slowest_mps: float = 20.0 * KMH
    """No lower speed is shown, except under a lower limit and in the last metres before a stop. Before a stop this is
    the speed shown; in the last metres it is halved, if need be several times."""
    halvings: int = 12
    """The reduced maximum speed is found by halving an interval this many times."""
    below_ratio: float = 0.999
    """For a train faster than comfortable braking allows, the computation starts from the allowed speed, divided by
    this ratio."""


@dataclass(frozen=True, kw_only=True)
class StopSettings:
    """When a train counts as being at a stop."""

    standstill_m: float = 1.0
    """Closer to the end of the section than this, nothing is planned any more: the train is to stop."""
    at_stop_m: float = 50.0
    """A standing train within this distance of a stop is at the stop. A train further beyond has run past it."""
    short_m: float = 15.0
    """A train that stood further than this before its stop and moves on is taken to move up to it, whatever the time:
    it is shown nothing until it is there."""
    lost_beyond_m: float = 500.0
    """A train further beyond the end of the section than this is not on the section at all."""
    deviations: float = 2.0
    """The train is assumed to be ahead of its estimated position by at most this many standard deviations."""
    back_m: float = 200.0
    """A train that has begun a section counts as back on the previous one only if its position lies further back than
    this."""


@dataclass(frozen=True, kw_only=True)
class QuietSettings:
    """When a driver counts as braking against the advice, and is shown no instruction until he releases the brake."""

    brakes_mps2: float = 0.2
    """A driver brakes if the train slows down by more than this beyond what gradient and resistance explain."""
    brakes_s: float = 3.0
    """That deceleration is the mean since the brake began, and it must last for this time."""
    steady_ratio: float = 0.5
    """A brake slows the train by more than this share of `brakes_mps2` in every second, but a measured speed that jumps
    does so only once."""
    holds_mps: float = 5.0 * KMH
    """A driver who is told to hold a speed brakes against the advice only if he slows down by more than this: a driver
    who holds a speed wanders by a little less, and corrects that with the brake."""
    released_mps2: float = 0.1
    """A driver has released the brake if the deceleration that is not explained is no more than this."""
    released_s: float = 2.0
    """That deceleration is the mean of this time, so that the noise of the speed does not count."""
    settled_s: float = 5.0
    """After an advised brake, only braking that begins later than this counts: a driver reacts late, and the brakes
    need time to release."""
    brakes_ahead_s: float = 20.0
    """Where the advice announces a brake within this time, a driver who brakes earlier does not act against it."""


@dataclass(frozen=True, kw_only=True)
class AdviceSettings:
    """All settings of the advice on a section."""

    modes: ModeSettings = field(default_factory=ModeSettings)
    plan: PlanSettings = field(default_factory=PlanSettings)
    display: DisplaySettings = field(default_factory=DisplaySettings)
    passing: PassingSettings = field(default_factory=PassingSettings)
    reduced: ReducedSpeedSettings = field(default_factory=ReducedSpeedSettings)
    stop: StopSettings = field(default_factory=StopSettings)
    quiet: QuietSettings = field(default_factory=QuietSettings)
    guide: GuideSettings = field(default_factory=GuideSettings)


DEFAULT = AdviceSettings()
