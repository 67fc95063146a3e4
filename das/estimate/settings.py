"""The tuning of the localisation and of the online calibration: each figure with its meaning and its reason.

A gate given in standard deviations refers to those of the estimate and of the measurement together.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, NamedTuple


class Deviations(NamedTuple):
    """One standard deviation each of a measured position (m) and of a measured speed (m/s)."""

    position_m: float
    speed_mps: float


@dataclass(frozen=True, kw_only=True)
class SensorSettings:
    """How exact sensors are taken to be."""

    good: Deviations = field(default=Deviations(5.0, 0.2))
    """Standard deviations of a fix of good quality that states none (assumption)."""
    unknown: Deviations = field(default=Deviations(10.0, 0.3))
    """Standard deviations of a fix of unknown quality that states none (assumption)."""
    degraded: Deviations = field(default=Deviations(30.0, 0.5))
    """Standard deviations of a degraded fix that states none (assumption)."""
    least_position_sd_m: float = 0.5
    """A stated standard deviation of the position below this is raised to it: no receiver is believed to be better."""
    least_speed_sd_mps: float = 0.02
    """A stated standard deviation of the speed below this is raised to it: no odometer is believed to be better."""
    scale_sd: float = 0.04
    """Every speed is wrong by a share that the positions have to tell, whatever deviation its sender states: one
    standard deviation for worn wheels (8 % between new and worn: 2.3 %), a diameter set wrong and slip (3 %)."""
    speed_late_s: float = 1.75
    """A speed whose sender states no deviation is late by this: one standard deviation for receivers that filter their
    speeds (two recorded trips: 0.75 and 2.5 s)."""


@dataclass(frozen=True, kw_only=True)
class PossibleSettings:
    """What a fix can state at all; a fix beyond one of these bounds is rejected."""

    overspeed_ratio: float = 1.3
    """A speed above the train's largest one times this is a fault of the sensor."""
    backwards_mps: float = -0.3
    """A speed below this is a fault of the sensor; one between this and 0 is the noise of a standing train."""
    largest_m: float = 1e7
    """A position or a stated uncertainty beyond this is a fault of the sensor, because no line is 10 000 km long."""
    largest_stated_sd_m: float = 200.0
    """A fix that states a larger standard deviation is of no use: it could lie anywhere, and would hide any jump."""


@dataclass(frozen=True, kw_only=True)
class GateSettings:
    """How far a fix may lie off what is expected; a fix that lies further off is rejected."""

    sds: float = 5.0
    """A fix that is off by more than this many standard deviations is rejected: noise alone is off that far less
    than once in a million fixes."""
    least_m: float = 10.0
    """A position that is off by no more than this is never rejected, however exact the sensors claim to be."""
    least_mps: float = 1.0
    """A speed that is off by no more than this is never rejected, however exact the sensors claim to be."""


@dataclass(frozen=True, kw_only=True)
class MotionSettings:
    """How trains accelerate."""

    hard_mps2: float = 1.0
    """Any train can brake about as hard as this, whatever its traction."""
    effort_lasts_s: float = 60.0
    """A driver holds an effort for about this long; the jerk density is 2·σ²/this, with σ half the hardest start or
    braking."""
    manoeuvre_sds: float = 3.0
    """Where a measured speed is off by more than this many standard deviations, the driver may have changed the effort:
    the acceleration counts as unknown again."""


@dataclass(frozen=True, kw_only=True)
class StandstillSettings:
    """When a train counts as standing, and when it has set off."""

    slow_mps: float = 0.1
    """A measured speed up to this may be that of a standing train, however exact the odometer claims to be."""
    slow_sds: float = 2.5
    """A measured speed up to this many of its standard deviations may be that of a standing train."""
    expected_slow_mps: float = 0.5
    """A train whose estimated speed is above this is not taken to stand, whatever speed was measured last."""
    stands_after_s: float = 2.0
    """A train that may be standing for this long stands; one slow fix alone may be noise."""
    sets_off_sds: float = 3.3
    """One speed above this many standard deviations ends a standstill at once: noise alone is that large once in
    2 000 fixes."""
    creep_fixes: int = 5
    """The mean of this many speeds ends a standstill as well, where each alone is too slow to be told from noise."""


