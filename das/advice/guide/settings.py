"""The settings of the guide, as frozen data: each figure with its meaning and reason."""

from __future__ import annotations

from dataclasses import dataclass, field

from das.solver.guide.policies import PolicySettings


@dataclass(frozen=True, kw_only=True)
class KeepingSettings:
    """When the guide keeps its reference (its standing plan), and when a new one is worth the change."""

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
class GuideSettings:
    """All settings of the guide."""

    enabled: bool = False
    """Whether there is a guide; if not, nothing is computed for it."""
    policies: PolicySettings = field(default_factory=PolicySettings)
    keeping: KeepingSettings = field(default_factory=KeepingSettings)
    margin: MarginSettings = field(default_factory=MarginSettings)
    loss: LossSettings = field(default_factory=LossSettings)


DEFAULT = GuideSettings()
