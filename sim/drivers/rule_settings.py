"""How drivers with a controller drive: settings of the drivers by rule and of the perfect follower."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from das.domain.units import KMH


@dataclass(frozen=True, kw_only=True)
class RuleSettings:
    """How the drivers by rule drive and keep time. All values are assumptions."""

    late_braking_mps2: float = 0.9
    """Deceleration (m/s²) of a driver who brakes late: full service braking of a passenger train."""
    easy_braking_mps2: float = 0.5
    """Deceleration (m/s²) of a driver who brakes comfortably."""
    anticipation_s: float = 0.8
    """A practised driver acts this much (s) earlier: dead time and half the build-up of an effort."""
    judged_every_s: float = 15.0
    """A driver who keeps time compares clock and timetable this often (s)."""
    spare_s: float = 2.0
    """He means to arrive this much (s) early, because the last metres take longer than one thinks."""
    roll_mps: float = 8.0 * KMH
    """He lets the train roll up to this much (m/s) above the speed that would do, before he brakes."""


@dataclass(frozen=True, kw_only=True)
class TrackingSettings:
    """How a controller keeps to a speed and stops at a mark; chosen so that it neither hunts nor creeps."""

    ahead_s: float = 0.2
    """The slope of a ceiling is taken over this time (s): one look."""
    gain_per_s: float = 0.5
    """This share of a speed error is driven away per second."""
    stopping_mps: float = 10.0
    """Below this speed (m/s) a train that brakes for its halt is braked by what the rest of the way needs."""
    stopping_ratio: float = 0.85
    """It is braked so from this share of the planned deceleration on."""
    last_m: float = 0.05
    """Nearer to the halt (m) than this, and beyond it, the planned deceleration is used."""
    last_mps: float = 0.02
    """Slower than this (m/s) at the halt, the planned deceleration is used: a train that resists more than known would
    creep on for ever."""


@dataclass(frozen=True, kw_only=True)
class FollowingSettings:
    """How the perfect follower follows the advice. All values are assumptions."""

    stopping_s: float = 10.0
    """When the advice ends in a standstill within this time (s), the follower brakes for the mark itself."""
    minded_mps: float = 1.0
    """This near (m/s) to what a restriction or a signal allows, he leaves the advice."""
    least_braking_mps2: float = 0.05
    """Nobody brakes less (m/s²) than this for the mark: there is still a way to drive, after a signal short of it."""
    creeping_mps: float = 0.3
    """A speed to brake to that is lower than this is a halt."""
    rolling_mps: float = 0.3
    """A train that is to coast is let roll above a limit by up to this (m/s): so well he reads the display."""
    motors_ratio: float = 1.08
    """The friction brake is not taken where all needs no more than this times what the motors give: it lets go slowly,
    and at a lower speed the motors give more."""
    release_s: float = 0.4
    """An effort is given up this much (s) before it is due: half the time it takes to fall."""


RULE: Final = RuleSettings()
TRACKING: Final = TrackingSettings()
FOLLOWING: Final = FollowingSettings()