@dataclass(frozen=True, kw_only=True)
class FrozenSettings:
    """When a receiver that repeats its position counts as frozen."""

    way_m: float = 2.0
    """A position that stays the same while the train, by the measured speeds, runs further than this is frozen."""
    coarse_sds: float = 4.0
    """Where the speeds change, so that only the position stays the same, that distance must also exceed this many
    standard deviations of the position, because a coarse receiver repeats its position for a while."""


@dataclass(frozen=True, kw_only=True)
class RestartSettings:
    """When the estimate begins anew from the fixes received."""

    silence_s: float = 30.0
    """After this long without an accepted fix the estimate is dropped, and the next fix begins it anew."""
    fixes: int = 4
    """This many rejected fixes in a row that agree with each other show that the estimate was wrong, not the fixes."""
    span_s: float = 2.0
    """The rejected fixes that agree must span at least this long, because at 20 Hz four of them come
    within a fifth of a second."""


@dataclass(frozen=True, kw_only=True)
class UseSettings:
    """When an estimate may be used for advice."""

    stale_after_s: float = 3.0
    """An estimate is not used when its last fix is older than this, or is ahead of the clock by more
    than this."""
    largest_position_sd_m: float = 50.0
    """An estimate is not used when one standard deviation of its position is larger than this."""
    largest_speed_sd_mps: float = 2.0
    """An estimate is not used when one standard deviation of its speed is larger than this."""
    recovered_ratio: float = 0.7
    """An estimate that was too uncertain is used again below this share of the limits, so that advice does not
    come and go."""


@dataclass(frozen=True, kw_only=True)
class ClockSettings:
    """How the difference between the clock of the positions and ours is estimated."""

    most_fixes: int = 15
    """The difference is the median over this many fixes, so that single ones that were held up do not count."""
    memory_s: float = 30.0
    """Fixes received longer ago than this do not count."""
    largest_s: float = 10.0
    """A fix whose time stamp differs from the clock by more than this does not count: it was held up or replayed."""


@dataclass(frozen=True, kw_only=True)
class ClockStepSettings:
    """How a step of the clock of the positions is detected."""

    rate_fixes: int = 5
    """The usual time between two fixes is the median of this many intervals between them."""
    odd_fixes: int = 1
    """A receiver has a steady rate if at most this many of these intervals are not multiples of the usual one."""
    lost_fixes: int = 2
    """Up to this many fixes may have been lost just when the clock was set."""
    least_s: float = 0.25
    """A time stamp that is off the rate of its receiver by no more than this is jitter."""
    largest_s: float = 5.0
    """After a larger step, the estimate begins anew instead of going on."""


@dataclass(frozen=True, kw_only=True)
class SpeedScaleSettings:
    """When the measured speeds are taken to be of another unit than the way between the measured positions."""

    off: float = 1.4
    """The whole way and the median step must both give the factor within this factor: a jump of the position, or the
    spinning of a wheel, gives it by chance in one of the two only."""
    window_s: float = 10.0
    """The fixes of this last time are compared."""
    first_window_s: float = 60.0
    """The fixes of this last time are compared until the speeds are confirmed: a slow train needs longer."""
    other_unit_probability: float = 0.5
    """A sender may send another unit with this probability before anything is compared: nobody knows."""
    least_fixes: int = 4
    """At least this many fixes are compared, however rarely they come."""
    longest_gap_s: float = 6.0
    """After a longer time without a fix, the comparison begins anew."""
    sds: float = 4.0
    """The way by the speeds must differ from the way by the positions by more than this many standard deviations of the
    difference of two positions, to find another unit or to rule all others out for good."""
    least_m: float = 10.0
    """It must differ by at least this, however exact the sensors claim to be."""


