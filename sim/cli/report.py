"""The command `das-sim report`: one page about recorded drives, for the screen and for paper."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from typing import Annotated

import typer

from das.command_line.compiling import loading_solver
from das.command_line.options import JsonOption, OverwriteOption
from das.command_line.outputs import check_outputs
from das.command_line.printing import busy, paragraph, tell
from das.domain.errors import DasError


def report(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="RECORDING…", help="Recordings (.mcap); several drives of one line are compared as well."
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="Page to write (.html) [default: print in words]."),
    ] = None,
    pdf: Annotated[
        Path | None, typer.Option("--pdf", metavar="FILE", help="The page as PDF, where Chromium is installed.")
    ] = None,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Write one page about recorded drives: figures in words, pictures, where the energy went, and what happened."""
    _check(files, out, pdf, overwrite=overwrite)
    with loading_solver():
        from das.domain.files.writing import write_whole
        from sim.review.report.page import as_dict, compared, page, subject_of, write_pdf
        from sim.review.report.sentences import paragraph as in_words

    with busy("reading the recordings and solving their sections …"):
        subjects = [subject_of(path) for path in files]
        aligned, not_compared = compared(subjects)
    if out is not None or pdf is not None:
        with busy("drawing the page …"):
            content = page(subjects, aligned, not_compared)
        if out is not None:
            write_whole(out, content.encode())
        if pdf is not None:
            with busy(f"printing {pdf} …"):
                write_pdf(content, pdf)
    if as_json:
        print(json.dumps(as_dict(subjects, aligned, not_compared)))
        return
    for subject in subjects:
        paragraph(f"{subject.drive.name}: {in_words(subject.drive)}")
    for path in (out, pdf):
        if path is not None:
            tell(f"written: {path}")


def _check(files: list[Path], out: Path | None, pdf: Path | None, *, overwrite: bool) -> None:
    """DasError where an output cannot be made; asked before the work begins."""
    missing = [name for name in ("jinja2", "matplotlib") if importlib.util.find_spec(name) is None]
    if missing:
        raise DasError(f"{missing[0]} is not installed: pip install '.[view]' in the checkout")
    for path, suffixes in ((out, (".html", ".htm")), (pdf, (".pdf",))):
        if path is not None and path.suffix.lower() not in suffixes:
            raise DasError(f"{path}: expected a file name that ends in {' or '.join(suffixes)}")
    check_outputs(out, pdf, inputs=files, overwrite=overwrite)
    if pdf is not None:
        from sim.review.report.page import browser

        browser()
