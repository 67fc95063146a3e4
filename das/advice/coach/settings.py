"""The settings of the coach, as frozen data: each figure with its meaning and reason."""

from __future__ import annotations

from dataclasses import dataclass, field

from das.domain.units import KMH
from das.solver.guide.policies import GuideSettings


@dataclass(frozen=True, kw_only=True)
class KeepingSettings:
    """When the coach keeps its reference (its standing plan), and when a new one is worth the change."""

    late_s: float = 3.0
    """The reference is kept while the train arrives late by no more than this."""
    early_s: float = 5.0
    """The reference is kept while the train arrives early by no more than this."""
    least_gain_s: float = 1.0
    """A new reference for an early train must bring the arrival nearer to the wanted time by at least this; a new
    reference to save energy must not move the arrival further from it by more."""
    late_gain_s: float = 2.0
    """A new reference for a late train must bring the arrival nearer to the wanted time by at least this."""
    least_gain_power_s: float = 0.08
    """A new reference to save energy must save at least the energy of full traction power for this time (0.14 kWh for
    6 MW)."""
    astray_mps: float = 1.5
    """A new reference to save energy is tried only while the train's speed differs from the reference by more than
    this."""
    asked_every_s: float = 30.0
    """Whether a new reference would be better is tried at most once in this time."""
    least_age_s: float = 20.0
    """A reference younger than this is replaced only if the goal or the line has changed, or if it cannot be kept."""
    quiet_s: float = 10.0
    """For this long after the instruction has changed, the reference is replaced only for the same reasons."""
    due_soon_s: float = 8.0
    """The same holds once the next change is due within this time: a change that was announced comes as announced."""


@dataclass(frozen=True, kw_only=True)
class LeadSettings:
    """How long before it is due each kind of instruction is shown."""

    coasting_s: float = 5.0
    """Coasting is shown this long before it is due: about the time in which a driver reacts."""
    braking_s: float = 3.0
    """A brake is shown at most this long before it is due, and with one advice a second at least 2 s: a driver who sees
    it earlier brakes early and arrives late."""
    least_s: float = 2.0
    """A brake that can wait is shown at least this long before it is due."""
    astray_s: float = 4.0
    """To a train that accelerates or is faster than the reference, a brake is shown this long before it is due."""
    begun_in_s: float = 2.0
    """The effort first shown for a lower limit is enough even if the driver begins to brake this long after it is
    due."""
    accelerating_s: float = 2.0
    """An acceleration is shown this long before it is due, so that a driver who looks when it is due sees it."""


@dataclass(frozen=True, kw_only=True)
class BrakeShowingSettings:
    """When the driver of a braking train is told to coast or to creep instead."""

    easing_ratio: float = 0.75
    """If this share of the planned braking is enough for the stop, holding a low speed is announced."""
    early_ratio: float = 0.5
    """A driver who has braked so early or hard that this share of the planned braking is enough is told to hold his
    speed until he must brake again for his stop, or to coast to a lower limit."""
    again_ratio: float = 0.95
    """A driver who was told to coast after braking early is told to brake again when this share of the planned braking
    is needed."""
    rolls_above_mps: float = 8.0 * KMH
    """A driver this near to the speed that he brakes to is not told to coast: he would react too late."""
    short_ratio: float = 0.1
    """A train that brakes for its stop counts as stopping clearly short if this share of the planned braking is
    enough."""
    short_m: float = 8.0
    """A train counts as stopping clearly short of its stop only if it is, or would come to rest, further from the mark
    than this."""
    creep_mps: float = 10.0 * KMH
    """A driver who coasts towards his stop and becomes slower than this is told to hold this speed (to creep)."""
    creeps_m: float = 100.0
    """A train so slow that no reference leads to its stop is told to creep there if it is no further away than this."""


@dataclass(frozen=True, kw_only=True)
class EffortShowingSettings:
    """How the braking effort is shown: in what steps, and when it changes.

    A braking effort is the braking force as a share of what the motors can brake with at the present speed.
    """

    step_ratio: float = 0.05
    """The braking effort is shown in steps of this size, rounded up."""
    friction_step_ratio: float = 0.5
    """An effort above what the motors give is shown in steps of this size: no driver sets the friction brake more
    finely."""
    build_up_ratio: float = 0.15
    """The allowance for the build-up of the brakes is at most this share of the braking distance."""
    answered_in_s: float = 4.0
    """When more effort is needed, the effort shown is enough even if the driver reacts only after this time."""
    grown_ratio: float = 1.6
    """When more effort is needed, the effort shown is at most this multiple of what is needed now."""
    short_ratio: float = 0.05
    """A brake for the stop keeps its effort while no more than this share of it is lacking; not in its last metres."""
    settled_s: float = 6.0
    """If the effort shown brings the train down to its lower speed within this time, it is not reduced: the driver sees
    the speed himself."""
    less_ratio: float = 0.4
    """Less effort is shown only if the effort needed is lower than the one shown by more than this share. More effort
    is shown at once."""
    eased_ratio: float = 0.5
    """If less than this share of the effort shown is needed, less is shown at once: the train would stop short."""
    beyond_mark_m: float = 3.0
    """In the last metres before a stop the effort shown stays the same if with it the train stops no further beyond the
    mark than this."""
    before_mark_m: float = 2.0
    """In the last metres before a stop the effort shown stays the same if with it the train stops no further short of
    the mark than this."""
    at_mark_more_ratio: float = 0.2
    """If the train would stop too far beyond the mark, the effort shown grows by this much at once: a driver does not
    notice less, and it would have to grow again."""