@dataclass(frozen=True, kw_only=True)
class LocalisationSettings:
    """All the tuning of the localisation."""

    sensors: SensorSettings = field(default_factory=SensorSettings)
    possible: PossibleSettings = field(default_factory=PossibleSettings)
    gate: GateSettings = field(default_factory=GateSettings)
    motion: MotionSettings = field(default_factory=MotionSettings)
    standstill: StandstillSettings = field(default_factory=StandstillSettings)
    frozen: FrozenSettings = field(default_factory=FrozenSettings)
    restart: RestartSettings = field(default_factory=RestartSettings)
    use: UseSettings = field(default_factory=UseSettings)
    clock: ClockSettings = field(default_factory=ClockSettings)
    steps: ClockStepSettings = field(default_factory=ClockStepSettings)
    scale: SpeedScaleSettings = field(default_factory=SpeedScaleSettings)


LOCALISATION: Final = LocalisationSettings()
"""The tuning that the localisation is run with."""

STALE_AFTER_S: Final = LOCALISATION.use.stale_after_s
"""An estimated position whose last fix is older than this (s) is not used for advice."""
OVERSPEED_RATIO: Final = LOCALISATION.possible.overspeed_ratio
"""A measured speed above the train's largest one times this is a fault of the sensor."""
LEAST_SD_M: Final = LOCALISATION.sensors.least_position_sd_m
"""The smallest standard deviation of a position (m) that a receiver is believed to have."""
LEAST_SD_MPS: Final = LOCALISATION.sensors.least_speed_sd_mps
"""The smallest standard deviation of a speed (m/s) that an odometer is believed to have."""


class MassAndResistance(NamedTuple):
    """One figure for the mass ratio and one for the resistance ratio."""

    mass: float
    resistance: float


@dataclass(frozen=True, kw_only=True)
class SampleSettings:
    """Which measurements become samples of a window."""

    every_s: float = 0.9
    """A sample nearer than this to the one before is left out: a window takes about one sample a second."""
    longest_gap_s: float = 2.5
    """After a longer gap between samples a window begins anew; efforts further apart than this say nothing about the
    forces between them."""
    most_waiting: int = 100
    """At most this many positions wait for the next effort; older ones are dropped, so that memory stays bounded."""
    slowest_mps: float = 5.0
    """Samples at lower speeds do not count: there brakes are being released, couplers stretch, and the resistance does
    not follow Davis."""
    adhesion_ratio: float = 0.9
    """Samples with forces above this share of the adhesion limit of a dry rail do not count: wheels may slip."""
    possible_force_ratio: float = 1.5
    """A force above this times the train's largest one is a fault of the sensor."""
    overspeed_ratio: float = OVERSPEED_RATIO
    """A speed above this times the train's top speed is a fault of the sensor, as it is for the localisation."""


@dataclass(frozen=True, kw_only=True)
class WindowSettings:
    """How samples become one observation, and how exact it is."""

    samples: int = 20
    """Samples of a window: at 1 Hz and 0.05 m/s of noise their slope gives the acceleration to 0.002 m/s²."""
    speed_sd_mps: float = 0.05
    """The least noise of a measured speed (one standard deviation); a window whose speeds scatter more is trusted
    less."""
    force_sd_ratio: float = 0.02
    """The noise of each measured force, as a share of it (one standard deviation)."""
    friction_sd_ratio: float = 0.1
    """The standing error of the measured friction brake force, as a share of it (one standard deviation): the force is
    known from cylinder pressures only."""
    line_sd_ratio: float = 2e-4
    """How well gradients and curves under the train are known, as a share of its weight (one standard deviation)."""
    odometry_m: float = 40.0
    """A window is left out if its positions and its speeds disagree about the distance run by more than this."""
    neutral_margin_m: float = 30.0
    """A window that comes nearer than this to a neutral section is left out."""
    grid_m: float = 10.0
    """The step with which the line is integrated along the way."""


