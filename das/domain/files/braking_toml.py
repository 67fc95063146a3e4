"""Reading how the drivers of a site brake, from a table of a scenario or of a plan of tables."""

from __future__ import annotations

from das.domain.braking import REACTION_S, SiteBraking
from das.domain.files.reading import Fields
from das.domain.units import KMH

_KEYS = {"planning_brake": "acceleration", "reaction": "time", "below_limit": "speed"}


def site_braking(fields: Fields) -> SiteBraking:
    """How the drivers of a site brake, as far as the table says it.

    Raises InputError for an unknown key, and for a figure outside what is plausible for a driver.
    """
    fields.check_keys(fields.quantity_keys(_KEYS))
    brake_mps2 = fields.within("planning_brake", "acceleration", 0.5, (0.1, 1.5))
    says_brake = any(fields.has(key) for key in fields.quantity_keys({"planning_brake": "acceleration"}))
    return SiteBraking(
        deceleration_mps2=brake_mps2 if says_brake else None,
        reaction_s=fields.within("reaction", "time", REACTION_S, (0.0, 10.0)),
        below_limit_mps=fields.within("below_limit", "speed", 0.0, (0.0, 20.0 * KMH)),
    )