@dataclass(frozen=True, kw_only=True)
class LimitShowingSettings:
    """What is shown to a driver who is at the limit or above it."""

    braked_mps: float = 0.9
    """A driver above the limit by more than this is told to brake; by less, to coast or to hold the limit."""
    closes_in_s: float = 4.0
    """Near the speed of an instruction, its force is the one that reaches the speed in this time. The time is longer
    than advice is valid, so that a driver who sets exactly this force does not overshoot the speed."""
    rolls_back_in_s: float = 60.0
    """A driver above the speed to hold is told to coast back to it if that takes at most this long."""
    brakes_back_in_s: float = 10.0
    """A driver for whom coasting back to the speed to hold takes too long is told to brake with the motors, so that he
    reaches the speed after this time if they are strong enough."""


@dataclass(frozen=True, kw_only=True)
class ShowingSettings:
    """How instructions are shown, and when a train counts as being at a speed."""

    lead: LeadSettings = field(default_factory=LeadSettings)
    reached_mps: float = 0.5
    """A speed to reach counts as reached when the train is less than this below it."""
    below_mps: float = 5.0 * KMH
    """A driver slower than the speed to hold by more than this is told to accelerate back to it. So a driver who keeps
    2 km/h below a limit, and varies by as much, is left alone."""
    worth_accelerating_s: float = 40.0
    """A driver is not told to accelerate back to the speed to hold if the next instruction is due within this time."""
    above_mps: float = 5.0 * KMH
    """A driver faster than the speed to hold by more than this is told to coast back to it."""
    least_shown_s: float = 8.0
    """An instruction is shown for at least this long, unless a brake, its release or a lower limit replaces it."""
    announced_s: float = 8.0
    """An instruction of another kind is announced this long before it is due. If it could not be foreseen, it is put
    off until then, unless it brakes or a limit needs it."""
    limit: LimitShowingSettings = field(default_factory=LimitShowingSettings)
    brake: BrakeShowingSettings = field(default_factory=BrakeShowingSettings)
    effort: EffortShowingSettings = field(default_factory=EffortShowingSettings)
    ahead: int = 2
    """This many instructions after the present one are shown."""
    arrived_s: float = 30.0
    """With less time than this to the end of the section, no new reference is tried."""


@dataclass(frozen=True, kw_only=True)
class MarginSettings:
    """The margin to the window of time of a point ahead; it depends on how well the driver keeps the reference."""

    least_s: float = 2.0
    """The least margin to either end of the window in which a point may be passed."""
    most_s: float = 12.0
    """The largest margin to either end of the window in which a point may be passed."""
    deviations: float = 1.5
    """The margin is this many standard deviations of the train's drift against the reference."""
    drift_s_per_min: float = 2.0
    """The drift assumed before the driver is known (standard deviation; seconds gained or lost in a minute)."""
    sampled_s: float = 20.0
    """The drift is measured once in this time."""
    forgotten_min: float = 5.0
    """After this time (min) an earlier measurement of the drift counts for 1/e."""


@dataclass(frozen=True, kw_only=True)
class LossSettings:
    """The time that drivers lose against a reference, for which references leave a reserve.

    A driver holds a speed a little below a limit, reacts late, and brakes earlier and more gently than planned. The
    first two figures are what the default human driver loses on Zürich–Luzern.
    """

    running_s_per_min: float = 1.0
    """So many seconds are lost in each minute, …"""
    braking_ratio: float = 0.2
    """… and this share of the time in which the fastest run brakes."""
    last_s: float = 150.0
    """The reserve is for what is lost in so many seconds before the stop. What is lost before that, a new reference
    makes up, and only if it is lost."""
    variance_s: float = 4.0
    """The variance of a loss (s²) is this many times the loss (s). It is that of a driver, and of what drivers usually
    lose from stop to stop."""
    known_after_s: float = 8.0
    """A driver's own loss counts as much as the usual one once he has come where drivers usually have lost so much
    (s): before his first stop."""
    on_time_ratio: float = 0.9
    """References leave so much time that a driver is on time with this probability where that counts, …"""
    elsewhere_ratio: float = 0.3
    """… and with this one at other stops, whose lateness the next section makes up for less energy."""
    dearest_ratio: float = 0.25
    """A second of the reserve is worth no more than the energy of this share of the train's power in a second: twice
    what a second costs with a buffer of 8 %."""


@dataclass(frozen=True, kw_only=True)
class CoachSettings:
    """All settings of the coach."""

    enabled: bool = False
    """Whether there is a coach; if not, nothing is computed for it."""
    guided: bool = False
    """Whether the guide (`das.advice.guide`) makes the instructions of the coach's reference."""
    guide: GuideSettings = field(default_factory=GuideSettings)
    keeping: KeepingSettings = field(default_factory=KeepingSettings)
    showing: ShowingSettings = field(default_factory=ShowingSettings)
    margin: MarginSettings = field(default_factory=MarginSettings)
    loss: LossSettings = field(default_factory=LossSettings)


DEFAULT = CoachSettings()
