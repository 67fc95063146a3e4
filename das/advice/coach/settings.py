"""The tuning of the coach, as frozen data: each figure with its meaning and why it is what it is."""

from __future__ import annotations

from dataclasses import dataclass, field

from das.domain.units import KMH
from das.solver.few_switch.few_switch import FewSwitchSettings
from das.solver.few_switch.scheduling import PolishSettings, ScheduleSettings


@dataclass(frozen=True, kw_only=True)
class KeepingSettings:
    """When the reference is kept, and when a new one is worth the change."""

    late_s: float = 3.0
    """The reference is kept while the train arrives no later than this."""
    early_s: float = 5.0
    """The reference is kept while the train arrives no earlier than this."""
    least_gain_s: float = 1.0
    """A new reference because of earliness must gain at least this, one to save energy may lose no more,"""
    late_gain_s: float = 2.0
    """and one because of lateness must gain at least this."""
    least_gain_power_s: float = 0.08
    """A new reference to save energy must save what the train's full power needs in this time (0.14 kWh of 6 MW)."""
    astray_mps: float = 1.5
    """Whether keeping the reference costs energy is asked while the train is further than this from its speed."""
    asked_every_s: float = 30.0
    """Whether another reference would be better is asked at most this often."""
    least_age_s: float = 20.0
    """A reference younger than this is given up only where the world has changed or it cannot be kept to."""


@dataclass(frozen=True, kw_only=True)
class LeadSettings:
    """How much before it is due an instruction is shown."""

    coasting_s: float = 5.0
    """Coasting: about the time in which a driver reacts."""
    braking_s: float = 2.0
    """A brake: a driver who sees it earlier brakes early and arrives late."""
    astray_s: float = 3.0
    """A brake that limits or the stop ask of a train faster than the reference: as long as an advice is valid."""
    accelerating_s: float = 2.0
    """An acceleration: a driver who looks when it is due sees it."""


@dataclass(frozen=True, kw_only=True)
class BrakeShowingSettings:
    """When a train that brakes is told to roll or to creep instead."""

    early_ratio: float = 0.5
    """A driver who has braked so hard that this share of the planned deceleration is enough is told to let it roll,"""
    again_ratio: float = 0.95
    """and to brake again when this share of it is needed."""
    rolls_above_mps: float = 8.0 * KMH
    """A train this near to the speed that it brakes for is not told to roll: it is there before the driver answers."""
    last_mps: float = 3.0
    """A train that is slower than this before its stop is not told to roll any more,"""
    short_ratio: float = 0.1
    """unless this share of the planned deceleration is enough,"""
    short_m: float = 8.0
    """and the mark is further away than this: braked on the train would stand short of it."""
    creep_mps: float = 3.0
    """A train that rolls to its stop and has become slower than this (m/s) is told to hold this speed."""
    creeps_m: float = 100.0
    """A train so slow that no reference brings it to its stop creeps there from so far away at most."""


@dataclass(frozen=True, kw_only=True)
class EffortShowingSettings:
    """How the effort of a brake is shown: in what steps, and when more of it or less."""

    step_ratio: float = 0.05
    """The effort of the brake is shown in steps of this size, rounded up."""
    friction_step_ratio: float = 0.5
    """An effort beyond the motors is shown in steps of this size: nobody sets friction more closely."""
    build_up_ratio: float = 0.15
    """The build-up of the brakes takes at most this share of the way of a brake."""
    answered_in_s: float = 4.0
    """Where more effort is needed, as much is shown as is needed by a driver who answers in this time,"""
    grown_ratio: float = 1.6
    """but no more than so many times what is needed by now."""
    settled_s: float = 6.0
    """So near to the end of a brake to a lower speed no less effort is shown: the driver sees the speed himself."""
    less_ratio: float = 0.4
    """Less effort is shown only where what is needed is less by more than this share. More is shown at once."""
    eased_ratio: float = 0.5
    """Where less than this share of what is shown is needed, less is shown at once: the train would stand short."""
    beyond_mark_m: float = 3.0
    """In the last metres before a stop the effort stands while a train that brakes on stands no further beyond it,"""
    before_mark_m: float = 2.0
    """and no further before it;"""
    at_mark_more_ratio: float = 0.2
    """otherwise it grows by this share of the motors at once: less is not read, and would have to grow again."""


