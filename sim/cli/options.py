"""Shared parts of das-sim's commands: options of this program alone, and functions that check and write results."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from das.command_line.printing import tell
from das.domain.errors import DasError, one_of
from das.domain.files.writing import make_folder, new_file
from sim.drivers.kinds import FrictionPolicy

if TYPE_CHECKING:
    from das.domain.route import Route

TripArgument = Annotated[
    Path,
    typer.Argument(
        metavar="TRIP",
        help="Recorded trip: CSV, GPX, answers of a train's Wi-Fi portal, or a recording (.mcap) of das-sim.",
    ),
]
RecordingArgument = Annotated[Path, typer.Argument(metavar="RECORDING", help="Recording (.mcap) to read.")]
FromTimeOption = Annotated[
    str | None,
    typer.Option(
        "--from",
        metavar="TIME",
        help="Only from this time on: 12:34 on the drive's clock, or 08:16:34Z.",
    ),
]
ToTimeOption = Annotated[str | None, typer.Option("--to", metavar="TIME", help="Only up to this time, same form.")]
WorkersOption = Annotated[
    int | None,
    typer.Option("--workers", metavar="N", help="Number of processes [default: one per core].", min=1, max=1024),
]
FrictionOption = Annotated[
    FrictionPolicy,
    typer.Option(
        "--friction",
        help="How a human driver brakes if the motors could brake: with a share of friction (as-measured), with the "
        "motors (electric-first), or as measured unless the driver follows advice on effort (by-advice).",
    ),
]


Kind = TypeVar("Kind", bound=StrEnum)


def chosen(kind: type[Kind], option: str, text: str) -> Kind:
    """The member of an enumeration with the value `text`; raises DasError if there is none."""
    if text not in list(kind):
        raise DasError(f"{option} {text}: expected {one_of(kind, text)}")
    return kind(text)


def new_recording(kind: str, otherwise: str = "say where with --out") -> Path:
    """Make a new file in ./recordings, named by `kind` and the time; an error message proposes `otherwise`."""
    folder = Path("recordings")
    try:
        make_folder(folder)
    except DasError as error:
        raise DasError(f"{error}; {otherwise}") from error
    return new_file(folder / f"{kind}-{datetime.now(UTC):%Y%m%d-%H%M%S}.mcap")


@contextmanager
def removed_if_unused(reserved: Path | None) -> Iterator[None]:
    """Remove a file made by `new_recording` if the block fails before anything has been recorded."""
    try:
        yield
    except BaseException:
        with suppress(OSError):
            if reserved is not None and reserved.stat().st_size == 0:
                reserved.unlink()
        raise


@contextmanager
def naming_recorded(file: Path | None) -> Iterator[None]:
    """Print the name of a recording if the block has written to it and is interrupted."""
    before = _written_ns(file)
    try:
        yield
    except KeyboardInterrupt:
        if _written_ns(file) not in (None, before):
            print(f"recorded so far: {file}", file=sys.stderr)
        raise


def _written_ns(path: Path | None) -> int | None:
    """The time (ns) at which a file was last written; None for an empty or missing one."""
    return path.stat().st_mtime_ns if path is not None and path.is_file() and path.stat().st_size > 0 else None


def check_packages(extra: str, *names: str) -> None:
    """Raise DasError if a package from an extra of the installation is missing."""
    for name in names:
        if importlib.util.find_spec(name) is None:
            raise DasError(f"{name} is not installed: pip install '.[{extra}]' in the checkout")


def tell_energy_range(route: Route) -> None:
    """Print the possible error of energies due to the altitudes of a line, if that error is known."""
    from das.domain.plausibility import energy_range

    if words := energy_range(route):
        tell(f"{words[0].upper()}{words[1:]}")


def tell_written(*paths: Path | None) -> None:
    """Print the files that were written; None stands for a file that was not requested."""
    for path in paths:
        if path is not None:
            tell(f"written: {path}")
