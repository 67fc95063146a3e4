"""The random draw of a run of the assessment: line, train, driver, messages, and all disturbances."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np

from sim.drivers.kinds import Presentation
from tests.support.making import REPOSITORY
from tests.support.raw_witness import Place

CATALOGUE = REPOSITORY / "das" / "domain" / "catalogue"
LINES = 6
"""Number of lines with trains; the fronts of each line without restrictions are solved once."""
LEGS = ((0, 1), (1, 2), (2, 3), (0, 1), (1, 2), (2, 3), (0, 2), (1, 3))
LONG_LEGS = ((0, 2), (1, 3))
"""Pairs of the line's stops, by number: the first and the last stop of a day."""
LONGEST_DELAY_S = 2.0
NOTICED_S = 2.5
"""Duration (s) up to which the cab must not trust wrong positions."""


class Operators(StrEnum):
    """The events of the operators in a run."""

    ONE = "one"
    LOST = "lost"
    RIVAL_SAME = "rival-same"
    RIVAL_OTHER = "rival-other"
    RIVAL_UNSTAMPED = "rival-unstamped"
    TAKEN_OVER = "taken-over"
    NODE_RESTARTED = "node-restarted"
    NODE_RESTARTED_ALONE = "node-restarted-alone"


class Style(StrEnum):
    """The way in which a driver follows the display."""

    FORCE = "force"
    """Exactly the wheel force of the message."""
    EFFORT = "effort"
    """The mode and effort shown until the speed is reached, then holding the speed."""
    SPEED = "speed"
    """The shown speed, held with full effort."""
    CARELESS = "careless"
    """Rare looks, late actions and weak braking, but limits and stops observed by the driver."""


class Upset(StrEnum):
    """The faults of the sensors in a disturbed run."""

    NONE = "none"
    JUMP = "jump"
    """The measured position is wrong by tens to hundreds of metres for some seconds."""
    WRONG_SPEED = "wrong-speed"
    """The measured speed is wrong by a constant share for some seconds."""
    SILENT = "silent"
    """No position arrives for some seconds."""
    FROZEN = "frozen"
    """The position stays where it was for some seconds."""


class Change(StrEnum):
    """The change of the journey during the run."""

    NONE = "none"
    DROPPED_STOP = "dropped-stop"
    ADDED_STOP = "added-stop"
    OTHER_TIMES = "other-times"


STYLES: dict[Presentation, tuple[Style, ...]] = {
    Presentation.GUIDE: (Style.FORCE, Style.EFFORT, Style.SPEED, Style.CARELESS),
    Presentation.SPEED_AND_EFFORT: (Style.FORCE, Style.EFFORT, Style.SPEED, Style.CARELESS),
    Presentation.TOP_SPEED: (Style.SPEED, Style.CARELESS),
    Presentation.FOUR_MODE: (Style.EFFORT, Style.CARELESS),
}
"""The styles of driving for which each presentation shows enough."""
SHARES = {
    Presentation.GUIDE: 0.5,
    Presentation.SPEED_AND_EFFORT: 0.26,
    Presentation.TOP_SPEED: 0.12,
    Presentation.FOUR_MODE: 0.12,
}


@dataclass(frozen=True, kw_only=True)
class Told:
    """A list of restrictions sent at a time (s): those at fixed places, and perhaps one near the train.

    `ahead` describes the one near the train: distance from the head (m; < 0: it begins behind the head), length (m) and
    limit (m/s).
    """

    at_s: float
    places: tuple[Place, ...] = ()
    ahead: tuple[float, float, float] | None = None

    def resolved(self, head_m: float) -> tuple[Place, ...]:
        """The restrictions of the list for a train with its head at a position."""
        if self.ahead is None:
            return self.places
        way_m, length_m, limit_mps = self.ahead
        return (*self.places, (head_m + way_m, head_m + way_m + length_m, limit_mps))


