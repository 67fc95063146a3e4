"""What a train can do and needs at each speed: forces, acceleration, losses, and the energy of cruising."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.domain.vehicle import Vehicle

Floats = NDArray[np.float64]


class Performance(NamedTuple):
    """A train at n speeds on a dry level line (n,), at its default level of losses.

    Cruising needs `cruising_j_per_m` at the current collector; it is NaN, with its loss, where the traction cannot hold
    the speed. `idle_loss_w` is the loss without effort.
    """

    traction_n: Floats
    electric_brake_n: Floats
    resistance_n: Floats
    acceleration_mps2: Floats
    cruising_loss_w: Floats
    full_traction_loss_w: Floats
    idle_loss_w: Floats
    cruising_j_per_m: Floats


def performance_of(train: Vehicle, speed_mps: Floats) -> Performance:
    """The performance of a train at each speed > 0 (m/s)."""
    traction, resistance = train.traction_effort_n(speed_mps), train.resistance.force_n(speed_mps)
    loss, held = train.loss_model(train.default_level), resistance <= traction
    cruising_w = np.where(held, loss.loss_w(np.where(held, resistance, 0.0), speed_mps), np.nan)
    return Performance(
        traction_n=traction,
        electric_brake_n=train.electric_brake_effort_n(speed_mps),
        resistance_n=resistance,
        acceleration_mps2=np.minimum((traction - resistance) / train.inertial_mass_kg, train.max_acceleration_mps2),
        cruising_loss_w=cruising_w,
        full_traction_loss_w=loss.loss_w(traction, speed_mps),
        idle_loss_w=loss.loss_w(np.zeros_like(speed_mps), speed_mps),
        cruising_j_per_m=resistance + cruising_w / speed_mps,
    )
