"""Settings for reading a recorded trip: what is possible, likely and known, each with its unit and reason.

The values are assumptions unless a field says otherwise. They were tried on clean, noisy and damaged records
(docs/reference/trips.md). The program uses the constants at the end.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

from das.domain.units import KMH


@dataclass(frozen=True, kw_only=True)
class PositionSettings:
    """Which positions of a train are impossible."""

    jump_m: float = 50.0
    """A position further (m) than this from where its neighbours put it is a jump if no change of speed explains it."""
    max_backward_m: float = 30.0
    """Steps back up to this (m) are noise; longer ones mean that the train turned, or are jumps if it drives on."""
    change_mps2: float = 1.0
    """The speed of an unseen train may change by this (m/s²): no train brakes harder in service."""
    steps_around: int = 5
    """The speed of the positions around a point is the median of this many steps on either side."""
    frozen_ratio: float = 0.5
    """A repeated position was wrong if the next position is further on by at least this share of the distance that the
    reported speeds give."""
    late_s: float = 5.0
    """Reported speeds may be this late (s), which makes their integral uncertain."""
    scale_ratio: float = 0.02
    """The integral of reported speeds may be wrong by this share of itself."""
    points_back: int = 120
    """Wrong positions are found if fewer than this many follow in a row: points further apart are not compared."""
    longest_jump_s: float = 120.0
    """Wrong positions are found if they last at most this long (s): points further apart are not compared."""
    stray_weight: float = 3.0
    """Cost of each point left out between two points that only just fit each other. Without this cost, the chain of
    positions could change to a wrong part of the record and back, as if the train braked and accelerated as hard as it
    can."""
    top_speed_percentile: float = 99.0
    """The top speed of a trip is this percentile of the speeds around its points, because a few may be wrong."""
    least_kept_ratio: float = 0.5
    """A record is refused unless this share of its points fit together, or those that fit cover this share of the
    section."""


@dataclass(frozen=True, kw_only=True)
class SpeedSettings:
    """Which reported speeds are impossible."""

    derived_half_window_s: float = 5.0
    """The speed from positions is their mean slope over this time (s) on either side."""
    stall_half_window_s: float = 15.0
    """After a receiver stalls, its positions have caught up again within this time (s)."""
    wrong_speed_mps: float = 4.0
    """A reported speed is wrong if it differs from that of the positions by more than this (m/s) and by more than
    `wrong_speed_ratio`; a delay of 3 s at 1 m/s² explains less."""
    wrong_speed_ratio: float = 0.2
    """A reported speed is wrong only if it also differs by more than this share of the speed that positions give."""
    edge_mps: float = 1.0
    """Beside a wrong speed, one that still differs by this (m/s) is wrong as well if it jumps (`edge_mps2`) or repeats
    (`same_mps`)."""
    edge_mps2: float = 1.5
    """A speed jumps if it changes faster than this (m/s²)."""
    same_mps: float = 0.05
    """A speed repeats if it differs by less than this (m/s) from the one before."""


@dataclass(frozen=True, kw_only=True)
class GapSettings:
    """When points are missing."""

    gap_s: float = 5.0
    """A time without points is a gap if it is longer than this (s) and than `gap_steps` usual steps."""
    gap_steps: float = 3.0
    """A time without points is a gap only if it is longer than this many usual steps between points."""
    sparse_s: float = 30.0
    """A time without points that is longer than this (s) is a gap in any record, however sparse."""
    longest_gap_s: float = 300.0
    """A gap longer than this (s) splits the record if the train moved in it or beside it; the largest part is kept."""


@dataclass(frozen=True, kw_only=True)
class StandSettings:
    """When a train stands, and where."""

    standing_mps: float = 1.0 * KMH
    """A train stands if it is reported slower than this (m/s) and its positions do not move."""
    standing_by_positions_mps: float = 0.5
    """Where no speed is reported, a train stands if its positions are slower than this (m/s): they wander by some
    metres in 10 s."""
    wander_m: float = 30.0
    """Positions of a standing train wander by no more than this (m) and come back; `max_backward_m` is as large."""
    led_window_s: float = 12.0
    """Positions at an end of a record show a stand if they slow down to it over this time (s)."""
    led_points: int = 4
    """Positions at an end of a record show a stand only if there are at least this many within `led_window_s`."""
    led_speed_mps: float = 2.0
    """Positions at an end of a record show a stand only if their speed there is no more than this (m/s)."""
    led_change_mps2: float = 0.1
    """Positions at an end of a record show a stand only if they slow down by at least this (m/s²): noise gives less."""
    gentle_mps2: float = 0.3
    """No train stops or starts more gently than this (m/s²), so v²/2a and v/a bound what may be left of its motion."""
    at_stop_m: float = 300.0
    """A train that stands this near (m) to a stop stands at it: platforms are long, and maps inexact."""
    stand_kept_s: float = 30.0
    """This much (s) of a stand at the start or the end is kept."""
    shortest_stand_s: float = 5.0
    """A stand on the way that is shorter than this (s) is not reported: at 1 Hz it may be a single slow point."""


@dataclass(frozen=True, kw_only=True)
class PlacingSettings:
    """How a record is put on the line and on the stops."""

    max_cross_track_m: float = 200.0
    """A point further (m) from the line than this is not on it. Lines through kilometre posts cut curves: 62 m at a
    radius of 2 km."""
    least_moved_m: float = 30.0
    """A record whose positions lead no further than this (m) is no trip: noise alone may spread them as far."""
    one_way_ratio: float = 0.5
    """The ends of a trip in one direction are at least this share of its whole extent apart."""
    scale_tolerance_ratio: float = 0.01
    """The kilometrage is scaled to the stops if the matched length and the distance between the stops differ by at most
    this."""
    told_m: float = 0.01
    """Positions that were moved by less than this (m) are not reported."""
    whole_trip_m: float = 100.0
    """A trip is the whole section if it starts and ends this near (m) to the stops."""
    fastest_mps: float = 400.0 * KMH
    """A record that leads to a higher speed (m/s) is no train's trip."""