@dataclass(frozen=True, kw_only=True)
class Sensors:
    """The faults of the sensors and the clocks in a run."""

    gain: float = 1.0
    """Factor of the force sensor on the true force."""
    clock_off_s: float = 0.0
    force_clock_off_s: float = 0.0
    upset: Upset = Upset.NONE
    upset_s: tuple[float, float] = (0.0, 0.0)
    """The beginning and end of the disturbance (s)."""
    upset_by: float = 0.0
    """The size of the disturbance: metres of a jump, or the share of the speed."""
    clock_step: tuple[float, float] = (0.0, 0.0)
    """Time (s) at which the cab's clock is set, and the step (s)."""
    late_ratio: float = 0.0
    """Share of the positions that arrive one second late; the same share arrives twice."""

    @property
    def lies(self) -> bool:
        """Whether a sensor is wrong for so long that the cab cannot notice."""
        from_s, to_s = self.upset_s
        return self.upset is Upset.WRONG_SPEED or (self.upset is Upset.JUMP and to_s - from_s > NOTICED_S)

    @property
    def clean(self) -> bool:
        """Whether positions and clocks have no faults (late or repeated messages are normal on a bus)."""
        return self.upset is Upset.NONE and self.clock_off_s == 0.0 and self.clock_step[1] == 0.0


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """All random values of a run."""

    seed: int
    presentation: Presentation
    style: Style
    delay_s: float
    operators: Operators
    sensors: Sensors
    lists: tuple[Told, ...]
    """The lists of restrictions, each in force from the time it is sent until the next one."""
    rival: tuple[Place, ...]
    happens_s: float
    change: Change
    changes_s: float
    change_by: float
    """Place or amount of the change of the journey: a number between 0 and 1."""
    stops: tuple[int, int]
    """The numbers of the first and the last stop of the run; most runs have only one leg."""
    buffer_ratio: float
    blended: bool

    @property
    def clean(self) -> bool:
        """Whether the last word must have nothing to replace in the run."""
        return self.sensors.clean

    @property
    def steady(self) -> bool:
        """Whether advice is due in nearly every second: the run is clean, and there is only one operator."""
        return self.clean and self.operators in (Operators.ONE, Operators.NODE_RESTARTED)

    @property
    def said(self) -> str:
        """The run as a short text."""
        sensors = self.sensors
        parts = [
            f"day {self.seed}: {self.presentation} {self.style} (delay {self.delay_s:.1f} s)",
            "blended" if self.blended else "electric",
            "clean" if self.clean else "disturbed",
            f"{len(self.lists)} lists",
        ]
        if self.operators is not Operators.ONE:
            parts.append(f"operators {self.operators} at {self.happens_s:.0f} s")
        if self.change is not Change.NONE:
            parts.append(f"{self.change} at {self.changes_s:.0f} s")
        if sensors.upset is not Upset.NONE:
            parts.append(f"{sensors.upset} {sensors.upset_by:+.2f} at {sensors.upset_s[0]:.0f} s")
        if not sensors.clean:
            parts.append(f"clocks {sensors.clock_off_s:+.1f} s, step {sensors.clock_step[1]:+.1f} s")
        return ", ".join([*parts, f"force gain {sensors.gain:.2f}"])


def draw(seed: int) -> Drawn:
    """Draw a run.

    Every part of the run has its own stream of random numbers; an added part does not change existing runs.
    """

    def stream(part: int) -> np.random.Generator:
        return np.random.default_rng([18, seed, part])

    whom, when, where = stream(0), stream(1), stream(2)
    presentation = Presentation(str(whom.choice(list(SHARES), p=list(SHARES.values()))))
    styles, share = STYLES[presentation], float(whom.random())
    change = list(Change)[1 + int(when.integers(0, len(Change) - 1))] if when.random() < 0.3 else Change.NONE
    operators = list(Operators)[int(when.integers(0, len(Operators)))] if when.random() < 0.3 else Operators.ONE
    legs = LEGS if change is not Change.DROPPED_STOP else LONG_LEGS
    return Drawn(
        seed=seed,
        presentation=presentation,
        style=styles[int(share * len(styles))],
        delay_s=round(float(whom.choice([0.0, whom.uniform(0.0, LONGEST_DELAY_S)], p=[0.3, 0.7])), 1),
        operators=operators,
        sensors=_sensors(stream(3)),
        lists=_lists(stream(4)),
        rival=_places(stream(5), 2),
        happens_s=float(when.uniform(5.0, 150.0)),
        change=change,
        changes_s=float(when.uniform(-5.0, 120.0)),
        change_by=float(when.random()),
        stops=legs[int(where.integers(0, len(legs)))],
        buffer_ratio=float(where.uniform(0.0, 0.3)),
        blended=bool(where.random() < 0.4),
    )


def _places(random: np.random.Generator, most: int) -> tuple[Place, ...]:
    """Random restrictions of any length; they may overlap, lie at stops or lie outside the line."""
    made = []
    for _ in range(int(random.integers(0, most + 1))):
        start_m = float(random.uniform(-300.0, 7000.0))
        made.append((start_m, start_m + float(random.uniform(20.0, 2000.0)), float(random.uniform(4.0, 40.0))))
    return tuple(made)


def _lists(random: np.random.Generator) -> tuple[Told, ...]:
    """The first list and those that replace it: with one near the train added, with one dropped, or all new."""
    lists = [Told(at_s=-10.0, places=_places(random, 2))]
    for at_s in sorted(random.uniform(0.0, 150.0, int(random.choice([0, 1, 2], p=[0.4, 0.4, 0.2]))).tolist()):
        kind, kept = random.random(), lists[-1].places
        if kind < 0.5:  # Near the train: often too near to brake for, or behind its head.
            way_m = float(random.uniform(-150.0, 1200.0))
            ahead = way_m, float(random.uniform(20.0, 800.0)), float(random.uniform(3.0, 30.0))
            lists.append(Told(at_s=at_s, places=kept, ahead=ahead))
        elif kind < 0.75:
            lists.append(Told(at_s=at_s, places=kept[1:]))
        else:
            lists.append(Told(at_s=at_s, places=_places(random, 3)))
    return tuple(lists)


