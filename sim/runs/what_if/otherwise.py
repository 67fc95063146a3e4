"""The changes that a what-if makes to a recorded day."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import asdict, astuple, dataclass, field, replace
from typing import Annotated, Any, Final

import typer

from das.command_line.options import LoadOption
from das.domain.errors import DasError, InputError
from das.domain.levels import Level
from das.domain.restriction import Restriction
from das.domain.units import KM, KMH
from sim.drivers.kinds import FrictionPolicy, Presentation
from sim.options import ParticipantOption, PopulationOption

KEPT: Final = "what_if_kept"
"""The key of a what-if's metadata that holds its changes, so that another what-if can start from it."""
KEPT_OF_CAB: Final = frozenset({"load", "planning_brake", "below_limit"})
"""The changes of the cab that a what-if keeps in its metadata; its train and the losses are in the attached files."""
SLOWEST_KMH, FASTEST_KMH = 5.0, 700.0
"""Range of the limits that can be asked for."""
MINUTE_NS: Final = 60 * 10**9
DAY_NS: Final = 24 * 60 * MINUTE_NS
_RESTRICTION: Final = re.compile(r"(\d+(?:\.\d+)?)-(\d+(?:\.\d+)?):(\d+(?:\.\d+)?)(?:@(\d\d):(\d\d)-(\d\d):(\d\d))?")


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
    planning_brake: Annotated[
        float | None,
        typer.Option(
            "--planning-brake", metavar="M/S2", min=0.1, max=1.5,
            help="Deceleration that plans assume for limits and stops.", show_default=False,
        ),
    ] = None  # fmt: skip
    below_limit: Annotated[
        float | None,
        typer.Option(
            "--below-limit", metavar="KM/H", min=0.0, max=20.0, help="Margin of plans below every limit.",
            show_default=False,
        ),
    ] = None  # fmt: skip

    def over(self, earlier: CabOtherwise) -> CabOtherwise:
        """These changes, and the earlier ones that they do not override; another train comes with its own load."""
        return CabOtherwise(
            level=earlier.level if self.level is None else self.level,
            vehicle=earlier.vehicle if self.vehicle is None else self.vehicle,
            load=earlier.load if self.vehicle is None and self.load is None else self.load,
            planning_brake=earlier.planning_brake if self.planning_brake is None else self.planning_brake,
            below_limit=earlier.below_limit if self.below_limit is None else self.below_limit,
        )


@dataclass(frozen=True, kw_only=True)
class DrivenOtherwise:
    """The driver and the display of a day driven anew; None means as recorded."""

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
        """Whether anything is asked for that only a day driven anew can have."""
        return any(value is not None for value in (self.driver, self.advice, self.friction, self.participant))


@dataclass(frozen=True, kw_only=True)
class Otherwise:
    """All changes of a what-if. `without_restrictions` leaves out the recorded restrictions."""

    cab: CabOtherwise = field(default_factory=CabOtherwise)
    driven: DrivenOtherwise = field(default_factory=DrivenOtherwise)
    restrictions: tuple[Restriction, ...] = ()
    without_restrictions: bool = False

    def over(self, earlier: Otherwise) -> Otherwise:
        """These changes, and the earlier ones of a day that is a what-if itself."""
        return Otherwise(
            cab=self.cab.over(earlier.cab),
            driven=self.driven,
            restrictions=(*(() if self.without_restrictions else earlier.restrictions), *self.restrictions),
            without_restrictions=self.without_restrictions or earlier.without_restrictions,
        )

    def described(self) -> list[str]:
        """Each change in words; empty if there is none."""
        cab, driven = self.cab, self.driven
        named = {
            "loss level": cab.level,
            "vehicle": cab.vehicle,
            "load": cab.load,
            "planning brake": None if cab.planning_brake is None else f"{cab.planning_brake:g} m/s²",
            "margin to limits": None if cab.below_limit is None else f"{cab.below_limit:g} km/h",
            "driver": driven.driver,
            "advice": driven.advice,
            "friction": driven.friction,
            "participant": driven.participant,
            "population": driven.population,
        }
        said = [f"{name} {value}" for name, value in named.items() if value is not None]
        said += ["without the recorded restrictions"] if self.without_restrictions else []
        return [*said, *(f"restriction to {one.words}" for one in self.restrictions)]

    def kept(self) -> str:
        """The changes that a what-if based on this one must repeat, as JSON; the train is attached to the recording."""
        cab = {name: value for name, value in asdict(self.cab).items() if name in KEPT_OF_CAB}
        restrictions = [astuple(one) for one in self.restrictions]
        return json.dumps({**cab, "restrictions": restrictions, "without_restrictions": self.without_restrictions})

    @classmethod
    def of(cls, run: Mapping[str, str]) -> Otherwise:
        """The changes that a recorded day already has, by its metadata; DasError if these cannot be read."""
        if KEPT not in run:
            return cls()
        try:
            kept: dict[str, Any] = json.loads(run[KEPT])
            restrictions = tuple(Restriction(*one) for one in kept.pop("restrictions"))
            without = bool(kept.pop("without_restrictions"))
            if not kept.keys() <= KEPT_OF_CAB:
                raise ValueError(f"expected no more than {', '.join(sorted(KEPT_OF_CAB))}")
            return cls(cab=CabOtherwise(**kept), restrictions=restrictions, without_restrictions=without)
        except (ValueError, TypeError, KeyError, AttributeError, InputError) as error:
            raise DasError(f"metadata run.{KEPT}: cannot be read ({error})") from None


def read_restriction(text: str, departure_ns: int = 0) -> Restriction:
    """The restriction that a text names: "12.5-14:80" (km, km/h), or "12.5-14:80@08:10-08:25" with a window of UTC.

    The window is on the day of the departure (ns since 1970), or a day later if it would be over by then. Raises
    DasError for any other text.
    """
    found = _RESTRICTION.fullmatch(text.strip())
    if found is None:
        raise DasError(f"--restriction {text}: expected km-km:km/h, for example 12.5-14:80 or 12.5-14:80@08:10-08:25")
    start_km, end_km, limit_kmh = map(float, found.groups()[:3])
    if not start_km < end_km:
        raise DasError(f"--restriction {text}: expected an end beyond the start")
    if not SLOWEST_KMH <= limit_kmh <= FASTEST_KMH:
        raise DasError(f"--restriction {text}: expected a limit of {SLOWEST_KMH:g} to {FASTEST_KMH:g} km/h")
    one = Restriction(start_km * KM, end_km * KM, limit_kmh * KMH)
    if found.group(4) is None:
        return one
    from_hour, from_min, until_hour, until_min = map(int, found.groups()[3:])
    if max(from_hour, until_hour) > 23 or max(from_min, until_min) > 59:
        raise DasError(f"--restriction {text}: expected clock times from 00:00 to 23:59")
    midnight_ns = departure_ns - departure_ns % DAY_NS
    from_ns, until_ns = (
        midnight_ns + (60 * h + m) * MINUTE_NS for h, m in ((from_hour, from_min), (until_hour, until_min))
    )
    if until_ns <= from_ns:
        until_ns += DAY_NS  # Over midnight.
    if until_ns <= departure_ns:
        from_ns, until_ns = from_ns + DAY_NS, until_ns + DAY_NS
    return replace(one, valid_from_ns=from_ns, valid_until_ns=until_ns)
