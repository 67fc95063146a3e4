"""The forces at the wheels, as the train itself measures them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Effort:
    """Measured wheel forces (N) of the motors and of the friction brake at a time (ns since 1970)."""

    time_ns: int
    force_el_n: float
    """The force of the motors: traction is > 0, the electric brake < 0."""
    force_friction_n: float
    """The force of the friction brake, <= 0."""