def _sensors(random: np.random.Generator) -> Sensors:
    """The faults of sensors and clocks in a run; six runs of ten have none."""
    gain = float(random.choice([1.0, random.uniform(0.5, 1.5)], p=[0.4, 0.6]))
    kind, from_s, for_s = float(random.random()), float(random.uniform(10.0, 120.0)), float(random.uniform(1.0, 15.0))
    jump, ratio = float(random.uniform(-300.0, 300.0)), float(random.uniform(-0.3, 0.3))
    off_s, step_s = float(random.uniform(-5.0, 5.0)), float(random.choice([-1.0, 1.0]) * random.uniform(0.5, 3.0))
    late = float(random.choice([0.0, 0.05]))
    if kind < 0.6:
        return Sensors(gain=gain, late_ratio=late)
    if kind < 0.7:
        same = bool(random.random() < 0.7)
        return Sensors(gain=gain, clock_off_s=off_s, force_clock_off_s=off_s if same else 0.0)
    if kind < 0.8:
        return Sensors(gain=gain, clock_step=(from_s, step_s), late_ratio=late)
    upset = list(Upset)[1 + int(random.integers(0, len(Upset) - 1))]
    by = ratio if upset is Upset.WRONG_SPEED else jump
    if upset is Upset.JUMP and late:  # Half of the jumps are short enough for the cab to detect.
        for_s = min(for_s, NOTICED_S)
    return Sensors(gain=gain, upset=upset, upset_s=(from_s, from_s + for_s), upset_by=by)


def write_files(folder: Path, number: int, *, blended: bool) -> tuple[Path, Path]:
    """Write the files of route and vehicle with this number: a short hilly line with limits, and a train for it.

    Every fourth train has an effort curve that changes by a fifth within 1 km/h, as when a diesel train shifts.
    """
    random = np.random.default_rng([19, number])
    length_km = round(float(random.uniform(5.0, 8.0)), 3)
    inner_km = [round(float(random.uniform(*part)) * length_km, 3) for part in ((0.25, 0.4), (0.5, 0.7))]
    at_km, limits = 0.0, []
    while at_km < length_km:
        limits.append([round(at_km, 3), float(random.choice([50, 60, 80, 90, 100, 120, 140]))])
        at_km += float(random.uniform(0.5, 2.0))
    gradients = [[0.0, 0.0]]
    while gradients[-1][0] < length_km - 1.0:
        before = gradients[-1][0]
        gradients.append([round(before + float(random.uniform(0.3, 1.2)), 3), round(float(random.uniform(-20, 20)), 1)])
    route = folder / f"line-{number}.toml"
    route.write_text(
        f'schema_version = 1\n[route]\nid = "line-{number}"\nname = "Line {number}"\nlength_km = {length_km}\n'
        + "".join(
            f'[[stops]]\nname = "{name}"\nposition_km = {km}\n'
            for name, km in zip("ABCD", (0.0, *inner_km, length_km), strict=True)
        )
        + f'[speed_limits]\ncolumns = ["position_km", "limit_kmh"]\nrows = {limits}\n'
        + f'[gradients]\ncolumns = ["position_km", "gradient_permille"]\nrows = {gradients}\n'
    )
    text = (CATALOGUE / "vehicles" / "re460-ic.toml").read_text()
    # A train that blends its brakes can brake harder than planned, because friction brakes build up slowly.
    limited = "max_deceleration_mps2 = 0.6\n" if blended else ""
    changes = {
        "mass_t = 440.0": f"{limited}mass_t = {random.uniform(300, 560):.1f}",
        "length_m = 200.0": f"length_m = {random.uniform(60, 400):.0f}.0",
        'policy = "electric"': f'policy = "{"blended" if blended else "electric"}"',
    }
    if number % 4 == 3:
        most_kn = [min(300.0, 6100.0 * 3.6 / max(kmh, 1)) for kmh in range(201)]
        rows = [[kmh, round(n * (0.95 if kmh // 20 % 2 == 0 else 0.76), 2)] for kmh, n in enumerate(most_kn)]
        curve = f'[traction.curve]\ncolumns = ["speed_kmh", "force_kn"]\nrows = {rows}\n\n[electric_brake]'
        changes["max_force_kn = 300.0\nmax_power_kw = 6100.0\n\n[electric_brake]"] = curve
    for before_text, after in changes.items():
        assert before_text in text
        text = text.replace(before_text, after)
    vehicle = folder / f"train-{number}-{'blended' if blended else 'electric'}.toml"
    vehicle.write_text(text)
    return route, vehicle