@dataclass(frozen=True, kw_only=True)
class LimitShowingSettings:
    """What is shown to a train at its limit, or above it."""

    braked_mps: float = 0.9
    """A train above the limit by more than this is told to brake; by less, to coast or to hold the limit."""
    closes_in_s: float = 4.0
    """The force of an instruction that leads to a speed brings the train there in this time: longer than an advice
    is valid, so that a driver who sets the force exactly does not pass the speed."""
    rolls_back_in_s: float = 60.0
    """A train above the speed to hold is told to coast back to that speed if this takes no longer,"""
    brakes_back_in_s: float = 10.0
    """and otherwise to brake with the motors, so strongly that it reaches the speed after this time if they can."""


@dataclass(frozen=True, kw_only=True)
class ShowingSettings:
    """How instructions are shown, and when the train counts as being at a speed."""

    lead: LeadSettings = field(default_factory=LeadSettings)
    reached_mps: float = 0.5
    """A speed to be reached is reached from this much below it on."""
    below_mps: float = 5.0 * KMH
    """A train slower than the speed to hold by more than this is told to accelerate back to it: a driver who keeps
    2 km/h below a limit, and wanders by as much, is left to himself."""
    worth_accelerating_s: float = 30.0
    """A train is not told to accelerate back to the speed to hold when the next instruction is nearer than this."""
    above_mps: float = 5.0 * KMH
    """A train faster than the speed to hold by more than this is told to coast back to it."""
    least_shown_s: float = 8.0
    """An instruction stands for at least this long. Brakes, their release, and a lower limit do not wait."""
    limit: LimitShowingSettings = field(default_factory=LimitShowingSettings)
    brake: BrakeShowingSettings = field(default_factory=BrakeShowingSettings)
    effort: EffortShowingSettings = field(default_factory=EffortShowingSettings)
    ahead: int = 2
    """So many changes ahead are shown."""
    worth_over_s: float = 60.0
    """What an instruction is worth is judged against going on at the present speed for so long."""
    arrived_s: float = 30.0
    """With less time than this to the end of the section there is nothing to weigh any more."""


@dataclass(frozen=True, kw_only=True)
class MarginSettings:
    """The margin to windows of time, which depends on how well the driver keeps to the reference."""

    least_s: float = 2.0
    """The least margin after the earliest time at which a point may be passed."""
    most_s: float = 12.0
    """The largest margin."""
    deviations: float = 1.5
    """The margin is so many standard deviations of the drift of the train against the reference."""
    drift_s_per_min: float = 2.0
    """The drift before anything is known of the driver (standard deviation, s in a minute)."""
    sampled_s: float = 20.0
    """The drift is looked at this often."""
    forgotten_min: float = 5.0
    """After this time (min) what was learned of the driver counts for 1/e."""


@dataclass(frozen=True, kw_only=True)
class CoachSettings:
    """All the tuning of the coach."""

    enabled: bool = False
    """Whether there is a coach; without one nothing is computed for it."""
    few_switch: FewSwitchSettings = field(default_factory=FewSwitchSettings)
    schedule: ScheduleSettings = field(default_factory=ScheduleSettings)
    polish: PolishSettings = field(default_factory=PolishSettings)
    keeping: KeepingSettings = field(default_factory=KeepingSettings)
    showing: ShowingSettings = field(default_factory=ShowingSettings)
    margin: MarginSettings = field(default_factory=MarginSettings)


DEFAULT = CoachSettings()
