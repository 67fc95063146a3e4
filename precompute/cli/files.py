"""The files that commands write, as groups of options."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import typer

from das.command_line.files import check_outputs, check_picture
from das.command_line.options import JsonOption, OutCsvOption, OverwriteOption, PlotOption
from das.command_line.printing import tell
from das.domain.errors import DasError


class Files:
    """The files that a command writes, and whether it prints JSON.

    A group of options declares again what the user can give; a command without such an option keeps the value here.
    `field()` makes an option that the user must give. `suffix` is what the name of `out` must end in; "": anything.
    """

    out: Path | None = None
    plot: Path | None = None
    overwrite: bool = False
    as_json: bool = False
    suffix = ""

    def outputs(self) -> tuple[Path | None, ...]:
        """All files to write; None for one that was not asked for."""
        return self.out, self.plot

    def check(self, *inputs: str | Path | None) -> None:
        """Refuse, before the work begins, files that cannot be written or would replace an input (DasError)."""
        if self.out is not None and self.suffix not in ("", self.out.suffix.lower()):
            raise DasError(f"{self.out}: expected a file name that ends in {self.suffix}")
        check_picture(self.plot)
        check_outputs(*self.outputs(), inputs=inputs, overwrite=self.overwrite)

    def tell(self) -> None:
        """Print which files were written."""
        for path in self.outputs():
            if path is not None:
                tell(f"written: {path}")


@dataclass(frozen=True, kw_only=True)
class TableFiles(Files):
    """The files that a command writes (rows as CSV, a picture), and whether it prints JSON."""

    out: OutCsvOption = None
    plot: PlotOption = None
    overwrite: OverwriteOption = False
    as_json: JsonOption = False


@dataclass(frozen=True, kw_only=True)
class RunFiles(TableFiles):
    """The files that a command writes of one run (its trajectory as CSV, a picture), and whether it prints JSON."""

    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="Trajectory to write (.csv): one row a grid node."),
    ] = None


@dataclass(frozen=True, kw_only=True)
class MadeFile(Files):
    """The TOML file that a command makes."""

    suffix = ".toml"
    out: Path = field()
    overwrite: OverwriteOption = False

    def write(self, text: str, notes: Iterable[str] = (), about: str = "") -> None:
        """Write the text; print the notes (what was assumed), and the name of the file with what it holds."""
        from das.domain.files.writing import write_whole

        write_whole(self.out, text.encode())
        for note in notes:
            tell(f"note: {note}")
        tell(f"written: {self.out}{f': {about}' if about else ''}")
