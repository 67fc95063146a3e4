"""Where commands write: no output replaces an input or another output, and a picture's kind is told by its suffix."""

from __future__ import annotations

import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from das.domain.errors import DasError
from das.domain.files.writing import check_writable, write_whole

PICTURES = (".png", ".pdf", ".svg")


def check_outputs(*outputs: Path | None, inputs: Iterable[str | Path | None] = (), overwrite: bool = False) -> None:
    """Refuse outputs that cannot be written, that are there already, that are the same file, or that are an input.

    None stands for an output or input that is not asked for. `inputs` may hold names of bundled files as well.
    `overwrite`: a file that is there already may be replaced.
    Raises DasError; meant to be called before long work starts.
    """
    read = {Path(path).resolve() for path in inputs if path is not None}
    seen: set[Path] = set()
    for path in outputs:
        if path is None:
            continue
        if path.resolve() in read:
            raise DasError(f"{path}: the file to write is one that is read")
        if path.resolve() in seen:
            raise DasError(f"{path}: two outputs name the same file")
        seen.add(path.resolve())
        check_writable(path, overwrite=overwrite)


def check_picture(path: Path | None) -> None:
    """Refuse a picture whose suffix is not one of `PICTURES`; None is no picture."""
    if path is not None and path.suffix.lower() not in PICTURES:
        raise DasError(f"{path}: expected a file name that ends in {', '.join(PICTURES[:-1])} or {PICTURES[-1]}")


def offscreen_pyplot() -> Any:
    """matplotlib.pyplot that draws without a screen; DasError where matplotlib is missing."""
    try:
        import matplotlib
    except ImportError:
        raise DasError("pictures need matplotlib: install the extra, pip install '.[view]' in the checkout") from None
    matplotlib.use("Agg")
    from matplotlib import pyplot

    return pyplot


def save_figure(path: Path, figure: Any, *, dpi: int = 120, **settings: Any) -> None:
    """Write a matplotlib figure whole, as the kind that the suffix of `path` names.

    The same figure gives the same bytes. Raises DasError for another suffix, or where the file cannot be written.
    """
    check_picture(path)
    kind = path.suffix.lower()[1:]
    dated = {"png": {}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}[kind]
    content = io.BytesIO()
    figure.savefig(content, format=kind, dpi=dpi, metadata=dated, **settings)
    write_whole(path, content.getvalue())