@dataclass(frozen=True, kw_only=True)
class BeliefSettings:
    """How observations become an estimate of the two ratios."""

    prior_sd: MassAndResistance = field(default=MassAndResistance(0.15, 0.3))
    """Standard deviations of the two ratios before anything is measured."""
    least: MassAndResistance = field(default=MassAndResistance(0.5, 0.4))
    """The least values of the two estimates: an empty train, and a long tail wind."""
    most: MassAndResistance = field(default=MassAndResistance(1.6, 2.5))
    """The largest values of the two estimates: an overloaded train, and a storm from ahead."""
    forgetting: float = 0.98
    """The weight of an observation is multiplied by this at every later one about the same ratio: the memory is about
    50 windows, 17 minutes."""
    informative_sds: float = 2.0
    """A window counts if the prior spread of the ratios (`prior_sd`) would show in it by at least this many standard
    deviations of its noise."""
    surprise_sds: float = 4.0
    """A window further than this many standard deviations from what is expected is left out: wheels slipped, a sensor
    failed, or a force is unknown."""
    surprises: int = 3
    """This many surprising windows in a row mean that conditions have changed: the resistance is learned anew."""
    model_sd: MassAndResistance = field(default=MassAndResistance(0.005, 0.015))
    """The uncertainty that no amount of measuring removes (one standard deviation): forces between samples are unknown,
    and so is the exact shape of the resistance."""
    usable_sd: MassAndResistance = field(default=MassAndResistance(0.02, 0.08))
    """The estimates are usable where both are known at least as well as this."""


@dataclass(frozen=True, kw_only=True)
class ForceSettings:
    """When the force sensor is not trusted."""

    clocks_differ_s: float = 0.3
    """Forces whose time stamps differ by more than this from those of the positions belong to other moments."""
    too_strong_ratio: float = 1.06
    """Noise of 2 % does not explain a measured force above this times the train's largest one at its speed."""
    too_strong_samples: int = 5
    """After this many samples in a row with forces that are too strong, the sensor is taken to measure too much."""
    idle_ratio: float = 0.005
    """Forces below this share of the train's starting force are those of a coasting train."""
    coasting_windows: int = 4
    """This many windows of coasting are compared with the estimate from windows with traction or braking."""
    coasting_sds: float = 3.0
    """Coasting contradicts the measured forces if the coasting windows differ from that estimate by more than this many
    standard deviations on average."""
    gain_step: float = 0.03
    """A mass ratio nearer to 1 than this would not change the plan, so no wrong gain of the sensor is looked for."""
    gain_sds: float = 3.0
    """If mass and resistance ratio are nearer to each other than this many standard deviations, a wrong gain of the
    force sensor may explain both."""
    near_mass_least: float = 0.7
    """A mass ratio below this, or above `near_mass_most`, is reported with both explanations: another train than
    planned, or a wrong force sensor."""
    near_mass_most: float = 1.4
    """A mass ratio above this, or below `near_mass_least`, is reported with both explanations: another train than
    planned, or a wrong force sensor."""


@dataclass(frozen=True, kw_only=True)
class LoadSettings:
    """How the load may change at a stop."""

    stands_for_s: float = 20.0
    """A train that stands for this long may have let passengers on and off."""
    mass_sd: float = 0.05
    """The mass after a stop that long differs by this share of the train's (one standard deviation): 500 people in a
    train of 440 t are 9 %."""


@dataclass(frozen=True, kw_only=True)
class ReplanSettings:
    """When the estimates call for another plan."""

    mass_step: float = 0.03
    """A mass ratio nearer than this to the plan's is not worth another plan."""
    resistance_step: float = 0.05
    """A resistance ratio nearer than this to the plan's is not worth another plan."""
    certain_sds: float = 3.0
    """A difference of fewer standard deviations than this is too uncertain for another plan."""
    every_s: float = 120.0
    """Plans are made anew because of the estimates at most once in this time."""


@dataclass(frozen=True, kw_only=True)
class CalibrationSettings:
    """All the tuning of the online calibration."""

    sample: SampleSettings = field(default_factory=SampleSettings)
    window: WindowSettings = field(default_factory=WindowSettings)
    belief: BeliefSettings = field(default_factory=BeliefSettings)
    force: ForceSettings = field(default_factory=ForceSettings)
    load: LoadSettings = field(default_factory=LoadSettings)
    replan: ReplanSettings = field(default_factory=ReplanSettings)


CALIBRATION: Final = CalibrationSettings()
"""The tuning that the calibration is run with."""
