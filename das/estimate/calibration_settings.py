"""The tuning of the online calibration, as frozen data: each figure with its meaning and why it is what it is."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, NamedTuple

from das.estimate.localisation_settings import OVERSPEED_RATIO


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
    """Samples with forces above this share of what a dry rail carries do not count, because wheels may slip."""
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
    """A measured force above this times the train's largest one at its speed cannot be explained by noise of 2 %."""
    too_strong_samples: int = 5
    """This many samples in a row with too strong forces show that the sensor states too much."""
    idle_ratio: float = 0.005
    """Forces below this share of the train's starting force are those of a coasting train."""
    coasting_windows: int = 4
    """This many windows of coasting are compared with the estimate from windows with traction or braking."""
    coasting_sds: float = 3.0
    """Coasting contradicts the measured forces if the coasting windows differ from that estimate by more than this many
    standard deviations in the mean."""
    gain_step: float = 0.03
    """A mass ratio nearer to 1 than this would not change the plan, so no wrong gain of the sensor is looked for."""
    gain_sds: float = 3.0
    """If mass and resistance ratio are nearer to each other than this many standard deviations, a wrong gain of the
    force sensor may explain both."""
    near_mass_least: float = 0.7
    near_mass_most: float = 1.4
    """A mass ratio below `near_mass_least` or above this is reported with both explanations: another train than
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


DEFAULT: Final = CalibrationSettings()
