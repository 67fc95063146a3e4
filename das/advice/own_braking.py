"""The section as the drivers of a site drive it, where the site says how they brake and which margins they keep."""

from __future__ import annotations

from das.advice.coach.planning import drivers_section
from das.advice.coach.settings import CoachSettings, DriverSettings
from das.solver.section import Section

AS_THE_TRAIN = DriverSettings()
"""The site says nothing of its drivers: what is planned brakes as the train can."""


def says_how(driver: DriverSettings) -> bool:
    """Whether a site says how its drivers brake, or which margin they keep to limits."""
    return driver.planning_brake_mps2 is not None or driver.below_limit_mps > 0


def as_driven(section: Section, driver: DriverSettings) -> Section:
    """The section with the drivers' braking and margins; the section itself where the site says nothing of them."""
    return drivers_section(section, CoachSettings(driver=driver)) if says_how(driver) else section
