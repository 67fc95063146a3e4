"""The changes that a what-if makes to a recorded run."""

from __future__ import annotations

import json
import re
from dataclasses import astuple, dataclass, field
from typing import Annotated, Final

import typer

from das.command_line.options import LoadOption
from das.domain.errors import DasError
from das.domain.levels import Level
from das.domain.restriction import Restriction
from das.domain.units import KM, KMH
from sim.drivers.kinds import FrictionPolicy, Presentation
from sim.options import ParticipantOption, PopulationOption

KEPT: Final = "what_if_kept"
"""The metadata key of a what-if for the differences of its run from the recorded one."""
SLOWEST_KMH, FASTEST_KMH = 5.0, 700.0
"""Range of the limits that the user may add."""
_RESTRICTION: Final = re.compile(r"(\d+(?:\.\d+)?)-(\d+(?:\.\d+)?):(\d+(?:\.\d+)?)")


@dataclass(frozen=True, kw_only=True)
class CabOtherwise:
    """The changes of the cab that makes the advice; None means as recorded."""

    level: Annotated[
        Level | None,
        typer.Option("--level", help="Loss level used to plan the advice.", show_default=False),
    ] = None
    vehicle: Annotated[
        str | None,
        typer.Option(
            "--vehicle", metavar="VEHICLE", help="Another train: bundled, TOML file or TTOBench train (JSON)."
        ),
    ] = None
    load: LoadOption = None


@dataclass(frozen=True, kw_only=True)
class DrivenOtherwise:
    """The driver and the display of a newly simulated run; None means as recorded."""

    driver: Annotated[
        str | None,
        typer.Option(
            "--driver", metavar="DRIVER", show_default=False,
            help="The driver of the new run: perfect, literal, fast, top-speed, timetable, human, or your own class.",
        ),
    ] = None  # fmt: skip
    advice: Annotated[
        Presentation | None,
        typer.Option(
            "--advice", show_default=False,
            help="Presentation of the new run; with --open-loop, guide or speed-and-effort: advice with "
            "or without the guide.",
        ),
    ] = None  # fmt: skip
    friction: Annotated[
        FrictionPolicy | None,
        typer.Option("--friction", help="Brake used by a human driver if the motors could brake.", show_default=False),
    ] = None
    participant: ParticipantOption = None
    population: PopulationOption = None

    @property
    def asks_for_a_driver(self) -> bool:
        """Whether any option is given that only a newly simulated run can have."""
        return any(value is not None for value in (self.driver, self.advice, self.friction, self.participant))


@dataclass(frozen=True, kw_only=True)
class Otherwise:
    """All changes of a what-if. `without_restrictions` leaves out the recorded restrictions."""

    cab: CabOtherwise = field(default_factory=CabOtherwise)
    driven: DrivenOtherwise = field(default_factory=DrivenOtherwise)
    restrictions: tuple[Restriction, ...] = ()
    without_restrictions: bool = False

    def described(self) -> list[str]:
        """Each change in words; empty if there is none."""
        named = {("loss level" if name == "level" else name): value for name, value in vars(self.cab).items()}
        said = [f"{name} {value}" for name, value in (named | vars(self.driven)).items() if value is not None]
        said += ["without the recorded restrictions"] if self.without_restrictions else []
        return [*said, *(f"restriction to {one.words}" for one in self.restrictions)]

    def kept(self) -> str:
        """The changes to the run itself, as JSON, for a comparison of both runs."""
        restrictions, without = [astuple(one) for one in self.restrictions], self.without_restrictions
        return json.dumps({"load": self.cab.load, "restrictions": restrictions, "without_restrictions": without})


def read_restriction(text: str) -> Restriction:
    """The restriction that a text names: "12.5-14:80" (km, km/h); raises DasError for any other text."""
    found = _RESTRICTION.fullmatch(text.strip())
    if found is None:
        raise DasError(f"--restriction {text}: expected km-km:km/h, for example 12.5-14:80")
    start_km, end_km, limit_kmh = map(float, found.groups())
    if not start_km < end_km:
        raise DasError(f"--restriction {text}: expected an end beyond the start")
    if not SLOWEST_KMH <= limit_kmh <= FASTEST_KMH:
        raise DasError(f"--restriction {text}: expected a limit of {SLOWEST_KMH:g} to {FASTEST_KMH:g} km/h")
    return Restriction(start_km * KM, end_km * KM, limit_kmh * KMH)
