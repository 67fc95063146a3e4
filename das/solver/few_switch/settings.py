"""The settings of few-switch trajectories and schedules: each figure with its meaning and its reason."""

from __future__ import annotations

from dataclasses import dataclass

from das.domain.units import KMH


@dataclass(frozen=True, kw_only=True)
class FewSwitchSettings:
    """The notches of few-switch trajectories, the price of a change, and the ladder of multipliers."""

    traction_shares: tuple[float, ...] = (1.0, 0.8, 0.6, 0.4)
    """The steps of traction effort, as shares of the largest."""
    brake_shares: tuple[float, ...] = (1.0, 0.7, 0.4)
    """The steps of the electric brake, as shares of the largest."""
    change_s: float = 0.08
    """A change of the notch must save as much energy as the train's full power needs in this time: 0.13 kWh of a
    locomotive of 6 MW. `das-precompute few-switch` shows what other prices do."""
    ladder_size: int = 32
    """The number of multipliers λ."""
    low_ratio: float = 0.004
    """The lowest multiplier, as a share of the traction power that can be used on the section."""
    high_ratio: float = 3.0
    """The highest multiplier, as a multiple of the same power; its trajectory is almost the fastest."""


@dataclass(frozen=True, kw_only=True)
class ScheduleSettings:
    """How a few-switch trajectory becomes a schedule."""

    least_s: float = 10.0
    """A phase other than a brake lasts at least this long (s), or becomes part of a neighbour."""
    back_share: float = 0.6
    """A train slower than the speed to hold gets back to it with this share of its traction."""
    ripple_mps: float = 1.5
    """A short acceleration by less than this, from one speed to hold to the next, is left out."""
    reach_m: float = 2000.0
    """Coasting begins at most this much earlier than in the few-switch trajectory, so that the train is not early."""
    tries: int = 8
    """The place where coasting begins, or the highest speed, is narrowed down in this number of steps."""
    near_s: float = 0.3
    """A schedule that arrives within this time (s) of the wanted one is near enough."""
    early_s: float = 1.0
    """A schedule that arrives earlier than wanted by more than this (s) gets a lower highest speed."""
    lowest_top_ratio: float = 0.8
    """The lowered highest speed of an early schedule is at least this share of the previous one."""
    late_s: float = 1.0
    """A schedule that arrives later than wanted by more than this (s) is made again from a quicker trajectory."""
    rounds: int = 4
    """At most this number of trajectories is tried, each quicker than the one before."""


@dataclass(frozen=True, kw_only=True)
class PolishSettings:
    """How far phases are changed in place, speed and effort."""

    steps_m: tuple[float, ...] = (200.0, 80.0, 30.0)
    """A phase begins this much (m) earlier or later, in rounds of smaller and smaller steps."""
    steps_mps: tuple[float, ...] = (3.0 * KMH, 1.0 * KMH, 0.5 * KMH)
    """A speed is made this much (m/s) lower or higher, in the same rounds."""
    steps_share: tuple[float, ...] = (0.2, 0.2, 0.0)
    """An effort is made this much smaller or larger, in the same rounds: a fifth, as finely as a driver reads it. An
    effort between two fifths would flicker on a display that rounds to them."""
    thorough_steps_share: tuple[float, ...] = (0.2, 0.1, 0.1)
    """As `steps_share`, for a schedule polished thoroughly: at a departure, or if there was no reference before."""
    prices: int = 3
    """A schedule that is polished thoroughly is first polished at this number of prices of time."""
    price_ratio: float = 2.0
    """The prices tried in a thorough polish are at most this many times lower or higher than the schedule's own."""
    least_s: float = 10.0
    """No phase except a brake becomes shorter than this (s)."""
    rounds: int = 2
    """A schedule is polished at most this number of times, until it is in time."""
    late_s: float = 1.0
    """A schedule that is later than wanted by more than this (s) is polished once more for less time."""
