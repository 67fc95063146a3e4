"""What can be set of the advice on one section."""

from __future__ import annotations

from dataclasses import dataclass, field

from das.solver.guide.policies import PolicySettings


@dataclass(frozen=True, kw_only=True)
class GuideSettings:
    """The settings of the guide."""

    enabled: bool = False
    """Whether there is a guide; if not, nothing is computed for it."""
    policies: PolicySettings = field(default_factory=PolicySettings)


@dataclass(frozen=True, kw_only=True)
class AdviceSettings:
    """The settings of the advice on a section."""

    valid_for_s: float = 3.0
    """Time (s) for which advice is valid."""
    guide: GuideSettings = field(default_factory=GuideSettings)


DEFAULT = AdviceSettings()
