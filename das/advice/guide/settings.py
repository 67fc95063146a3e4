"""What can be set of the guide."""

from __future__ import annotations

from dataclasses import dataclass, field

from das.solver.guide.policies import PolicySettings


@dataclass(frozen=True, kw_only=True)
class GuideSettings:
    """The settings of the guide."""

    enabled: bool = False
    """Whether there is a guide; if not, nothing is computed for it."""
    policies: PolicySettings = field(default_factory=PolicySettings)
    late_s: float = 3.0
    """The reference (the standing plan) is kept while the train arrives late by no more than this."""
    early_s: float = 5.0
    """The reference is kept while the train arrives early by no more than this."""


DEFAULT = GuideSettings()