@dataclass(frozen=True, kw_only=True)
class SmoothingSettings:
    """How a smooth run is laid through positions and speeds."""

    position_sigma_m: float = 25.0
    """Weight of a position per second, as a standard deviation (m): errors of some 6 m last about 15 s, hence 6·√15."""
    speed_sigma_mps: float = 0.5
    """Weight of a reported speed per second, as a standard deviation (m/s)."""
    jerk_psd_m2ps5: float = 0.03
    """Density of the white jerk (m²/s⁵). With the speed's weight the smoothing acts like a local fit over
    (σ²/psd)^¼ ≈ 1.7 s on either side, about 8 s in all."""
    exact: float = 1e-3
    """Standard deviation of what is known exactly: the position of a stop (m), and the speed 0 there (m/s)."""
    max_speed_gap_s: float = 3.0
    """Reported speeds further apart (s) than this are not joined; inertia leads through the gap."""
    max_position_gap_s: float = 6.0
    """Positions further apart (s) than this are not joined; inertia leads through the gap."""
    usual_steps_joined: float = 2.0
    """In a sparse record, points up to this many usual steps apart are joined nevertheless."""
    min_lag_gain_ratio: float = 0.2
    """A lag of the speed must explain this share of the spread between integrated speed and position, else it is 0."""
    min_lag_gain_m: float = 1.0
    """A lag must also explain this much (m) of the spread."""


@dataclass(frozen=True, kw_only=True)
class EstimateSettings:
    """How the energy of a trip is estimated, and how far off it may be."""

    min_step_m: float = 0.05
    """Points nearer to each other (m) than this count as one, at which the train stands."""
    beyond_ratio: float = 1.05
    """A force beyond this many times the vehicle's envelope is more than this vehicle has."""
    mass_ratio: float = 0.05
    """The mass may be off by this share."""
    most_doubt_ratio: float = 0.25
    """For want of force, mass and resistance may be off by at most this share more: an empty or an overloaded train."""
    resistance_ratio: float = 0.10
    """The running resistance may be off by this share."""
    wind_mps: float = 5.0
    """There may be a wind of this speed (m/s) along the line, either way."""
    held_s: int = 8
    """The strongest force is one held for this long (s): the smoothing acts over this time and hides shorter ones."""
    smoothing_ratio: float = 10.0
    """The density of jerk may be this many times higher or lower: the window shrinks or grows by a factor of 1.8."""
    foreign_ratio: float = 0.005
    """If a trip needs more force than the vehicle has in more than this share of the time, another vehicle drove it."""


