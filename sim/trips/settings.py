"""Constants of a recorded trip that several modules share: what is possible, likely and known.

The values are assumptions unless said otherwise. They were tried on clean, noisy and damaged records
(docs/reference/trips.md). A constant that one module uses stands there.
"""

from __future__ import annotations

from typing import Final

from das.domain.units import KMH

MAX_BACKWARD_M: Final = 30.0
"""Length (m) up to which steps back are noise; longer ones mean that the train turned, or are jumps if it drives on."""
STRAY_WEIGHT: Final = 3.0
"""Cost of each point left out between two points that only just fit each other. Without it, the chain of positions
could change to a wrong part of the record and back, as if the train braked and accelerated as hard as it can."""
LEAST_KEPT_RATIO: Final = 0.5
"""Share of a record's points that must fit together, or of the section that they must cover."""
STALL_HALF_WINDOW_S: Final = 15.0
"""Time (s) within which the positions of a receiver that stalled have caught up again."""
WRONG_SPEED_MPS: Final = 4.0
"""Difference (m/s) from that of the positions above which, and above `WRONG_SPEED_RATIO`, a reported speed is wrong; a
delay of 3 s at 1 m/s² explains less."""
RECORD_STANDS_MPS: Final = 1.0 * KMH
"""Reported speed (m/s) below which a train stands if its positions do not move."""
WANDER_M: Final = 30.0
"""Largest wander (m) of the positions of a standing train, which come back; `MAX_BACKWARD_M` is as large."""
AT_PLATFORM_M: Final = 300.0
"""Distance (m) within which a standing train stands at a stop: platforms are long, and maps inexact."""
MAX_CROSS_TRACK_M: Final = 200.0
"""Distance (m) from the line beyond which a point is not on it. Lines through kilometre posts cut curves: 62 m at a
radius of 2 km."""
LEAST_MOVED_M: Final = 30.0
"""Distance (m) up to which a record whose positions lead no further is no trip: noise alone may spread them as far."""
SCALE_TOLERANCE_RATIO: Final = 0.01
"""Largest ratio by which matched length and distance between the stops may differ for the kilometrage to be scaled to
the stops."""
SMOOTHING_JERK_PSD_M2PS5: Final = 0.03
"""Density of the white jerk (m²/s⁵). With the speed's weight the smoothing acts like a local fit over
(σ²/psd)^¼ ≈ 1.7 s on either side, about 8 s in all."""
SMOOTHING_MAX_POSITION_GAP_S: Final = 6.0
"""Longest gap (s) over which positions are joined; inertia leads through longer ones."""
ESTIMATE_BEYOND_RATIO: Final = 1.05
"""Multiple of the vehicle's envelope beyond which a force is more than the vehicle has."""
ESTIMATE_MASS_RATIO: Final = 0.05
"""Share by which the mass may be off."""
ESTIMATE_RESISTANCE_RATIO: Final = 0.10
"""Share by which the running resistance may be off."""
ESTIMATE_WIND_MPS: Final = 5.0
"""Speed (m/s) of a wind that may blow along the line, either way."""
ESTIMATE_HELD_S: Final = 8
"""Time (s) for which the strongest force is held: the smoothing acts over it and hides shorter ones."""
ESTIMATE_FOREIGN_RATIO: Final = 0.005
"""Share of the time with more force than the vehicle has above which another vehicle drove the trip."""
CHOICE_OVERSPEED_RATIO: Final = 1.05
"""Multiple of their top speed up to which trains are driven: train protection brakes above it."""
