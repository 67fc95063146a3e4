"""Options of das-sim that packages on which `sim.cli` depends use as data; `sim.cli.options` has the others.

Options that belong together are grouped in dataclasses. This module imports no large modules, because it is imported
whenever das-sim prints a help text.
"""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from das.command_line.files import check_outputs
from das.command_line.options import (
    DEFAULT_TRAIN,
    BusFolderOption,
    DirectionOption,
    FromOption,
    InsecureBusOption,
    LevelOption,
    LossMapOption,
    RecordedRouteOption,
    RecordedVehicleOption,
    TablesOption,
    ToOption,
    TrainOption,
)
from das.command_line.printing import busy
from das.domain.errors import DasError
from das.domain.files.writing import write_whole

MOST_NOTCHES = 20
"""Largest number of steps of the desk's lever in each direction."""
LEAST_DRIVERS = 40
"""Fewest simulated drivers from whom a fit takes how a statistic depends on the parameters."""
DRAWN_DRIVERS = (3, 10_000)
"""Fewest drivers of a worth study, whose mean has an interval, and most."""
LATE_KERNELS = "sim.world.late_kernels"
"""Module run in parallel with a command that compiles: it compiles the kernels needed last in a simulated run."""
PostsOption = Annotated[
    Path | None,
    typer.Option(
        "--posts",
        metavar="CSV",
        help="Kilometre posts with latitude and longitude, to which GPS points are matched [default: the route's map].",
    ),
]
VehiclesOption = Annotated[
    str | None,
    typer.Option(
        "--vehicles",
        metavar="A,B,…|all",
        help="Find the train that drove the trip, among these: bundled names, files, folders of files, or all "
        "(every bundled train).",
    ),
]
OfTrainOption = Annotated[
    str | None,
    typer.Option("--of-train", metavar="NAME", help="Train to use, if the recording contains several."),
]
PaceOption = Annotated[
    str,
    typer.Option(
        "--pace", metavar="TIMES", help="Pace as a multiple of real time; real means 1, max means without waiting."
    ),
]
ParticipantOption = Annotated[
    int | None,
    typer.Option(
        "--participant",
        metavar="N",
        min=0,
        help="Human driver number N of the population, the same person in every run "
        "[default: the seed draws the driver].",
    ),
]
PopulationOption = Annotated[
    str | None,
    typer.Option(
        "--population",
        metavar="FILE",
        help="TOML file of the population that participants are drawn from [default: the bundled population].",
    ),
]


@dataclass(frozen=True, kw_only=True)
class NodeSaid:
    """Options about the node of a recording: the options with which the node was started, and the folder of tables."""

    node: Annotated[
        str | None,
        typer.Option(
            "--node", metavar="OPTIONS",
            help="Options with which das-node was started, in quotes [default: those in the recording].",
        ),
    ] = None  # fmt: skip
    tables: TablesOption = None


SLOWEST, FASTEST = 0.01, 1e6
"""Range of `--pace`, as multiples of real time."""


def pace_factor(text: str) -> float | None:
    """A multiple of real time (`real` is 1); None for as fast as possible. Raises DasError for any other text."""
    if text == "max":
        return None
    try:
        value = 1.0 if text == "real" else float(text)
    except ValueError:
        value = float("nan")
    if not SLOWEST <= value <= FASTEST:
        raise DasError(f"--pace {text}: expected max, real or a multiple of real time, 0.01 to 1000000")
    return value


@dataclass(frozen=True, kw_only=True)
class TripOptions:
    """The options of a trip apart from its file; None means the recorded value or, without one, the default.

    If `reverse` is None, the direction of the trip is not given. Without stops, the trip runs from the first stop to
    the last stop of the route. `posts` is a file of kilometre posts.
    """

    route: RecordedRouteOption = None
    vehicle: RecordedVehicleOption = None
    reverse: DirectionOption = None
    posts: PostsOption = None
    from_stop: FromOption = None
    to_stop: ToOption = None
    level: LevelOption = None
    loss_map: LossMapOption = None
    of_train: OfTrainOption = None

    @property
    def direction_said(self) -> bool:
        """Whether the user gave the direction of travel, by `reverse` or by both stops."""
        return self.reverse is not None or None not in (self.from_stop, self.to_stop)


@dataclass(frozen=True, kw_only=True)
class ReplayOptions:
    """The options of a replay; None means the recorded value or, without one, the default.

    The timetable comes from a journey, or from the running time and the delay of the departure; a delay without
    a running time is rejected if the recording has no time of arrival.
    """

    trip: TripOptions = field(default_factory=TripOptions)
    journey: Annotated[
        str | None,
        typer.Option(
            "--journey",
            metavar="FILE",
            help="Timetable of the trip: a bundled journey, a journey file (times of the line's zone), or an answer "
            "of the train's Wi-Fi portal with its stops.",
        ),
    ] = None
    running_time_s: Annotated[
        float | None,
        typer.Option(
            "--running-time", metavar="S", help="Timetable's running time in s [default: as recorded, or no timetable]."
        ),
    ] = None
    delay_s: Annotated[
        float | None,
        typer.Option(
            "--delay",
            metavar="S",
            help="Delay of the departure in s, if a time of arrival is known [default: as recorded, or 0].",
        ),
    ] = None
    pace: PaceOption = "max"
    train: TrainOption = DEFAULT_TRAIN
    bus: BusFolderOption = None
    insecure_bus: InsecureBusOption = False


class WhatIfKind(StrEnum):
    """The kinds of what-ifs."""

    OPEN_LOOP = "open loop"
    """The drive stays as it was recorded; only the advice is different."""
    DRIVEN_ANEW = "driven anew"
    """A simulated driver drives again, with the recorded disturbances."""


def typed_command() -> str:
    """The command line as the user typed it."""
    return shlex.join(["das-sim", *sys.argv[1:]])


@dataclass(frozen=True, kw_only=True)
class PageFiles:
    """Options for the page that a command writes; `out` may end in .pdf for the PDF alone, unless `pdf` is given.

    None stands for a file that was not requested.
    """

    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="Page to write (.html, or .pdf) [default: print as text]."),
    ] = None
    pdf: Annotated[Path | None, typer.Option("--pdf", metavar="FILE", help="The page as PDF; needs Chromium.")] = None

    @property
    def paths(self) -> tuple[Path | None, Path | None]:
        """The paths of the page and its PDF."""
        pdf_alone = self.out is not None and self.pdf is None and self.out.suffix.lower() == ".pdf"
        return (None, self.out) if pdf_alone else (self.out, self.pdf)

    def check(self, inputs: Iterable[Path], *others: Path | None, overwrite: bool) -> None:
        """Raise DasError if the page, its PDF or other files cannot be written; called before the work begins."""
        out, pdf = self.paths
        for path, suffixes in ((out, (".html", ".htm")), (pdf, (".pdf",))):
            if path is not None and path.suffix.lower() not in suffixes:
                raise DasError(f"{path}: expected a file name that ends in {' or '.join(suffixes)}")
        check_outputs(out, pdf, *others, inputs=inputs, overwrite=overwrite)
        if pdf is not None:
            from precompute.pdf import browser

            browser()

    def write(self, draw: Callable[[], str]) -> None:
        """Draw the page and write it as HTML, as PDF or as both; without a request for either, nothing is drawn."""
        out, pdf = self.paths
        if out is None and pdf is None:
            return
        with busy("drawing the page …"):
            content = draw()
        if out is not None:
            write_whole(out, content.encode())
        if pdf is not None:
            from precompute.pdf import write_pdf

            with busy(f"printing {pdf} …"):
                write_pdf(content, pdf)
