"""How one trial is driven: what the factors of a design vary and what it keeps the same."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

from das.domain.levels import Level
from sim.drivers.kinds import DriverKind, FrictionPolicy, OwnClass, Presentation
from sim.drivers.screen import ScreenSettings
from sim.world.scenario import Scenario, load_scenario


def study_days() -> dict[str, Path]:
    """The scenario files that come with the bundled studies, by name."""
    folder = Path(str(files("sim.experiment") / "studies" / "days"))
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def day_of(name_or_path: str) -> Scenario:
    """Read a bundled scenario, a day of the bundled studies or a TOML file; raises DasError for anything unusable."""
    return load_scenario(str(study_days().get(name_or_path, name_or_path)))


@dataclass(frozen=True, kw_only=True)
class Setting:
    """How a trial is driven.

    `loss_level` is the level of losses that the advice is planned with (None: that of the train); the losses of the
    true train do not change with it. `scenario` and `train` are names of bundled files or paths; without a train, it is
    the scenario's. Times are in s; `preview_s` is infinite where everything that comes is shown.
    """

    scenario: str = "clear-day"
    train: str | None = None
    driver: DriverKind | OwnClass = DriverKind.HUMAN
    presentation: Presentation = Presentation.VECTOR
    loss_level: Level | None = None
    friction: FrictionPolicy = FrictionPolicy.AS_MEASURED
    update_interval_s: float = 0.0
    hold_s: float = 0.0
    preview_s: float = math.inf
    reason: bool = True

    @property
    def screen(self) -> ScreenSettings:
        """How the display shows the advice."""
        return ScreenSettings(
            update_interval_s=self.update_interval_s,
            hold_s=self.hold_s,
            preview_s=self.preview_s,
            reason=self.reason,
        )

    def read_scenario(self) -> Scenario:
        """The scenario with the train of this setting; raises DasError for files that cannot be used."""
        scenario = day_of(self.scenario)
        return scenario if self.train is None else replace(scenario, vehicle=self.train, load=None)

    def figures(self) -> dict[str, Any]:
        """Every field as JSON takes it; an infinite preview is None."""
        found = {name: getattr(self, name) for name in self.__dataclass_fields__}
        found |= {name: str(found[name]) for name in ("driver", "presentation", "friction")}
        found["loss_level"] = None if self.loss_level is None else str(self.loss_level)
        found["preview_s"] = None if math.isinf(self.preview_s) else self.preview_s
        return found
