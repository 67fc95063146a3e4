"""The notches of a few-switch trajectory: the few things that a driver does with the controller, one of them at a
time."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class NotchRegime(IntEnum):
    """What a notch does; the kernels know these numbers."""

    TRACTION = 0
    """A share of the largest traction effort."""
    HOLD = 1
    """The speed is held, by traction or by brakes."""
    COAST = 2
    """No effort at all."""
    BRAKE = 3
    """A share of the largest effort of the electric brake, until the lower speed ahead is reached."""
    CURVE = 4
    """The brakes keep the train on the braking curve of a limit or stop ahead."""


class Notches(NamedTuple):
    """The notches as the kernels take them (M,): the kind of each, and its share of the largest effort."""

    kind: NDArray[np.int64]
    share: NDArray[np.float64]


def make_notches(traction_shares: tuple[float, ...], brake_shares: tuple[float, ...]) -> Notches:
    """The notches with these shares of traction and of the electric brake, and the three that have no share."""
    kinds = [NotchRegime.TRACTION] * len(traction_shares) + [NotchRegime.HOLD, NotchRegime.COAST]
    kinds += [NotchRegime.BRAKE] * len(brake_shares) + [NotchRegime.CURVE]
    shares = (*traction_shares, 0.0, 0.0, *brake_shares, 0.0)
    return Notches(np.array([int(kind) for kind in kinds], dtype=np.int64), np.array(shares))
