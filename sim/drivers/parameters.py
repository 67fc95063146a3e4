"""What makes a human driver: every parameter with its unit, range and source, validated, and as a table."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from typing import Any

from das.domain.errors import InputError
from das.domain.units import KMH

ASSUMPTION = "assumption"
ROAD = "assumption, longer than the 0.75 to 1.5 s of road drivers' braking (Green 2000) because advice is not urgent"

REASON = (
    "assumption: a reason has no effect. Road drivers adhere more to justified advice (123 people, Thill et al. "
    "2018, Transp. Res. F 56, 420-435, no rate), while SBB dropped the reason eco because it changed nothing"
)


def _parameter(default: float, unit: str, low: float, high: float, meaning: str, source: str = ASSUMPTION) -> Any:
    """Make a field, with what a reader must know about it."""
    return field(
        default=default, metadata={"unit": unit, "low": low, "high": high, "meaning": meaning, "source": source}
    )


@dataclass(frozen=True, kw_only=True)
class HumanParameters:
    """The parameters of a human driver in SI; `parameter_table` gives meaning, range and source of each."""

    reaction_median_s: float = _parameter(
        2.0, "s", 0.2, 20.0, "reaction to new advice once seen, and to the order to depart: median of a lognormal", ROAD
    )
    reaction_log_sd: float = _parameter(0.4, "–", 0.0, 1.5, "standard deviation of the reaction's logarithm")
    expected_ratio: float = _parameter(
        0.6,
        "–",
        0.1,
        1.0,
        "the reaction to a change that the display announced, as a share of the one to another change",
        "braking for what is expected takes road drivers 0.7 to 0.75 s, for what is not 1.25 s (Green 2000)",
    )
    glance_mean_s: float = _parameter(
        5.0, "s", 0.2, 60.0, "mean time between glances at the display (exponential beyond the least)"
    )
    glance_least_s: float = _parameter(1.0, "s", 0.0, 10.0, "least time between glances")
    notches: int = _parameter(0, "notches", 0, 32, "notches of the controller each way; 0: a percent controller")
    notch_s: float = _parameter(0.7, "s", 0.0, 5.0, "time to move the controller by one notch")
    lever_rate_per_s: float = _parameter(0.4, "1/s", 0.01, 10.0, "speed of a percent controller (1 = full scale)")
    lever_least_ratio: float = _parameter(0.03, "–", 0.0, 0.5, "changes of a percent controller below this are left")
    speed_error_mps: float = _parameter(
        1.5 * KMH, "m/s", 0.0, 5.0, "the speed driven at wanders around the wanted one: standard deviation"
    )
    speed_error_s: float = _parameter(30.0, "s", 0.5, 600.0, "correlation time of that wandering")
    force_error_ratio: float = _parameter(
        0.08, "–", 0.0, 0.5, "an effort set is off by this share of itself: standard deviation"
    )
    force_error_s: float = _parameter(8.0, "s", 0.5, 600.0, "correlation time of that error")
    dead_band_mps: float = _parameter(2.0 * KMH, "m/s", 0.0, 5.0, "speed errors below this are not corrected")
    comply_traction_ratio: float = _parameter(0.95, "–", 0.0, 1.0, "share of advice to accelerate that is followed")
    comply_hold_ratio: float = _parameter(0.9, "–", 0.0, 1.0, "share of advice to hold a speed that is followed")
    comply_coast_ratio: float = _parameter(0.85, "–", 0.0, 1.0, "share of advice to coast that is followed")
    comply_brake_ratio: float = _parameter(0.85, "–", 0.0, 1.0, "share of advice to brake that is followed")
    reason_refusal_ratio: float = _parameter(
        1.0,
        "–",
        0.0,
        1.0,
        "of the advice that is refused without a reason, the share that is refused although its reason is shown",
        REASON,
    )
    lapses_per_h: float = _parameter(1.0, "1/h", 0.0, 60.0, "lapses of attention (Poisson process)")
    lapse_mean_s: float = _parameter(
        12.0, "s", 0.1, 120.0, "mean duration of a lapse (exponential), ended early by the speed warning"
    )
    braking_mps2: float = _parameter(0.5, "m/s²", 0.1, 1.5, "deceleration planned for limits and stops")
    early_braking_s: float = _parameter(2.0, "s", 0.0, 20.0, "begins to brake this much earlier than needed")
    below_limit_mps: float = _parameter(2.0 * KMH, "m/s", 0.0, 10.0, "keeps this much below limits")
    stop_error_m: float = _parameter(2.0, "m", 0.0, 8.0, "stands off the mark by this: standard deviation")
    friction_ratio: float = _parameter(
        0.4,
        "–",
        0.0,
        1.0,
        "share of the braking effort asked of the friction brake though the motors could give it "
        "(policy `as-measured`)",
        "so that friction takes about the 15.1 % of the energy measured by Nold & Corman (2024): "
        "docs/reference/drivers.md",
    )
    haste_ratio: float = _parameter(
        0.5, "–", 0.0, 1.0, "without advice: 0 = at the highest speed that keeps time, 1 = as fast as allowed"
    )
    learning_trips: float = _parameter(20.0, "trips", 0.1, 1000.0, "trips after which 1/e of the learning is left")
    learned_ratio: float = _parameter(
        0.6, "–", 0.0, 1.0, "what is left of reaction, errors, margins and refusals after long practice"
    )

    def __post_init__(self) -> None:
        for item in fields(self):
            value, low, high = getattr(self, item.name), item.metadata["low"], item.metadata["high"]
            counts = isinstance(item.default, int)
            if not low <= value <= high or (counts and value != int(value)):
                unit = "" if item.metadata["unit"] == "–" else f" {item.metadata['unit']}"
                expected = f"{'a whole number, ' if counts else ''}{low:g} to {high:g}{unit}"
                raise InputError("human driver", item.name, value, expected)
        if self.glance_mean_s < self.glance_least_s:
            raise InputError("human driver", "glance_mean_s", self.glance_mean_s, "at least glance_least_s")

    def after(self, trips: float) -> HumanParameters:
        """The same driver after so many trips with this train, line and display: x·(l + (1 − l)·exp(−n/n₀))."""
        if not trips >= 0:
            raise InputError("human driver", "trips", trips, "a number >= 0")
        left = self.learned_ratio + (1.0 - self.learned_ratio) * math.exp(-trips / self.learning_trips)
        practised = ("reaction_median_s", "speed_error_mps", "force_error_ratio", "early_braking_s", "stop_error_m")
        refused = [name for name in self.__dataclass_fields__ if name.startswith("comply_")]
        changed = {name: max(left * getattr(self, name), _low(name)) for name in practised}
        changed |= {name: 1.0 - left * (1.0 - getattr(self, name)) for name in refused}
        return replace(self, **changed)


def _low(name: str) -> float:
    return float(HumanParameters.__dataclass_fields__[name].metadata["low"])


def parameter_table() -> list[tuple[str, str, str, str, str, str]]:
    """Name, default, unit, range, meaning and source of each parameter, as text."""
    return [
        (
            item.name,
            f"{item.default:.4g}",
            item.metadata["unit"],
            f"{item.metadata['low']:g} … {item.metadata['high']:g}",
            item.metadata["meaning"],
            item.metadata["source"],
        )
        for item in fields(HumanParameters)
    ]


def parameter_markdown() -> str:
    """The table as docs/reference/drivers.md shows it."""
    head = ["| parameter | default | unit | range | meaning | source |", "|---|---:|---|---|---|---|"]
    return "\n".join(head + [f"| `{row[0]}` | {' | '.join(row[1:])} |" for row in parameter_table()])