class RegimeShares(NamedTuple):
    """How often drivers do what; a uniform density counts per 1 m/s² of acceleration."""

    coasting: float = 0.08
    full: float = 0.12
    """Full traction."""
    held: float = 0.4
    """A speed is held."""
    traction: float = 0.45
    """Any other traction: its density is the same for all trains that have the effort."""
    braking: float = 0.3
    """Any braking: its density is the same for all trains that have the brakes."""
    unexplained: float = 2.5e-4
    """Everything else: a force that the train does not have, or a wrong record."""


@dataclass(frozen=True, kw_only=True)
class TrainWindows:
    """The windows of the motion by which a train is found, and how exact they are."""

    samples: int = 12
    """Samples of a window, one a second: less shows no acceleration beside the noise, more mixes what a driver does."""
    weight: float = 0.5
    """Weight of a window, because each overlaps half of the one before."""
    least: int = 8
    """A trip with fewer windows is too short to find its train."""
    unmeasured_speed_sd_mps: float = 0.3
    """Noise (m/s) of the speeds of a record that reports none."""
    line_sd_ratio: float = 5e-4
    """How well gradients and curves are known, as a share of the weight (one standard deviation)."""
    full_sd_ratio: float = 0.02
    """How exactly the full effort of the train is known (one standard deviation)."""
    held_sd_mps2: float = 0.02
    """A driver who holds a speed accelerates by this (m/s², one standard deviation)."""
    hardest_braking_mps2: float = 1.0
    """No driver brakes harder than this (m/s²) in service, however strong the brakes are."""


@dataclass(frozen=True, kw_only=True)
class RatioSearch:
    """Which masses and resistances of a train are tried, and what is known of them beforehand."""

    mass_bounds: tuple[float, float] = (0.7, 1.4)
    """Bounds of the mass: an empty train, and an overloaded train."""
    resistance_bounds: tuple[float, float] = (0.5, 2.0)
    """Bounds of the resistance: a long tail wind, and a storm from ahead."""
    steps: int = 36
    """Values of either ratio that are tried."""
    mass_sd: float = 0.1
    """Standard deviation of the mass ratio before the motion is looked at."""
    resistance_log_sd: float = 0.15
    """Standard deviation of the logarithm of the resistance ratio before the motion is looked at."""
    model_sd: float = 0.015
    """The uncertainty of either ratio that no motion removes (one standard deviation)."""
    known_sd_ratio: float = 0.6
    """A record shows the mass if it reduces the standard deviation to this share of that beforehand."""
    evidence_weight: float = 0.5
    """Weight of the evidence between trains, because windows of one driver are alike: the likeliest train is right
    about as often as its probability says on simulated drives."""


@dataclass(frozen=True, kw_only=True)
class TrainChoice:
    """Which trains are possible, and what their speeds say."""

    certain_sds: float = 2.0
    """A window needs more effort than the train has only if noise of this many standard deviations is no reason."""
    beyond_ratio: float = 0.02
    """A train cannot have driven a trip that needs more effort in more than this share of the time …"""
    beyond_windows: int = 3
    """… and in at least this many windows."""
    overspeed_ratio: float = 1.05
    """Trains are driven up to this many times their top speed: train protection brakes above it."""
    high_percentile: float = 90.0
    """The high speed of a trip is this percentile over its way, and the speed allowed likewise."""
    slower_ratio: float = 0.1
    """By this share (the mean of an exponential distribution) drivers stay below what line and train allow."""
    places: int = 500
    """Places along the way at which speeds are compared."""


POSITIONS: Final = PositionSettings()
SPEEDS: Final = SpeedSettings()
GAPS: Final = GapSettings()
STANDS: Final = StandSettings()
PLACING: Final = PlacingSettings()
SMOOTHING: Final = SmoothingSettings()
ESTIMATE: Final = EstimateSettings()
WINDOWS: Final = TrainWindows()
SHARES: Final = RegimeShares()
RATIO_SEARCH: Final = RatioSearch()
CHOICE: Final = TrainChoice()
"""With `WINDOWS`, `SHARES` and `RATIO_SEARCH`: how the train of a trip is found; tried on simulated drives
(docs/explanation/find-train.md)."""
