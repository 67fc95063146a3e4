"""Constants of a recorded trip that several modules share: what is possible, likely and known.

The values are assumptions unless said otherwise. They were tried on clean, noisy and damaged records
(docs/reference/trips.md). A constant that one module uses stands there.
"""

from __future__ import annotations

from typing import Final

from das.domain.units import KMH

MAX_BACKWARD_M: Final = 30.0
"""Steps back up to this (m) are noise; longer ones mean that the train turned, or are jumps if it drives on."""
STRAY_WEIGHT: Final = 3.0
"""Cost of each point left out between two points that only just fit each other. Without this cost, the chain of
positions could change to a wrong part of the record and back, as if the train braked and accelerated as hard as it
can."""
LEAST_KEPT_RATIO: Final = 0.5
"""A record is refused unless this share of its points fit together, or those that fit cover this share of the
section."""
STALL_HALF_WINDOW_S: Final = 15.0
"""After a receiver stalls, its positions have caught up again within this time (s)."""
WRONG_SPEED_MPS: Final = 4.0
"""A reported speed is wrong if it differs from that of the positions by more than this (m/s) and by more than
`WRONG_SPEED_RATIO`; a delay of 3 s at 1 m/s² explains less."""
RECORD_STANDS_MPS: Final = 1.0 * KMH
"""A train stands if it is reported slower than this (m/s) and its positions do not move."""
WANDER_M: Final = 30.0
"""Positions of a standing train wander by no more than this (m) and come back; `MAX_BACKWARD_M` is as large."""
AT_PLATFORM_M: Final = 300.0
"""A train that stands this near (m) to a stop stands at it: platforms are long, and maps inexact."""
MAX_CROSS_TRACK_M: Final = 200.0
"""A point further (m) from the line than this is not on it. Lines through kilometre posts cut curves: 62 m at a
radius of 2 km."""
LEAST_MOVED_M: Final = 30.0
"""A record whose positions lead no further than this (m) is no trip: noise alone may spread them as far."""
SCALE_TOLERANCE_RATIO: Final = 0.01
"""The kilometrage is scaled to the stops if the matched length and the distance between the stops differ by at most
this."""
SMOOTHING_JERK_PSD_M2PS5: Final = 0.03
"""Density of the white jerk (m²/s⁵). With the speed's weight the smoothing acts like a local fit over
(σ²/psd)^¼ ≈ 1.7 s on either side, about 8 s in all."""
SMOOTHING_MAX_POSITION_GAP_S: Final = 6.0
"""Positions further apart (s) than this are not joined; inertia leads through the gap."""
ESTIMATE_BEYOND_RATIO: Final = 1.05
"""A force beyond this many times the vehicle's envelope is more than this vehicle has."""
ESTIMATE_MASS_RATIO: Final = 0.05
"""The mass may be off by this share."""
ESTIMATE_RESISTANCE_RATIO: Final = 0.10
"""The running resistance may be off by this share."""
ESTIMATE_WIND_MPS: Final = 5.0
"""There may be a wind of this speed (m/s) along the line, either way."""
ESTIMATE_HELD_S: Final = 8
"""The strongest force is one held for this long (s): the smoothing acts over this time and hides shorter ones."""
ESTIMATE_FOREIGN_RATIO: Final = 0.005
"""If a trip needs more force than the vehicle has in more than this share of the time, another vehicle drove it."""
CHOICE_OVERSPEED_RATIO: Final = 1.05
"""Trains are driven up to this many times their top speed: train protection brakes above it."""
